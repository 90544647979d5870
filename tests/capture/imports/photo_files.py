"""Photographs with EXIF, made to measure, and what an import made of them."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from imaging.files.photo import encode_jpeg
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.session import Session

NOON = datetime(2026, 5, 1, 12, 0, 0)
T = 1 / 60
"""Seconds of an exposure like any other."""


def metadata(time=None, at=0.0, serial="", model="M1", f_number=4.0, make="Maker"):
    exposure = None if time is None else Exposure(time=time, f_number=f_number, iso=100)
    when = None if at is None else NOON + timedelta(seconds=at)
    return FrameMetadata(make=make, model=model, serial=serial, exposure=exposure, captured_at=when)


def jpeg(seed=0, size=(24, 32), **said) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)
    return encode_jpeg(pixels, metadata=metadata(**said) if said else None)


def dng(seed=0, size=(24, 32), **said) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 4096, size, dtype=np.uint16)
    return encode_dng(RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095, metadata=metadata(**said)))


def put(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def sources(session: Session) -> dict[tuple[int, str, int], str]:
    return {(s.frame, s.camera, s.step): Path(s.source).name for s in session.shots()}
