"""The memory and the disk of trainings on hundreds of brackets of a camera's full size.

    python -m bench.real.poses.many_views [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]

Brackets of four RAW exposures of the simulator whose cells are repeated to 4160x3120, 13 megapixels
(`bench/support/enlarged.py`), the 24 views of the demo once or many times over. Copies of a view are links to
its files, also to what 24 views decoded: it is read for each view at each look, but takes the disk once, and
a training's seconds are those of one whose images are decoded. At the width of the preset best. The training
is given 8 GB as the free memory. Each in a process of its own; finished rows are kept in FOLDER, which needs
20 GB of disk.
"""

import argparse
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from bench.real.memory import PEAK, last
from bench.support.enlarged import enlarged, multiplied
from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from recon.data.load import load

FACTOR, SIZE = 13, (4160, 3120)
EXPOSURES = 4
TRAININGS = ((24, 1280), (504, 1280))
"""Views, and the width that is trained at, px."""
GAUSSIANS, ITERATIONS = 100_000, 60
ROOM = 8_000_000_000
"""Bytes."""
_TRAINING = f"""
import json, sys, time
from pathlib import Path
import recon.decide.cost.memory_need as deciding
import recon.reconstruct as stage
from recon.decide.request import TrainingRequest
from imaging.compute import memory
from recon.decide.cost.memory_need import need
from recon.decide.overrides import Overrides
{PEAK}
session, width, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
memory.available = lambda: {ROOM} - memory.resident()
needs = []
deciding.need = lambda *views, **how: needs.append(need(*views, **how)) or needs[-1]
overrides = Overrides(
    width=width, gaussians={GAUSSIANS}, iterations={ITERATIONS}, refine="none", environment=False
)
request = TrainingRequest(
    quality="best", overrides=overrides, seed=seed, name="memory", replace=True
)
stage.reconstruct(session, request, shelf="memory")
stored = sum(file.stat().st_size for file in Path(session, "decoded").rglob("*.npz"))
print(json.dumps(dict(
    forecast=needs[-1].total, gaussians=needs[-1].gaussians, peak=status("VmHWM"), stored=stored,
    seconds=time.process_time(),
)))
"""


def session_of(work: Path, views: int) -> Path:
    """Make a calibrated session of that many views of full size."""
    once = enlarged(oracle_session(work / "demo"), work / "full-size", FACTOR, exposures=EXPOSURES)
    return multiplied(once, work / f"full-size-{views}", views // 24)


def decoded(work: Path, views: int) -> Path:
    """Return the decoded files of a session of that many views."""
    return work / f"full-size-{views}" / "decoded"


def link_decoded(work: Path, views: int, width: int) -> None:
    """Link the decoded files of the session of 24 views, at a width, to a session of many views.

    The name of a decoded file has size and time of the photograph's, which links have in common.
    """
    place = f"{width} px"
    load(session_of(work, 24), max_width=width, examine=lambda firsts, counts: True)
    frames = 1 + max(shot.frame for shot in Session.open(work / "full-size").shots("scene"))
    for shot in Session.open(work / f"full-size-{views}").shots("scene"):
        first = str(ViewId(shot.frame % frames, shot.camera))
        source = decoded(work, 24) / place / shot.file.replace(str(ViewId(shot.frame, shot.camera)), first)
        folder = decoded(work, views) / place / shot.file
        folder.mkdir(parents=True, exist_ok=True)
        for cached in source.glob("*.npz"):
            (folder / cached.name).hardlink_to(cached)


def measured(work: Path, views: int, width: int, seed: int) -> dict[str, Any]:
    """Figures of a training."""
    session = session_of(work, views)
    if views > 24:
        link_decoded(work, views, width)
    row = last(_TRAINING, session, width, seed)
    if views > 24:
        shutil.rmtree(session / "decoded", ignore_errors=True)
    return row


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "many-views.jsonl")
    rows = []
    for views, width in TRAININGS[:1] if options.quick else TRAININGS:
        for seed in range(options.seeds):
            row = cache.get(f"{views} {width} {seed}", partial(measured, options.work, views, width, seed))
            rows.append({"views": views, "width": width} | row)
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Hundreds of brackets of full size",
        "",
        f"`python -m bench.real.poses.many_views --write`: views of {EXPOSURES} RAW exposures of "
        f"{SIZE[0]}x{SIZE[1]}, {GAUSSIANS:,} Gaussians, {ITERATIONS} iterations, 8 GB of memory said to be "
        f"free. {words(result['machine'])}.",
        "",
        "| views | files, gigapixels | trained at, px | forecast, GB | peak, GB | of it Gaussians, GB "
        "| decoded on the disk, GB | processor s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        pixels = row["views"] * EXPOSURES * SIZE[0] * SIZE[1]
        numbers = [row[key] / 1e9 for key in ("forecast", "peak", "gaussians", "stored")]
        lines.append(
            f"| {row['views']} | {pixels / 1e9:.1f} | {row['width']:,} "
            f"| {' | '.join(f'{one:.2f}' for one in numbers)} | {row['seconds']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__, seeds=1).parse_args()
    result = measure(options)
    deliver(options, "many_views", result, report(result))


if __name__ == "__main__":
    main()
