"""Choice of the modelled parts on scenes whose needs are known.

    python -m bench.recon.parts.ladder [--quick] [--json] [--write] [--minutes M] [--work FOLDER]

Each scene (bench/recon/parts/ladder_scenes.py) is shot by the simulator, calibrated, and trained twice from
the same calibration: with what the ladder takes, and with everything on: corrections of poses, exposures and
falloff, harmonics of degree 2, as many Gaussians as the preset allows, and a method with a tone curve for
photographs. Scenes with lamps are trained thrice each way, for the mean of their dB. Finished rows are kept
in FOLDER/ladder.jsonl, a line a scene; a line that is deleted is measured again, from the session in the
folder of that name. --minutes ends after the scene that is under way then. --quick takes one scene and short
trainings. --write puts the table into bench/results/ladder.md.
"""

import argparse
import os
import shutil
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

from bench.recon.parts.ladder_scenes import KINDS, Kind, Scene, scenes, session
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.session.calibration import CalibrationRecord, read_calibration
from imaging.session.records import Rung
from imaging.session.session import Session
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, MethodName, Quality
from recon.decide.request import TrainingRequest
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.model import read_model
from recon.train.devices.warm_up import warm_up

RIGHT = 0.95
"""Share of the rungs that has to be right."""
WORSE = 0.2
"""dB on held-out pictures that the ladder's choice may lie below everything on."""
LESS = 3.0
"""Factor in time or size that scenes with little need have to gain."""
SMALL = Quality(2000, 20_000, 640)
"""Budget in place of `standard`: half its Gaussians, since the pictures are small."""
TINY = Quality(60, 600, 640)
"""And where it has to be quick."""
QUICK = "one exposure enough 0"


def chosen(record: CalibrationRecord, rungs: Sequence[Rung], exposures: int) -> dict[str, bool]:
    """Return which rungs were taken: those of the calibration, then those of the model of other names.

    response_curve: whether a curve is used, whatever rung it stands on; exposures: whether there are several.
    """
    taken = {rung.name: rung.taken for rung in rungs}
    taken |= {rung.name: rung.taken for rung in record.rungs}
    taken["response_curve"] = any(camera.response.kind == "curve" for camera in record.cameras)
    taken["exposures"] = exposures > 1
    return taken


def wrong(needs: Mapping[str, bool], taken: Mapping[str, bool]) -> list[str]:
    """Rungs taken without need, or needed and not taken; a rung that was not considered is not taken."""
    return [
        f"{'no ' if need else ''}{name}" for name, need in needs.items() if taken.get(name, False) != need
    ]


def row(scene: Scene, work: Path) -> dict[str, Any]:
    """Return what was chosen, and how it fares against everything on."""
    folder = session(scene, work)
    photographs = scene.kind.rig.endswith("ldr")
    most = QUALITIES["standard"].gaussians
    full = Overrides(refine="poses+exposures+vignetting", degree=2, gaussians=most)
    warm_up(lambda message, done, total: None)
    # A finished training would be returned as it is, in no time.
    shutil.rmtree(folder / "reconstructions", ignore_errors=True)
    fares: dict[str, Any] = {"load": round(os.getloadavg()[0], 1)}
    ways: tuple[tuple[str, MethodName, Overrides], ...] = (
        ("ladder", "auto", Overrides()),
        ("full", "hdr-gs" if photographs else "nh-3dgs", full),
    )
    for name, method, overrides in ways:
        began = time.perf_counter()
        made = reconstruct(folder, TrainingRequest(method=method, overrides=overrides, name=name))
        seconds = time.perf_counter() - began
        metrics = evaluate(made).known()
        all_metrics = [metrics]
        for seed in range(1, scene.kind.trainings):
            again = reconstruct(
                folder, TrainingRequest(method=method, overrides=overrides, seed=seed, name=f"{name}-{seed}")
            )
            all_metrics.append(evaluate(again).known())
        fares[name] = {
            "seconds": seconds,
            "db": fmean(one["ldr_psnr_oe" if photographs else "raw_psnr"] for one in all_metrics),
            "truth_db": fmean(one["hdr_psnr_mu_aligned"] for one in all_metrics),
            "gaussians": metrics["gaussians"],
            "size_bytes": metrics["size_bytes"],
            "train_seconds": metrics["train_seconds"],
        }
    exposures = len({shot.step for shot in Session.open(folder).shots("scene")})
    record, model = read_calibration(folder), read_model(folder / "reconstructions" / "ladder")
    return {"scene": scene.name, "chosen": chosen(record, model.rungs, exposures), **fares}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache, rows = Cache(options.work / "ladder.jsonl"), []
    until = time.monotonic() + 60 * options.minutes
    for scene in options.scenes:
        if cache.has(scene.name) or time.monotonic() < until:
            rows.append(cache.get(scene.name, partial(row, scene, options.work)))
    kinds = [summary for kind in KINDS if (summary := of_kind(kind, rows))]
    return {
        "machine": machine(),
        "preset": vars(QUALITIES["standard"]),
        "scenes": len(options.scenes),
        "rows": rows,
        "kinds": kinds,
        "verdict": verdict(kinds),
    }


