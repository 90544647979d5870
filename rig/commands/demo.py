"""`rig demo`: everything once, on a simulated rig."""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from capture.request import RigRequest
from imaging.session import calibration as calibrations
from recon.decide import request as requests
from recon.decide.cost import budget as budgets
from recon.decide.presets import MethodName
from recon.train.devices import training_device as devices
from recon.train.devices import warm_up
from rig.commands.calibrate import earlier_calibration, run_calibrate
from rig.commands.capture import run_capture
from rig.commands.evaluate import headline, run_evaluate
from rig.commands.reconstruct import run_training
from rig.options.common import JsonOption
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, running
from rig.terminal.text import command_line, duration, number

SIM, SEED = "demo", 0
NAME = "demo"
METHOD: MethodName = "nh-3dgs"
TRAINING_SECONDS = 85.0
"""Time limit of the training. At most 90 s are promised, on however slow a machine; the rest is for the last
checkpoint. A machine that needs less trains the whole preset, and then the result is the same on any machine.
"""


def demo(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The session folder to create or continue.")],
    as_json: JsonOption = False,
) -> CommandResult:
    """Run every stage once, on a simulated rig.

    Captures a session with four cameras at six positions, calibrates it from the pictures, trains a
    scene, evaluates it against the simulator's truth, and names the report; this takes a few minutes.
    An interrupted demo in OUT continues with the first unfinished stage.

    Example: rig demo demo/
    """
    with running("demo") as status:
        return run_demo(out, status)


def run_demo(out: Path, status: StatusLine, clock: Callable[[], float] = time.monotonic) -> CommandResult:
    """The four stages; each is skipped, or nearly so, if it is finished."""
    times: dict[str, float] = {}
    before: list[str] = []

    def stage(name: str, work: Callable[[], CommandResult]) -> CommandResult:
        status.begin(name)
        began = clock()
        result = work()
        took = clock() - began
        if result.already_there:
            before.append(name)
        else:
            times[name] = took
        status.say(f"{name}: {result.lines[0]} ({duration(took)})")
        return result

    captured = stage("capture", lambda: _capture(out, status))
    calibrated = stage(
        "calibrate",
        lambda: _calibrate(out, status),
    )
    trained = stage(
        "reconstruct",
        lambda: _train(out, status),
    )
    evaluated = stage("evaluate", lambda: run_evaluate(Path(trained.data["reconstruction"]), status))

    metrics = evaluated.data["metrics"]
    lines = [
        *_poses(metrics),
        headline(metrics),
        _time(times, before),
        f"Report: {evaluated.data['report']}",
        f"Next: {command_line('rig', 'render', trained.data['reconstruction'])}",
    ]
    data: dict[str, Any] = {
        "session": str(out),
        "reconstruction": trained.data["reconstruction"],
        "report": evaluated.data["report"],
        "seconds": {name: round(spent, 1) for name, spent in times.items()},
        "calibration": {key: calibrated.data[key] for key in ("registered", "images", "reprojection_px")},
        "metrics": metrics,
    }
    missing = next((part.missing for part in (captured, calibrated, evaluated) if part.missing), None)
    return CommandResult(data, lines, missing)


def _time(times: Mapping[str, float], before: Sequence[str]) -> str:
    """Seconds of the stages, and which were done by an earlier run."""
    words = ", ".join(f"{name} {duration(spent)}" for name, spent in times.items())
    done = f"{', '.join(before)} done before" if before else ""
    return "Time: " + "; ".join(part for part in (words, done) if part)


def _capture(out: Path, status: StatusLine) -> CommandResult:
    """A new capture, or what the one in OUT lacks."""
    request = RigRequest(resume=(out / "session.json").exists())
    return run_capture(SIM, out, status, request, seed=SEED)


def _train(out: Path, status: StatusLine) -> CommandResult:
    """The scene; kernels are compiled before its time begins, which on a busy machine takes most of it."""
    if not (out / "reconstructions" / NAME).exists():
        warm_up.warm_up(status, devices.training_device())
    request = requests.TrainingRequest(
        METHOD, budget=budgets.Budget(TRAINING_SECONDS, "s"), seed=SEED, name=NAME
    )
    return run_training(out, status, request)


def _calibrate(out: Path, status: StatusLine) -> CommandResult:
    """A calibration of all that was shot: the one that is there, while it still is that."""
    return (
        earlier_calibration(out) if calibrations.calibration_is_current(out) else run_calibrate(out, status)
    )


def _poses(metrics: dict[str, Any]) -> list[str]:
    """The error of the poses in one line, if it was measured."""
    rotation, position = metrics.get("pose_rotation_deg"), metrics.get("pose_translation_relative")
    if rotation is None or position is None:
        return []
    most = ""
    if "pose_rotation_deg_max" in metrics and "pose_translation_relative_max" in metrics:
        most = (
            f"; at most {number(metrics['pose_rotation_deg_max'], 2)} degrees and "
            f"{number(100 * metrics['pose_translation_relative_max'], 2)} %"
        )
    return [
        f"Poses: off by {number(rotation, 2)} degrees and {number(100 * position, 2)} % "
        f"of the rig's size (median{most})"
    ]
