"""Presets draft, standard and best against the front of quality over time, over many scenes.

    python -m bench.recon.presets [--quick] [--json] [--write] [--minutes 20] [--scenes 9] [--work FOLDER]

Each scene is a simulated session, calibrated by its own pictures, and swept as `rig trade` does it, for so
many minutes each; a sweep that was stopped goes on for as many again. The front of a scene is what no other
training of it beats in both time and held-out quality. The last scene is of real photographs, where RIG_DATA
names the folder that has them. --quick takes toy sessions and presets of a few iterations. --write puts the
table into bench/results/presets.md, the numbers into bench/results/presets.json, which
tests/recon/decide/test_presets.py reads, and the fronts as a picture into docs/presets.png.
"""

import argparse
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.support.record import RESULTS, WORK, arguments, machine, publish, words
from bench.support.trial import session
from capture.imports.photos import import_photos
from capture.simulated import capture_simulated
from imaging.files import store
from recon.decide.presets import QUALITIES, Quality
from recon.trade import Point, Trade, front, trade_sweep
from recon.trade.point import behind

TOLERANCE = 0.5
"""dB that a preset may lie behind the front of any scene, at SLACK times its seconds."""
SLACK = 1.1
FASTER, WITHIN = 10.0, 1.0
"""Requirements on every scene: the speed of draft over best, and the loss of standard against best in dB."""
MARKERS = {"draft": "v", "standard": "s", "best": "^"}
TICKS = (5, 10, 20, 50, 100, 200, 500)
LOWEST = 4.0
"""dB below best that the picture reaches down to."""
PICTURE = Path(__file__).parents[2] / "docs" / "presets.png"
MOST_TRAINED = 21
"""Training views of a session here."""
TINY = {"draft": Quality(20, 300, 32), "standard": Quality(60, 600, 64), "best": Quality(120, 900, 64)}


@dataclass(frozen=True)
class Scene:
    """A rig, a seed, and stops by which its bracket is shorter: less light in every picture."""

    rig: str
    seed: int
    darker: int = 0

    @property
    def name(self) -> str:
        """Name in words."""
        return f"{self.rig} {self.seed}" + (f", {self.darker} stops darker" if self.darker else "")


SCENES = (
    Scene("demo", 0), Scene("gallery", 0), Scene("demo-ldr", 0), Scene("demo", 0, darker=3), Scene("demo", 1),
    Scene("gallery", 1), Scene("gallery-ldr", 0), Scene("demo", 2), Scene("demo-ldr", 1),
)  # fmt: skip
CASTLE = Scene("sceaux", 0)
"""Eleven photographs by a hand-held camera, 2832 px wide."""
TOYS = (Scene("toy", 0), Scene("toy-ldr", 0))


def folder_of(scene: Scene, work: Path) -> Path:
    """Session folder, made now if it does not exist."""
    if scene.rig.startswith("toy"):
        return session(work, scene.rig, scene.seed, "truth")
    if scene == CASTLE:
        return castle(work / CASTLE.name.replace(" ", "-"))
    if not scene.darker:
        return session(work, scene.rig, scene.seed, "own")
    folder = work / f"{scene.rig}-{scene.seed}-darker-{scene.darker}"
    if not (folder / "truth" / "truth.json").exists():
        steps = tuple(float(stops - scene.darker) for stops in (-4, 0, 4))
        capture_simulated(scene.rig, folder, seed=scene.seed, bracket=steps)
    if not (folder / "calibration" / "calibration.json").exists():
        from calib.calibrate import calibrate

        calibrate(folder, on_progress=lambda message, done, total: None)
    return folder


def castle(folder: Path) -> Path:
    """The session of the real photographs, calibrated by themselves."""
    if not (folder / "session.json").exists():
        import_photos(Path(os.environ["RIG_DATA"]) / "sceaux", folder)
    if not (folder / "calibration" / "calibration.json").exists():
        from calib.calibrate import calibrate

        calibrate(folder, on_progress=lambda message, done, total: None)
    return folder


def seconds(point: Point) -> float:
    return point.seconds


def quality(point: Point) -> float:
    return point.db


def row(scene: Scene, trade: Trade) -> dict[str, Any]:
    """A scene's front, and where the presets lie."""
    lie = {}
    for name in QUALITIES:
        # Where two presets train the same, as on small images, the first stands for both.
        of_preset = [p for p in trade.points if p.choice.quality == name and not p.choice.overrides.words()]
        if not of_preset:
            continue
        (point,) = of_preset
        near = [p for p in trade.points if p.seconds <= SLACK * point.seconds]
        short = behind(near, lambda p: 0.0, quality, point)
        lie[name] = {"seconds": point.seconds, "db": point.db, "truth_db": point.truth_db, "behind_db": short}
    best = front(trade.points, seconds, quality)
    return {
        "scene": scene.name,
        "measure": trade.measure,
        "method": trade.method,
        "trainings": len(trade.points),
        "presets": lie,
        "front": [{"seconds": p.seconds, "db": p.db, "sets": p.choice.overrides.words()} for p in best],
        "others": [{"seconds": p.seconds, "db": p.db} for p in trade.points if p not in best],
    }


def as_trained(preset: Quality) -> dict[str, int]:
    """A preset as sessions of few training views have it, as all here are."""
    iterations = preset.iterations_of(MOST_TRAINED)
    return {"iterations": iterations, "gaussians": preset.gaussians_of(MOST_TRAINED), "width": preset.width}


