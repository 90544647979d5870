"""Poses of boards and of scenes against the truth, photographs beside pycolmap's defaults, and extremes.

    python -m bench.calibration.poses [--quick] [--json] [--write]

board: 4 cameras of 960x720 and 25 poses of the board, corners off by 0.06 px (normal, each coordinate), or
found in rendered pictures. scene: the demo rig, 24 views, at its usual light and 8 stops below.
sceaux: the photographs of that name, where RIG_DATA names the folder that has them. --write puts the table
into bench/results/calibration.md. Finished rows are kept by version of the code, so that a stopped run
goes on; remove hdr-rig-bench/calibration.jsonl to begin anew.
"""

import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from bench.calibration import board as board_trials
from bench.calibration import extremes as extreme_trials
from bench.calibration import scene as scene_trials
from bench.calibration.pose_error import covered
from bench.support.record import WORK, arguments, deliver, machine, words
from imaging.files import store

VERSIONS = ("hdr-rig", "pycolmap", "numpy", "opencv-contrib-python-headless")
SESSIONS = {320: 4, 640: 1}
ROOT = Path(__file__).parents[2]


class Rows:
    """Finished rows in a file; those of other versions, or of other code of calib, count for nothing."""

    def __init__(self, path: Path) -> None:
        self._path = path
        code = b"".join(file.read_bytes() for file in sorted((ROOT / "calib").rglob("*.py")))
        self._code = " ".join([*(version(name) for name in VERSIONS), hashlib.sha256(code).hexdigest()])
        lines = store.read_lines(path) if path.exists() else []
        self._known: dict[str, dict[str, Any]] = {
            line["key"]: line["row"] for line in lines if line["code"] == self._code
        }

    def get(self, key: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The row of that name, made now if it is not there."""
        if key not in self._known:
            self._known[key] = make()
            store.make_folder(self._path.parent)
            store.append_line(self._path, {"key": key, "code": self._code, "row": self._known[key]})
        return self._known[key]


def board(rows: Rows, seeds: int, rendered: int) -> dict[str, list[dict[str, Any]]]:
    """Rigs from a board, and what OpenCV makes of the same corners."""
    return {
        "corners": [rows.get(f"board {seed}", partial(board_trials.trial, seed)) for seed in range(seeds)],
        "pictures": [
            rows.get(f"board pictures {seed}", partial(board_trials.trial, seed, rendered=True))
            for seed in range(rendered)
        ],
        "OpenCV": [
            rows.get(f"board OpenCV {seed}", partial(board_trials.peer, seed)) for seed in range(seeds)
        ],
    }


def scene(rows: Rows, seeds: Mapping[int, int]) -> dict[str, list[dict[str, Any]]]:
    """Rigs from a scene; seeds: how many sessions, by the width of their pictures."""
    by_case = {}
    for width, count in seeds.items():
        for stops in (0, -8):
            by_case[f"{width} px, {stops} EV"] = [
                rows.get(f"scene {width} {stops} {seed}", partial(scene_trials.trial, seed, stops, width))
                for seed in range(100, 100 + count)
            ]
    return by_case


def sceaux(rows: Rows) -> dict[str, Any] | None:
    """Load real photographs; None if they are missing."""
    data = os.environ.get("RIG_DATA")
    if not data:
        return None
    return rows.get("sceaux", partial(scene_trials.photographs, Path(data) / "sceaux"))


def extremes(rows: Rows, names: Sequence[str]) -> list[dict[str, Any]]:
    """A sentence a case."""
    return [rows.get(f"extreme {name}", partial(extreme_trials.outcome, name)) for name in names]


def gathered(rows: list[dict[str, Any]], name: str) -> np.ndarray:
    return np.concatenate([np.atleast_1d(row[name]) for row in rows if name in row])


def spread(values: np.ndarray, digits: int) -> str:
    """Median, 95 % and the largest."""
    middle, high, worst = (np.percentile(values, share) for share in (50, 95, 100))
    return " / ".join(f"{value:.{digits}f}" for value in (middle, high, worst))


def share(rows: list[dict[str, Any]], name: str) -> str:
    inside = covered(gathered(rows, name).tolist()) if any(name in row for row in rows) else None
    return "-" if inside is None else f"{100 * inside:.0f} %"


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Poses",
        "",
        f"`python -m bench.calibration.poses --write`. {words(result['machine'])}. "
        + ", ".join(f"{name} {version(name)}" for name in VERSIONS)
        + ".",
        "",
        "In: errors within 2.8 stated standard errors of the worst axis, which holds 95 % of vectors that "
        "err alike along three axes, and more where one axis is the worst.",
        "",
        "## Board: 4 cameras of 960x720, 25 poses, errors of the rig (median / 95 % / worst)",
        "",
        "| corners | sessions | rotation, degrees | in | translation, mm | in | s |",
        "|---|---|---|---|---|---|---|",
    ]
    names = {
        "corners": "off by 0.06 px",
        "pictures": "found in pictures",
        "OpenCV": "off by 0.06 px, by OpenCV's calibrateMultiview of the boards seen whole",
    }
    for key, rows in result["board"].items():
        solved = [row for row in rows if "rotation" in row]
        if not rows:
            continue
        if not solved:
            lines.append(f"| {names[key]} | {len(rows)} | refused: {rows[0]['refused']} | | | | |")
            continue
        lines.append(
            f"| {names[key]} | {len(rows)} | {spread(gathered(solved, 'rotation'), 4)} "
            f"| {share(solved, 'rotation_ratios')} | {spread(gathered(solved, 'translation'), 3)} "
            f"| {share(solved, 'translation_ratios')} | {np.median(gathered(solved, 'seconds')):.1f} |"
        )
    if result["scene"]:
        lines += [
            "",
            "## Scene: the demo rig, 24 views, all pairs of views (median over sessions, worst)",
            "",
            "| pictures | sessions | placed | AUC@1 | AUC@3 | AUC@5 | rotation, degrees | direction, degrees "
            "| rotation in | place in | s | of these for standard errors |",
            "|" + "---|" * 12,
        ]
    for name, rows in result["scene"].items():
        cells = [name, str(len(rows))]
        cells.append(f"{sum(row['registered'] for row in rows)} of {sum(row['views'] for row in rows)}")
        for key in ("auc_1", "auc_3", "auc_5"):
            errors = gathered(rows, key)
            cells.append(f"{np.median(errors):.3f} ({errors.min():.3f})")
        for key in ("rotation", "direction"):
            errors = gathered(rows, key)
            cells.append(f"{np.median(errors):.3f} ({errors.max():.3f})")
        cells += [share(rows, "rotation_ratios"), share(rows, "translation_ratios")]
        cells += [f"{np.median(gathered(rows, key)):.1f}" for key in ("seconds", "sure_seconds")]
        lines.append(f"| {' | '.join(cells)} |")
    if result["sceaux"]:
        lines += [
            "",
            f"## sceaux, at {scene_trials.WIDTH} px",
            "",
            "Each error is over the scene points that its own program kept.",
            "",
            "| | placed | mean reprojection error, px | points | observations | track length | s |",
            "|---|---|---|---|---|---|---|",
        ]
        for name, row in result["sceaux"].items():
            lines.append(
                f"| {name} | {row['registered']} of {row['images']} | {row['reprojection_px']:.3f} "
                f"| {row['points']} | {row['observations']} | {row['track_length']:.2f} "
                f"| {row['seconds']:.1f} |"
            )
    lines += ["", "## Extremes: 2 cameras of 320x240 at 4 places", "", "| session | outcome |", "|---|---|"]
    lines += [f"| {row['case']} | {row['outcome']} |" for row in result["extremes"]]
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    rows = Rows(WORK / "calibration.jsonl")
    names = list(extreme_trials.cases())
    if options.quick:
        names = [name for name in names if name.startswith(("all", "ChArUco"))]
    quick = options.quick
    result: dict[str, Any] = {
        "machine": machine(),
        "board": board(rows, 2 if quick else 12, 0 if quick else 4),
        "scene": {} if quick else scene(rows, SESSIONS),
        "sceaux": None if quick else sceaux(rows),
        "extremes": extremes(rows, names),
    }
    deliver(options, "calibration", result, table(result))


if __name__ == "__main__":
    main()
