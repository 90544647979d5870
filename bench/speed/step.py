"""Time of a training step, part by part: the demo's scene with NH-3DGS.

    python -m bench.speed.step [--quick] [--json] [--write] [--seed 0] [--calibration own|truth] [--work
    FOLDER]

The parts of real steps, late in a training (all harmonics on, as many Gaussians as there will be), timed
by wrapping the functions that do them; mean over the steps. Times are of the processor, on one thread: what
else a machine does changes them little. --write puts the table into bench/results/step.md.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch

import recon.observe.losses.photometric
import recon.scene.gaussians
import recon.splat.cpu.rasterizer
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import prepare, session
from imaging.compute import threads
from recon.decide.cost.probe import LATE
from recon.methods import nh_3dgs
from recon.observe.linear import LinearLight
from recon.scene.appearance import LuminanceChromaticity
from recon.start.initialisation import gaussians_at
from recon.train.adam import Adam
from recon.train.densification import DensityRules
from recon.train.devices.warm_up import warm_up
from recon.train.schedule import Schedule
from recon.train.trainer import train
from recon.train.training import Plan, Training

PARTS = {
    "rasterise, forward": (recon.scene.gaussians, "rasterize"),
    "rasterise, backward": (recon.splat.cpu.rasterizer._Tables, "gradients"),
    "colours, forward": (type(LuminanceChromaticity()), "colours"),
    "observation, forward": (LinearLight, "compare"),
    "L1 and SSIM with gradient": (recon.observe.losses.photometric, "photometric_loss"),
    "Adam": (Adam, "step"),
    "backward, all": (torch.Tensor, "backward"),
}


def timed(times: dict[str, float], name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, with what it takes added to times[name]."""

    def run(*arguments: Any, **options: Any) -> Any:
        began = time.process_time()
        result = function(*arguments, **options)
        times[name] += time.process_time() - began
        return result

    return run


def measure(options: argparse.Namespace) -> dict[str, Any]:
    warm_up(lambda message, done, total: None)
    trial = prepare(session(options.work, options.sim, options.seed, options.calibration), options.cap, 0)
    method = nh_3dgs.compose(trial.dataset, trial.light)
    gaussians = gaussians_at(trial.start, method.appearance, method.observation.units)
    training = Training.begin(method, trial.light, gaussians, trial.dataset.extent)

    def go(plan: Plan, until: int) -> None:
        train(training, trial.dataset, plan, until=until)

    grown = options.iterations
    go(Plan(grown, DensityRules(options.cap), log_every=grown), grown)
    # Standing late on the schedule: everything is on, and nothing is split.
    count = grown + 20 + options.steps
    late = Plan(count, DensityRules(options.cap), log_every=count)
    training.schedule = Schedule.still(count, LATE)
    go(late, grown + 20)
    times: dict[str, float] = defaultdict(float)
    with_timers = [
        patch.object(owner, name, timed(times, part, getattr(owner, name)))
        for part, (owner, name) in PARTS.items()
    ]
    for timer in with_timers:
        timer.start()
    began = time.process_time()
    go(late, count)
    total = time.process_time() - began
    for timer in with_timers:
        timer.stop()
    times["backward of colours and observation"] = times.pop("backward, all") - times["rasterise, backward"]
    times["the rest"] = total - sum(times.values())
    view = trial.dataset.train[0].lens
    return {
        "machine": machine(),
        "calibration": options.calibration,
        "gaussians": len(training.gaussians),
        "size": f"{view.width}x{view.height}",
        "shots": len(trial.dataset.train[0].shots),
        "step_ms": 1e3 * total / options.steps,
        "parts_ms": {name: 1e3 * spent / options.steps for name, spent in times.items()},
    }


def report(result: dict[str, Any]) -> str:
    total = result["step_ms"]
    lines = [
        "# A training step",
        "",
        f"`python -m bench.speed.step --write --calibration {result['calibration']}`: the demo's scene, "
        f"NH-3DGS, {result['gaussians']} Gaussians, "
        f"{result['size']}, {result['shots']} shots a view. "
        f"{words(result['machine'])}.",
        "",
        "| part | processor ms | share |",
        "|---|---|---|",
    ]
    for name, spent in result["parts_ms"].items():
        lines.append(f"| {name} | {spent:.2f} | {100 * spent / total:.0f} % |")
    return "\n".join([*lines, f"| all | {total:.2f} | |"]) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--calibration", choices=("own", "truth"), default="own")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    options.sim, options.cap, options.iterations, options.steps = "demo", 20_000, 600, 200
    if options.quick:
        options.sim, options.calibration = "toy", "truth"
        options.cap, options.iterations, options.steps = 900, 60, 50
    threads.set_threads(1)
    result = measure(options)
    deliver(options, "step", result, report(result))


if __name__ == "__main__":
    main()
