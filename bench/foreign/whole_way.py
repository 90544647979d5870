"""Foreign photographs taken the whole way: import, check, calibrate, merge, reconstruct, evaluate.

    python -m bench.foreign.whole_way [--quick] [--json] [--write] [--work FOLDER] [--scenes room,objects,...]
        [--quality draft]

Mitsuba's light (`tests/foreign`), photographed by a few lines that share nothing with the simulator, goes
through the commands as a user gives them; what they leave on the disk is held to the truth by numpy. Finished
rows are kept under --work by commit; the table has, of each scene, the first commit that was measured and the
last, from bench/results/foreign.json. --quick: 28 views of 160 px, draft.
"""

import argparse
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.support.record import RESULTS, WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.files import store
from tests.foreign import judge, subjects
from tests.foreign.folder import Body, Shots, photograph, tell_poses
from tests.foreign.lit import LitScene

Times = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Case:
    """Subject and photographs of a case. given: with the true poses and lens, else without poses."""

    title: str
    scene: Callable[..., LitScene]
    body: Body
    times: Times
    developed: bool = False
    given: bool = False


LAMPS: Times = ((1 / 4000, 1 / 250, 1 / 15, 1.0),)
PROBE: Times = ((1 / 125, 1 / 8, 2.0),)
STEPS: Times = ((1 / 125, 1 / 30, 1 / 8, 1 / 2, 2.0),)
SINGLE: Times = ((1 / 8,), (1 / 2,), (1 / 15,), (1 / 4,), (1.0,))
CASES = {
    "room": Case("room, RAW of 14 bits", subjects.room, Body(14, seed=1), LAMPS),
    "room-single": Case(
        "room, a JPEG a view", subjects.room, Body(seed=2, well=20_000.0), SINGLE, developed=True
    ),
    "objects": Case("objects, RAW of 12 bits, poses given", subjects.objects, _PROBED := Body(
        12, well=9_000.0, black=256, seed=3), PROBE, given=True),
    "objects-own": Case("objects, RAW of 12 bits", subjects.objects, _PROBED, PROBE),
    "objects-jpeg": Case("objects, JPEG brackets, poses given", subjects.objects, Body(
        seed=4, well=20_000.0), STEPS, developed=True, given=True),
    "objects-jpeg-own": Case("objects, JPEG brackets", subjects.objects, Body(
        seed=4, well=20_000.0), STEPS, developed=True),
}  # fmt: skip