def of_kind(kind: Kind, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Scenes of a kind together, or None."""
    of_scene = [one for one in rows if one["scene"].rpartition(" ")[0] == kind.name]
    if not of_scene:
        return None
    faults = [fault for one in of_scene for fault in wrong(kind.needs, one["chosen"])]
    gains = [one["ladder"]["db"] - one["full"]["db"] for one in of_scene]
    return {
        "kind": kind.name,
        "little": kind.little,
        "scenes": len(of_scene),
        "judged": len(of_scene) * len(kind.needs),
        "wrong": {fault: faults.count(fault) for fault in sorted(set(faults))},
        "needed": [name for name, need in kind.needs.items() if need],
        "db": fmean(gains),
        "worst_db": min(gains),
        "worst_truth_db": min(one["ladder"]["truth_db"] - one["full"]["truth_db"] for one in of_scene),
        "faster": [one["full"]["seconds"] / one["ladder"]["seconds"] for one in of_scene],
        "smaller": [one["full"]["size_bytes"] / one["ladder"]["size_bytes"] for one in of_scene],
        "gaussians": fmean(one["ladder"]["gaussians"] for one in of_scene),
    }


def verdict(kinds: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return whether what is required holds, over all kinds, and what does not, in words."""
    judged = sum(one["judged"] for one in kinds)
    faults = sum(sum(one["wrong"].values()) for one in kinds)
    right = 1 - faults / judged if judged else None
    worst = min((one["worst_db"] for one in kinds), default=None)
    less = [
        max(pair)
        for one in kinds
        if one["little"]
        for pair in zip(one["faster"], one["smaller"], strict=True)
    ]
    misses = []
    if right is not None and right < RIGHT:
        misses.append(f"{100 * right:.1f} % of the choices are right")
    if worst is not None and worst < -WORSE:
        misses.append(f"the worst scene is {-worst:.2f} dB below everything on")
    if less and min(less) < LESS:
        misses.append(f"a scene that needs little is only {min(less):.1f} times faster or smaller")
    return {
        "scenes": sum(one["scenes"] for one in kinds),
        "judged": judged,
        "right": right,
        "worst_db": worst,
        "worst_truth_db": min((one["worst_truth_db"] for one in kinds), default=None),
        "least_less": min(less, default=None),
        "misses": misses,
    }


def report(result: Mapping[str, Any]) -> str:
    total, preset = result["verdict"], result["preset"]
    loads = [one["load"] for one in result["rows"]]
    lines = [
        "# Is just what a scene requires modelled?",
        "",
        f"`python -m bench.recon.parts.ladder --write`, {words(result['machine'])}; rows made at loads up to "
        f"{max(loads, default=0):g}. {total['scenes']} of {result['scenes']} simulated scenes, 24 views of "
        f"96 x 72; trainings of {preset['iterations']} iterations and up to {preset['gaussians']} Gaussians. "
        "Needed: what scenes of this kind require; all else that is judged has to be left out. Wrong: taken "
        "for nothing, or (no) left out though needed, and how often. dB: held-out pictures of the ladder's "
        "choice less those with everything on; truth: the same of the light there is (hdr_psnr_mu_aligned). "
        "Times faster counts the trials of the ladder; in both columns the mean over scenes.",
        "",
        "| kind | scenes | needed | choices right | wrong | dB, mean | dB, worst | truth, worst "
        "| times faster | times smaller | Gaussians |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in result["kinds"]:
        faults = ", ".join(f"{name} ({count})" for name, count in one["wrong"].items()) or "-"
        right = one["judged"] - sum(one["wrong"].values())
        lines.append(
            f"| {one['kind']}{' *' if one['little'] else ''} | {one['scenes']} "
            f"| {', '.join(one['needed']) or 'nothing'} | {right} of {one['judged']} | {faults} "
            f"| {one['db']:+.2f} | {one['worst_db']:+.2f} | {one['worst_truth_db']:+.2f} "
            f"| {fmean(one['faster']):.2f} | {fmean(one['smaller']):.2f} | {one['gaussians']:.0f} |"
        )
    if total["judged"]:
        least = "-" if total["least_less"] is None else f"{total['least_less']:.1f}"
        lines += [
            "",
            f"{100 * total['right']:.1f} % of {total['judged']} choices are right (at least {100 * RIGHT:g} "
            f"%); the worst scene lies {total['worst_db']:+.2f} dB from everything on (at least {-WORSE:g}), "
            f"of the light {total['worst_truth_db']:+.2f}; "
            f"where little is needed (*) the least is {least} times faster or smaller (at least {LESS:g}). "
            + ("Missed: " + "; ".join(total["misses"]) + "." if total["misses"] else "All three hold."),
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="after which no scene is begun")
    parser.add_argument("--work", type=Path, default=WORK / "ladder")
    options = parser.parse_args()
    options.scenes = scenes()
    QUALITIES["standard"] = SMALL
    if options.quick:
        options.scenes = [scene for scene in options.scenes if scene.name == QUICK]
        options.work = options.work / "quick"
        QUALITIES["standard"] = TINY
    result = measure(options)
    deliver(options, "ladder", result, report(result))


if __name__ == "__main__":
    main()
