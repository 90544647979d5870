"""Photographs that are not what they should be, among real ones: what is placed, and what warnings say.

    python -m bench.real.poses.strangers [--quick] [--json] [--write] [--work FOLDER]

Folders as users make them by mistake, of the real sets under RIG_DATA at 640 px: photographs of scenes that
have nothing in common, some of them in a set, one photograph saved several times, noise. A stranger is wrong
where it has a pose in the model of the others and no warning names its file; a set without strangers is a
false alarm where a warning names one of its views. The failures are those of SysCON3D (arXiv 2605.18754).
Learned features, an extra, are not used. Finished rows are kept in FOLDER. --quick: the castle.
"""

import argparse
import io
import shutil
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from PIL import Image

from bench.calibration.lookalikes.placed import PlacedViews
from bench.calibration.lookalikes.placed import place as placement
from bench.real.poses.judges import photographs
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.trial import Cache
from calib.data import learned
from capture.imports.photos import import_photos
from imaging.session.session import Session

LONG_SIDE = 640
SETS = {"sceaux": 11, "banana": 16, "fox": 16, "monstree": 16, "brighton": 10}
"""Photographs at most of each set, evenly from all."""
DRAWS = 3
STRANGERS = 3
COPIES = 6
STRANGER = "stranger"
"""Beginning of the name of a file that does not belong."""
Picture = tuple[str, bytes]
"""Name of a file and its content."""


@dataclass(frozen=True)
class Folder:
    """Photographs in one folder. kind: of its row in the table. belong: photographs of one scene."""

    kind: str
    name: str
    pictures: tuple[Picture, ...]

    @property
    def strangers(self) -> frozenset[str]:
        """Names of the files that do not belong."""
        return frozenset(name for name, _ in self.pictures if name.startswith(STRANGER))


@cache
def small(path: Path, quality: int = 95, *, exif: bool = True) -> bytes:
    """A photograph as JPEG of `LONG_SIDE`."""
    stream = io.BytesIO()
    with Image.open(path) as picture:
        stated = picture.getexif()
        picture.thumbnail((LONG_SIDE, LONG_SIDE), Image.Resampling.LANCZOS)
        picture.convert("RGB").save(stream, "jpeg", quality=quality, **({"exif": stated} if exif else {}))
    return stream.getvalue()


