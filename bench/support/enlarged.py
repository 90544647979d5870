"""Simulated sessions with the pixels of real cameras: every pixel, or cell of a mosaic, repeated.

What they show is no sharper for it; they take the memory, the disk and the seconds of files of their size.
"""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from imaging.files import store
from imaging.files.photo import decode_codes, encode_jpeg
from imaging.files.raw import is_raw, read_raw
from imaging.files.tiff.dng import write_dng
from imaging.optics.lens import Lens
from imaging.session.session import Session
from imaging.session.view_id import ViewId

Value = TypeVar("Value", bound=np.generic)


def enlarged(session: Path, folder: Path, factor: int, *, exposures: int | None = None) -> Path:
    """Copy a calibrated session, `factor` times as wide, unless the copy exists.

    exposures: of each bracket, the first ones; None: all.
    """
    if (folder / "calibration" / "calibration.json").exists():
        return folder
    excluded = shutil.ignore_patterns("truth", "reconstructions", "decoded")
    shutil.copytree(session, folder, ignore=excluded, dirs_exist_ok=True)
    shots = []
    for shot in Session.open(session).shots("scene"):
        if exposures is not None and shot.step >= exposures:
            continue
        path = folder / shot.file
        if is_raw(path):
            raw = read_raw(path)
            cell = (1, 1) if raw.cfa is None else raw.cfa.period
            write_dng(path, replace(raw, pixels=_repeated(raw.pixels, cell, factor)))
        else:
            codes = _repeated(decode_codes(path.read_bytes(), path.name), (1, 1), factor)
            store.write_bytes(path, encode_jpeg(codes, quality=95))
        size = {"width": factor * shot.width, "height": factor * shot.height}
        shots.append(shot.model_copy(update=size | {"sha256": store.sha256(path)}))
    (folder / "shots.jsonl").write_text(
        "".join(f"{shot.model_dump_json(exclude_none=True)}\n" for shot in shots)
    )
    place = folder / "calibration" / "calibration.json"
    record = store.read_json(place)
    for camera in record["cameras"]:
        lens = Lens.model_validate(camera["lens"])
        larger = lens.resized(factor * lens.width, factor * lens.height)
        camera["lens"] = larger.model_dump(mode="json")
    store.write_json(place, record)
    return folder


def _repeated(pixels: npt.NDArray[Value], cell: tuple[int, int], factor: int) -> npt.NDArray[Value]:
    """Pixels [H, W, ...], each cell of them `factor` times along both axes."""
    for axis, length in enumerate(cell):
        side = pixels.shape[axis]
        cells = np.arange(side).reshape(-1, length)
        pixels = pixels.take(np.repeat(cells, factor, axis=0).reshape(-1), axis)
    return pixels


def multiplied(session: Path, folder: Path, times: int) -> Path:
    """Copy a calibrated session with each frame repeated, its files linked, unless the copy exists.

    No view of it shows anything new: it costs a training as much as that many views.
    """
    if (folder / "calibration" / "calibration.json").exists():
        return folder
    excluded = shutil.ignore_patterns("raw", "reconstructions", "decoded")
    shutil.copytree(session, folder, ignore=excluded, dirs_exist_ok=True)
    shots = Session.open(session).shots("scene")
    frames = 1 + max(shot.frame for shot in shots)
    more = []
    for turn in range(times):
        for shot in shots:
            frame = shot.frame + turn * frames
            view = str(ViewId(frame, shot.camera))
            path = shot.file.replace(str(ViewId(shot.frame, shot.camera)), view)
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).hardlink_to(session / shot.file)
            more.append(shot.model_copy(update={"frame": frame, "file": path}))
    (folder / "shots.jsonl").write_text(
        "".join(f"{shot.model_dump_json(exclude_none=True)}\n" for shot in more)
    )
    place = folder / "calibration" / "calibration.json"
    record = store.read_json(place)
    record["views"] = [
        view | {"frame": view["frame"] + turn * frames} for turn in range(times) for view in record["views"]
    ]
    record["shots_sha256"] = store.sha256(folder / "shots.jsonl")
    store.write_json(place, record)
    return folder
