"""The lines of shots.jsonl, read one by one, so that a damaged line hides no other."""

import json
import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from imaging.errors import InputError
from imaging.record import parse
from imaging.session.records import ShotRecord
from imaging.session.session import Session

DROPS = ": rig check --repair drops it."
"""Fix for a line that is not JSON."""


def read_index(session: Session) -> tuple[list[ShotRecord], list[str]]:
    """Every shot (of two records of one shot the later counts), and a sentence for each damaged line.

    A last line without its end is dropped, as on every opening: its shot was not finished.
    """
    path = session.folder / "shots.jsonl"
    shots: dict[tuple[str, str, int, int], ShotRecord] = {}
    damaged: list[str] = []
    data = path.read_bytes() if path.exists() else b""
    for number, line in enumerate(data.split(b"\n")[:-1], start=1):
        try:
            shot = parse(ShotRecord, json.loads(line), f"shots.jsonl, line {number}")
        except InputError as error:
            damaged.append(str(error))
        except ValueError:
            damaged.append(f"shots.jsonl, line {number} is not JSON{DROPS}")
        else:
            shots[shot.identity] = shot
    return list(shots.values()), damaged


def stray_files(session: Session, shots: list[ShotRecord]) -> list[str]:
    """Files below raw/ that no record names, relative to the session, in order; links are not followed."""
    named = {shot.file for shot in shots} | {shot.developed for shot in shots}
    raw = session.folder / "raw"
    files = [Path(place) / name for place, _, names in os.walk(raw) for name in names]
    relative = sorted(path.relative_to(session.folder).as_posix() for path in files)
    return [name for name in relative if name not in named and not name.endswith(".part")]


def source_names(shots: Sequence[ShotRecord]) -> dict[str, str]:
    """The user's name of each imported file, with its folder where several files have that name."""
    paths = {shot.file: Path(shot.source) for shot in shots if shot.source is not None}
    count = Counter(path.name for path in set(paths.values()))
    return {
        file: path.name if count[path.name] == 1 else f"{path.parent.name}/{path.name}"
        for file, path in paths.items()
    }