def noise(seed: int) -> bytes:
    """Noise of several sizes of grain, which has many features."""
    rng, total = np.random.default_rng(seed), np.zeros((LONG_SIDE * 3 // 4, LONG_SIDE, 3))
    for grain in (1, 2, 4, 8, 16, 32):
        cells = rng.normal(size=(total.shape[0] // grain, total.shape[1] // grain, 3))
        total += np.repeat(np.repeat(cells, grain, 0), grain, 1)
    stream = io.BytesIO()
    Image.fromarray(np.uint8(np.clip(128 + 25 * total, 0, 255))).save(stream, "jpeg", quality=95)
    return stream.getvalue()


def part_of(name: str) -> list[Path]:
    """Photographs of a set, evenly from all."""
    files = photographs(name)
    return [files[at] for at in np.linspace(0, len(files) - 1, min(SETS[name], len(files))).astype(int)]


def folders(sets: tuple[str, ...]) -> Iterator[Folder]:
    """Everything that is tried, the sets as they are first."""
    pictures_of = {name: tuple((path.name, small(path)) for path in part_of(name)) for name in sets}
    for name in sets:
        yield Folder("as it is", name, pictures_of[name])
    for draw in range(DRAWS):
        picked = [(name, part_of(name)[(7 * draw + 3) % SETS[name]]) for name in SETS]
        for stated in (True, False):
            pictures = [(f"{STRANGER}-{name}.jpg", small(path, exif=stated)) for name, path in picked]
            yield Folder("unrelated", f"draw {draw}, {'with' if stated else 'no'} EXIF", tuple(pictures))
    for name, draw in product(sets, range(DRAWS)):
        others = [other for other in SETS if other != name]
        picked = [(other, part_of(other)[(5 * draw + 2) % SETS[other]]) for other in others[:STRANGERS]]
        strangers = tuple((f"{STRANGER}-{other}.jpg", small(path)) for other, path in picked)
        yield Folder("with strangers", f"{name}, draw {draw}", pictures_of[name] + strangers)
    for name in sets:
        noisy = tuple((f"{STRANGER}-noise-{seed}.jpg", noise(seed)) for seed in range(STRANGERS))
        yield Folder("with noise", name, pictures_of[name] + noisy)
        path = part_of(name)[SETS[name] // 2]
        copies = [(f"{STRANGER}-copy-{at}.jpg", small(path, 95 - 5 * at)) for at in range(COPIES)]
        yield Folder("one photograph, copied", name, tuple(copies))
    yield Folder("noise", "", tuple((f"{STRANGER}-noise-{seed}.jpg", noise(seed)) for seed in range(COPIES)))


def calibrated(folder: Folder, work: Path) -> dict[str, Any]:
    """Import a folder and place its views: how many, strangers among them, and those that warnings name."""
    place = work / "strangers"
    shutil.rmtree(place, ignore_errors=True)
    (place / "photos").mkdir(parents=True)
    for name, content in folder.pictures:
        (place / "photos" / name).write_bytes(content)
    import_photos(place / "photos", place / "S")
    stack = ExitStack()
    stack.enter_context(patch.object(learned, "available", lambda: False))
    placed = placement(place / "S", stack)
    files = Session.open(place / "S").photograph_names()
    return {
        "kind": folder.kind,
        "name": folder.name,
        "photographs": len(folder.pictures),
        "strangers": len(folder.strangers),
        "refused": placed.refused,
        **judged([files[view] for view in placed.poses], reasons(placed)),
    }


def reasons(placed: PlacedViews) -> list[str]:
    """Reasons of the warnings about poses."""
    rungs = () if placed.model is None else placed.model.rungs
    return [rung.reason for rung in rungs if rung.taken and rung.name in placed.doubts]


def judged(names: list[str], warnings: list[str]) -> dict[str, Any]:
    """Sort files of placed views: strangers, those of them that no warning names, others that one names."""
    named = {name for name in names if any(name in warning for warning in warnings)}
    strangers = {name for name in names if name.startswith(STRANGER)}
    return {
        "placed": len(set(names) - strangers),
        "named": sorted(named - strangers),
        "strange": sorted(strangers),
        "wrong": sorted(strangers - named),
        "warnings": warnings,
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each folder."""
    options.work.mkdir(parents=True, exist_ok=True)
    cache, rows = Cache(options.work / "strangers.jsonl"), []
    for folder in folders(("sceaux",) if options.quick else tuple(SETS)):
        rows.append(cache.get(f"{folder.kind}: {folder.name}", partial(calibrated, folder, options.work)))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Photographs that do not belong",
        "",
        f"`python -m bench.real.poses.strangers --write`: real sets at {LONG_SIDE} px. "
        f"{words(result['machine'])}.",
        "",
        "Strangers are photographs of other scenes, noise, or copies of one photograph, which show no depth. "
        "Wrong: strangers that are placed and that no warning names. Named: of the other views.",
        "",
        "| folders | number | refused | belonging | placed | named | strangers | placed | wrong |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(row["kind"] for row in result["rows"]):
        rows = [row for row in result["rows"] if row["kind"] == kind]
        cells = [
            len(rows),
            sum(bool(row["refused"]) for row in rows),
            sum(row["photographs"] - row["strangers"] for row in rows),
            *(sum(row["placed"] for row in rows), sum(len(row["named"]) for row in rows)),
            sum(row["strangers"] for row in rows),
            *(sum(len(row[key]) for row in rows) for key in ("strange", "wrong")),
        ]
        lines.append(f"| {kind} | {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "real_strangers", result, report(result))


if __name__ == "__main__":
    main()