PARTS = {
    "background": ("background",),
    "floor": ("floor",),
    "below": ("table_leg", "table_below"),
    "gold": ("gold", "polished"),
    "glass": ("glass",),
    "mirror": ("mirror",),
    "lamps": ("lamp",),
}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each scene."""
    commit = _commit()
    size = "quick" if options.quick else options.quality
    cache = Cache(options.work / "whole_way.jsonl")
    rows = []
    for name in options.scenes:
        folder = options.work / f"{name}-{size}"
        row = cache.get(
            f"{commit} {name} {size}",
            partial(one_case, CASES[name], folder, options.quality, options.quick),
        )
        rows.append({"scene": name, "commit": commit, "quality": options.quality} | row)
    return {"machine": machine(), "rows": rows}


def one_case(case: Case, folder: Path, quality: str, quick: bool) -> dict[str, Any]:
    """Return what became of one set of photographs."""
    scene = case.scene(views=28, width=160, samples=9, traced=64) if quick else case.scene()
    light = scene.light()
    if folder.exists():
        shutil.rmtree(folder)
    shots = photograph(folder / "photos", light, case.body, case.times, developed=case.developed)
    if case.given:
        tell_poses(shots, scene.poses, scene.focal, (scene.width, scene.height), scene.surface_points())
    session, merged = folder / "S", folder / "merged"
    began = time.perf_counter()
    said = [_rig("import", shots.folder, session), _rig("check", session)]
    said.append(_rig("calibrate", session, *(("--only", "response") if case.given else ())))
    row = _calibrated(case, scene, session, shots)
    said.append(_rig("merge", session, merged))
    if len(case.times[0]) > 1 and merged.exists():
        row |= judge.merge_figures(merged, light)
    judge.tell_truth(session, light, scene.poses, shots, developed=case.developed)
    said.append(_rig("reconstruct", session, "--quality", quality, "--name", "scene"))
    scene_folder = session / "reconstructions" / "scene"
    said.append(_rig("evaluate", scene_folder))
    if (scene_folder / "metrics.json").exists():
        row |= judge.light_figures(
            scene_folder, light, {name: scene.where(*parts) for name, parts in PARTS.items()}
        )
        metrics = store.read_json(scene_folder / "metrics.json")
        row |= {"psnr_evaluated": metrics["hdr_psnr_mu_aligned"], "gaussians": metrics["gaussians"]}
    row["seconds"] = round(time.perf_counter() - began, 1)
    row["failed"] = [one for one in said if one]
    return row


def _calibrated(case: Case, scene: LitScene, session: Path, shots: Shots) -> dict[str, Any]:
    if not (session / "calibration" / "calibration.json").exists():
        return {"placed": 0}
    row: dict[str, Any] = judge.exposure_figures(session, shots)
    if case.developed:
        row["response"] = judge.response_figure(session)
    return row if case.given else row | judge.pose_figures(session, scene.poses, scene.focal)


def _rig(*arguments: object) -> str:
    """Run a command of rig; what it failed with, or nothing."""
    command = [sys.executable, "-m", "rig", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stderr.strip().splitlines()
    print(f"rig {arguments[0]}: {done.returncode} {lines[-1] if lines else ''}", file=sys.stderr)
    return "" if done.returncode == 0 else f"{arguments[0]}: {lines[-1] if lines else done.returncode}"


def _commit() -> str:
    """The commit of the code that is measured."""
    run = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True)
    return run.stdout.strip()


def first_and_newest(rows: list[dict[str, Any]], earlier: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """First measured row of each scene, and the newest."""
    together = []
    for name in CASES:
        of_scene = [row for row in (*earlier, *rows) if row["scene"] == name]
        unlike = {row["commit"]: row for row in of_scene}
        together += [*unlike.values()][:1] + [*unlike.values()][1:][-1:]
    return together


COLUMNS = {
    "poses": (
        ("views", "placed", "{:.0f}"),
        ("wrong", "wrong", "{:.0f}"),
        ("degrees, median", "degrees", "{:.3f}"),
        ("degrees, worst", "degrees_worst", "{:.3f}"),
        ("AUC@1", "auc", "{:.3f}"),
        ("focal length off, %", "focal", "{:+.3%}"),
    ),
    "photographs": (
        ("labels off, %", "ratios_labelled", "{:.2%}"),
        ("ratios off, %", "ratios", "{:.2%}"),
        ("worst, %", "ratios_worst", "{:.2%}"),
        ("response rms, %", "response", "{:.2%}"),
        ("merged, dB", "merge_psnr", "{:.1f}"),
        ("merged, stops", "merge_stops", "{:.3f}"),
        ("chi-square", "chi", "{:.2f}"),
        ("smooth", "chi_smooth", "{:.2f}"),
        ("smooth, median", "chi_smooth_median", "{:.2f}"),
    ),
    "held-out light": (
        ("dB of the maximum", "psnr", "{:.1f}"),
        ("of the 99.9th percentile", "psnr_999", "{:.1f}"),
        ("rig evaluate, dB", "psnr_evaluated", "{:.1f}"),
        ("stops", "stops", "{:.3f}"),
        ("darkest tenth", "stops_dark", "{:.2f}"),
        ("brightest 1 %", "stops_bright", "{:.2f}"),
        *((name, f"stops_{name}", "{:.2f}") for name in PARTS),
        ("Gaussians", "gaussians", "{:,.0f}"),
        ("seconds", "seconds", "{:.0f}"),
    ),
}


def table(result: dict[str, Any], options: argparse.Namespace) -> str:
    """Markdown."""
    lines = [
        "# Foreign truth: path-traced light, taken the whole way",
        "",
        f"`python -m bench.foreign.whole_way{' --quick' * options.quick} --write`: Mitsuba's light, "
        "photographed by a camera that shares no code with the simulator (28 views of "
        f"{160 if options.quick else 400} px, one rig each; labels of exposures off by 4 %), imported, "
        f"checked, calibrated, merged, trained (preset {options.quality}) and evaluated. Of each scene the "
        "first commit that was measured, and the last. "
        f"{words(result['machine'])}.",
    ]
    for title, columns in COLUMNS.items():
        heads = [head for head, _, _ in columns]
        lines += ["", f"## {title.capitalize()}", ""]
        lines += ["| " + " | ".join(["scene", "commit", *heads]) + " |", "|---" * (len(heads) + 2) + "|"]
        for row in result["rows"]:
            shown = [_cell(row.get(key), form) for _, key, form in columns]
            if any(shown):
                cells = [CASES[row["scene"]].title, row["commit"], *shown]
                lines.append("| " + " | ".join(cells) + " |")
    failures = [
        f"{CASES[row['scene']].title}, {row['commit']}: {one}"
        for row in result["rows"]
        for one in row["failed"]
    ]
    lines += ["", "Light in stops is the median of |log2| over the values; PSNR is of the mu-law.", ""]
    if failures:
        lines += ["What did not end with 0:", "", *(f"* {one}" for one in failures), ""]
    return "\n".join(lines)


def _cell(value: Any, form: str) -> str:
    missing = value is None or not np.isfinite(value)
    return "" if missing else form.format(value).removesuffix("%")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument(
        "--work", type=Path, default=WORK / "foreign", help="keeps sessions and finished rows"
    )
    parser.add_argument("--scenes", default=",".join(CASES), help="comma-separated")
    parser.add_argument("--quality", default="standard", choices=("draft", "standard", "best"))
    options = parser.parse_args()
    options.scenes = tuple(options.scenes.split(","))
    options.quality = "draft" if options.quick else options.quality
    result = measure(options)
    if options.write:
        stored = RESULTS / "foreign.json"
        result["rows"] = first_and_newest(result["rows"], store.read_json(stored) if stored.exists() else [])
    deliver(options, "foreign", result, table(result, options), result["rows"])


if __name__ == "__main__":
    main()