def verdict(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return how the presets fare on the worst of the scenes, and what is wrong with them, in sentences."""
    whole = [one["presets"] for one in rows if set(one["presets"]) == set(QUALITIES)]
    figures: dict[str, Any] = {
        "scenes": len(whole),
        "behind_db": {name: max(lie[name]["behind_db"] for lie in whole) for name in QUALITIES}
        if whole
        else {},
        "draft_times_faster": min(lie["best"]["seconds"] / lie["draft"]["seconds"] for lie in whole)
        if whole
        else None,
        "standard_below_best_db": max(lie["best"]["db"] - lie["standard"]["db"] for lie in whole)
        if whole
        else None,
    }
    wrong = [
        f"{name} lies {value:.2f} dB behind the front"
        for name, value in figures["behind_db"].items()
        if value > TOLERANCE
    ]
    if whole and figures["draft_times_faster"] < FASTER:
        wrong.append(f"draft is {figures['draft_times_faster']:.1f} times faster than best")
    if whole and figures["standard_below_best_db"] > WITHIN:
        wrong.append(f"standard lies {figures['standard_below_best_db']:.2f} dB below best")
    return figures | {"wrong": wrong}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    rows = []
    for scene in options.scenes:
        folder = folder_of(scene, options.work)
        rows.append(row(scene, trade_sweep(folder, budget=60 * options.minutes)))
    presets = {name: as_trained(preset) for name, preset in QUALITIES.items()}
    return {"machine": machine(), "presets": presets, "rows": rows, "verdict": verdict(rows)}


def report(result: dict[str, Any]) -> str:
    judged = result["verdict"]
    lines = [
        "# Where the presets lie",
        "",
        f"`python -m bench.recon.presets --write`, {words(result['machine'])}. Sessions calibrated by their "
        "own pictures, of simulated rigs and, as sceaux, of real photographs; dB as `rig evaluate` measures "
        "them on held-out pictures; behind: how much more the "
        f"best training of {SLACK:g} times the seconds or less has.",
        "",
        "| scene | trainings | preset | s | dB | dB to the truth | behind, dB |",
        "|---|---|---|---|---|---|---|",
    ]
    for one in result["rows"]:
        for name, lie in one["presets"].items():
            true = "-" if lie["truth_db"] is None else f"{lie['truth_db']:.2f}"
            lines.append(
                f"| {one['scene']} | {one['trainings']} | {name} | {lie['seconds']:.1f} | {lie['db']:.2f} "
                f"| {true} | {lie['behind_db']:.2f} |"
            )
    if judged["scenes"]:
        short = ", ".join(f"{name} {value:.2f}" for name, value in judged["behind_db"].items())
        lines += [
            "",
            f"On the worst of {judged['scenes']} scenes, dB behind the front: {short} (at most {TOLERANCE}); "
            f"draft is {judged['draft_times_faster']:.1f} times faster than best (at least {FASTER:g}), "
            f"standard {judged['standard_below_best_db']:.2f} dB below it (at most {WITHIN:g}). "
            + ("; ".join(judged["wrong"]) + "." if judged["wrong"] else "All three hold."),
        ]
    lines += ["", "## Fronts", "", "| scene | s | dB | set by hand |", "|---|---|---|---|"]
    for one in result["rows"]:
        lines += [
            f"| {one['scene']} | {p['seconds']:.1f} | {p['db']:.2f} | {', '.join(p['sets']) or 'a preset'} |"
            for p in one["front"]
        ]
    return "\n".join(lines) + "\n"


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """The fronts of scenes that have all presets in one picture, against `best` of each."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 5), layout="constrained")
    whole = (one for one in rows if set(one["presets"]) == set(QUALITIES))
    for index, one in enumerate(whole):
        zero, lie = one["presets"]["best"]["db"], one["presets"]
        colour = plt.colormaps["tab10"](index % 10)
        for points, line in ((one["front"], "solid"), (one["others"], "none")):
            seconds, db = [p["seconds"] for p in points], [p["db"] - zero for p in points]
            axes.plot(seconds, db, linestyle=line, marker="o", ms=3, lw=1, color=colour, alpha=0.7)
        axes.plot([], [], "-", color=colour, label=one["scene"])
        for name, marker in MARKERS.items():
            at = lie[name]["seconds"], lie[name]["db"] - zero
            axes.plot(*at, marker, ms=9, color=colour, mec="black", mew=0.8, zorder=3)
    for name, marker in MARKERS.items():
        axes.plot([], [], marker, ms=9, color="white", mec="black", label=name)
    axes.set_xscale("log")
    axes.set_xticks(TICKS, [str(tick) for tick in TICKS])
    axes.set_ylim(bottom=-LOWEST)
    axes.set_xlabel("training, seconds on two cores")
    axes.set_ylabel("dB of held-out pictures, against best")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8, loc="lower right", ncols=2)
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--minutes", type=float, default=20.0, help="of training for each scene")
    parser.add_argument("--scenes", type=int, default=len(SCENES), help="number of simulated scenes")
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    real = (CASTLE,) if os.environ.get("RIG_DATA") else ()
    options.scenes = (*SCENES[: options.scenes], *real)
    if options.quick:
        QUALITIES.update(TINY)
        options.scenes, options.minutes = TOYS, min(options.minutes, 0.15)
        options.work = options.work / "quick"
    result = measure(options)
    print(json.dumps(result, indent=1) if options.json else report(result))
    if options.write:
        publish("presets", report(result))
        store.write_json(RESULTS / "presets.json", result)
        draw(result["rows"], PICTURE)


if __name__ == "__main__":
    main()
