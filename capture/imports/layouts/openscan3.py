"""OpenScan3's project folder: `openscan_project.json`, and a folder for each scan.

`scan01/scan.json` lists the photographs, `scan01/metadata/scan01_001.json` states the angles at which one was
taken: `fi` of the turntable, `theta` of the rotor that carries camera or table, both in degrees
(https://github.com/OpenScan-org/OpenScan3: `models/scan.py`, `controllers/services/projects.py`). Of a focus
stack, `scan01_001_fs01`, only the photograph merged from it is read, `stacked/stacked_scan01_001.jpg`.
"""

import re
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field

from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.layouts.named_files import file_named
from capture.imports.originals import shown
from imaging.errors import InputError
from imaging.files import store
from imaging.record import parse
from imaging.session.turntable import TurntableRecord

FILE = "openscan_project.json"
SPREAD = 0.5
"""Standard error of a stated angle, degrees: that of an ordinary table, since projects state none."""
SAME_THETA = 0.01
"""Degrees to which a rotor that stands still keeps its angle in the files."""
_PHOTO = re.compile(r"(?:stacked_)?scan\d+_(\d+)(_fs\d+)?")
_MOST = 1000
"""Photographs of a scan have numbers below it."""


class _Polar(BaseModel):
    theta: float = Field(allow_inf_nan=False)
    fi: float = Field(ge=-36_000, le=36_000)


class _Scanned(BaseModel):
    polar_coordinates: _Polar


class _Metadata(BaseModel):
    scan_metadata: _Scanned


def is_one(folder: Path) -> bool:
    """Return whether a folder is a project."""
    return (folder / FILE).is_file()


def read(folder: Path) -> Given:
    """The photographs of all scans, and the angles of the table where the rotor stands still in each scan.

    The camera of each scan counts as one of its own, since the rotor places it anew. InputError for a project
    without scans, a record that cannot be read, and a photograph that lies outside of the folder.
    """
    source = folder / FILE
    photos: list[GivenPhoto] = []
    missing: list[str] = []
    stacked = 0
    degrees: dict[int, float] = {}
    thetas: dict[str, list[float]] = {}
    for number, scan in enumerate(_scans(source)):
        inner = folder / scan
        listed = store.read_json(inner / "scan.json")
        names = listed.get("photos") if isinstance(listed, dict) else None
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise InputError(f"{inner / 'scan.json'} has no list of photos: use --layout photos.")
        for name in names:
            path = file_named(folder, f"{scan}/{name}")
            match = _PHOTO.fullmatch(path.stem)
            if match is None or int(match[1]) >= _MOST:
                raise InputError(f"{inner / 'scan.json'} names {name!r}, which has no number: correct it.")
            if match[2] is not None:
                stacked += 1
                continue
            if not path.is_file():
                missing.append(f"{shown(path)} is named in {scan}/scan.json but does not exist")
                continue
            frame = _MOST * number + int(match[1])
            photos.append(GivenPhoto(path, scan, frame=frame))
            polar = _polar(inner / "metadata", path.stem.removeprefix("stacked_"))
            if polar is not None:
                degrees[frame] = polar.fi
                thetas.setdefault(scan, []).append(polar.theta)
    notes = []
    if stacked:
        notes.append(f"{stacked} photos of focus stacks are left out: only those merged from them are read.")
    table = None
    if any(max(angles) - min(angles) > SAME_THETA for angles in thetas.values()):
        notes.append("The rotor moves within a scan, so that the stated angles are not used.")
    elif degrees:
        table = TurntableRecord(reason=FILE, degrees=degrees, spread=SPREAD)
        notes.append(f"The table's angles of {len(degrees)} photos are kept, to {SPREAD} degrees.")
    return Given(
        "openscan3", source, tuple(photos), missing=tuple(missing), notes=tuple(notes), turntable=table
    )


def _scans(source: Path) -> list[str]:
    """Names of the folders of a project's scans, in order."""
    project: Any = store.read_json(source)
    scans = project.get("scans") if isinstance(project, dict) else None
    if not isinstance(scans, dict) or not scans:
        raise InputError(f"{source} has no scans: use --layout photos.")
    try:
        return [f"scan{number:02d}" for number in sorted(int(scan["index"]) for scan in scans.values())]
    except (TypeError, KeyError, ValueError) as error:
        raise InputError(
            f"{source} has a scan without an index: correct it, or use --layout photos."
        ) from error


def _polar(folder: Path, stem: str) -> _Polar | None:
    """Angles of a photograph; of a stack those of its first; None where the project has none."""
    for path in (folder / f"{stem}.json", folder / f"{stem}_fs01.json"):
        if path.is_file():
            return parse(_Metadata, store.read_json(path), path).scan_metadata.polar_coordinates
    return None
