"""Further features: views that they place, and their seconds, by the share that the usual ones place.

    python -m bench.real.poses.more_features [FOLDER] [--quick] [--json] [--write] [--work FOLDER]

Sets and parts of sets under RIG_DATA, and those of FOLDER (bench/real/poses/untouched.py), are calibrated
up to their poses once by the usual number of SIFT's features and once by more of them. Learned features, an
extra, are not used. Of sets whose views are all placed nothing else is tried, and they have no row. Rows,
features and matches are kept in --work. --quick: every other photograph of the fruit.
"""

import argparse
import shutil
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from bench.calibration.lookalikes.placed import place
from bench.real.poses.judges import photographs
from bench.real.poses.untouched import PHOTOGRAPHS
from bench.support.record import WORK, arguments, deliver, machine, words
from bench.support.spent import processor_seconds
from bench.support.trial import Cache
from calib import place_views, view_images
from calib.data import learned
from calib.data.features import MORE_FEATURES, MOST_FEATURES
from calib.data.unfinished import FOLDER
from calib.poses.resolution import CHECK, DOUBTS
from capture.imports.photos import import_photos

PARTS = {
    "banana": ("::2", "1::2", ":11", "5:", ":"),
    "brighton": ("::2", "::3"),
    "fox": ("::5", "::7"),
    "lund": ("::2", "1::2"),
}
"""Slices of the sets of bench/real/poses/judges.py, of their photographs by name."""
FOREIGN = {"kermit": (":",), "NLE_tower": (":",)}
"""The same of the sets in FOLDER."""


def part_of(photos: Sequence[Path], part: str) -> list[Path]:
    """Return the photographs of a slice that is written as Python writes it."""
    return list(photos[slice(*(int(one) if one else None for one in part.split(":")))])


def session_of(photos: Sequence[Path], folder: Path) -> Path:
    """Import photographs, once."""
    session = folder / "S"
    if not (session / "session.json").exists():
        (folder / "photos").mkdir(parents=True, exist_ok=True)
        for path in photos:
            shutil.copy(path, folder / "photos")
        import_photos(folder / "photos", session)
    return session


def one(photos: Sequence[Path], folder: Path, more: bool) -> dict[str, Any]:
    """Place photographs by the usual number of features, or by more of them alone."""
    session = session_of(photos, folder)
    stack = ExitStack()
    stack.enter_context(patch.object(learned, "available", lambda: False))
    stack.enter_context(patch.object(place_views, "enough_features", lambda _: 10**9))
    if more:
        stack.enter_context(
            patch.object(view_images, "summaries", partial(view_images.summaries, kind="more"))
        )
    shutil.rmtree(session / FOLDER, ignore_errors=True)
    began = processor_seconds()
    placed = place(session, stack)
    model = placed.model
    return {
        "held": 0 if model is None else len(model.poses) - len(model.hanging),
        "placed": len(placed.poses),
        "doubts": placed.taken(CHECK, *DOUBTS),
        "refused": placed.refused,
        "seconds": processor_seconds() - began,
    }


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Rows of each part of which not all views are placed by the usual features."""
    cache, rows = Cache(options.work / "more_features.jsonl"), []
    sets = {"banana": ("::2",)} if options.quick else PARTS
    every = [(name, part, photographs(name)) for name, parts in sets.items() for part in parts]
    for name, parts in FOREIGN.items() if options.folder and not options.quick else ():
        photos = [path for path in (options.folder / name).iterdir() if path.suffix.lower() in PHOTOGRAPHS]
        every += [(name, part, sorted(photos)) for part in parts]
    for name, part, photos in every:
        chosen = part_of(photos, part)
        folder = options.work / f"more-{name}-{part.replace(':', '_')}"
        usual = cache.get(f"{name} {part} usual", partial(one, chosen, folder, False))
        if usual["held"] < len(chosen):
            more = cache.get(f"{name} {part} more", partial(one, chosen, folder, True))
            rows.append({"set": name, "part": part, "photographs": len(chosen), "usual": usual, "more": more})
    rows.sort(key=lambda row: row["usual"]["held"] / row["photographs"])
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    """Markdown."""
    lines = [
        "# Further features",
        "",
        f"`python -m bench.real.poses.more_features FOLDER --write`. {words(result['machine'])}. Processor "
        "seconds to the poses.",
        "",
        f"Views placed by up to {MOST_FEATURES:,} features an image and by up to {MORE_FEATURES:,}; behind "
        "+, those that one pair only holds; doubted: more features would not be taken.",
        "",
        "| set | photographs | of these | share | placed | by more | s | by more, s |",
        "|" + "---|" * 8,
    ]
    for row in result["rows"]:
        usual, more = row["usual"], row["more"]
        share = usual["held"] / row["photographs"]
        cells = [row["set"], f"`[{row['part']}]`", row["photographs"], f"{share:.2f}", _cell(usual)]
        cells += [_cell(more), f"{usual['seconds']:.0f}", f"{more['seconds']:.0f}"]
        lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines) + "\n"


def _cell(row: dict[str, Any]) -> str:
    hanging = row["placed"] - row["held"]
    placed = f"{row['held']} + {hanging}" if hanging else str(row["held"])
    return f"{placed} (doubted)" if row["doubts"] else placed


def main() -> None:
    """Print the table, and keep it with --write."""
    parser = arguments(__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="sets of bench/real/poses/untouched.py")
    parser.add_argument("--work", type=Path, default=WORK / "more_features", help="keeps finished rows")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    result = measure(options)
    deliver(options, "real_more_features", result, table(result))


if __name__ == "__main__":
    main()
