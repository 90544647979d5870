"""Photographs of path-traced light: RAW brackets and JPEGs of a camera that is no one's, as a session."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

from imaging.arrays import Array32, Bytes
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session

GAIN, READ, WELL, BLACK = 0.35, 3.5, 10_000.0, 512
"""DN per electron, electrons of read noise, electrons at saturation, DN at no light."""
TIMES = (1 / 500, 1 / 30, 1 / 2)
"""Seconds of a bracket."""


def raw(light: Array32, seed: int, times: Sequence[float] = TIMES) -> list[tuple[RawMosaic, Exposure]]:
    """A bracket of radiance [H, W, 3]: shot and read noise, black level, ceiling; 1 saturates in 1/15 s."""
    rng = np.random.default_rng(seed)
    white = BLACK + int(GAIN * WELL)
    span = white - BLACK
    sites = np.empty(light.shape[:2])
    for row, column, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        sites[row::2, column::2] = light[row::2, column::2, channel]
    shots = []
    for time in times:
        electrons = rng.poisson(np.minimum(15 * WELL * sites * time, 2 * WELL))
        read = electrons + READ * rng.standard_normal(sites.shape)
        codes = np.clip(np.rint(BLACK + GAIN * read), 0, white).astype(np.uint16)
        noise = GAIN / span, (GAIN * READ / span) ** 2
        mosaic = RawMosaic(codes, Cfa.RGGB, ((BLACK,),), white, noise_profile=noise)
        shots.append((mosaic, Exposure(time=time)))
    return shots


def jpeg(light: Array32, seed: int, time: float) -> list[tuple[Bytes, Exposure]]:
    """One developed picture: noise, sRGB's curve, 8 bits."""
    rng = np.random.default_rng(seed)
    electrons = rng.poisson(np.minimum(15 * WELL * light * time, WELL)) + READ * rng.standard_normal(
        light.shape
    )
    linear = np.clip(electrons / WELL, 0, 1)
    curve = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return [(np.rint(255 * curve).astype(np.uint8), Exposure(time=time))]


def session(folder: Path, light: Array32, *, developed: bool = False) -> Path:
    """A session of views [V, H, W, 3] by one camera: RAW brackets, or JPEGs of one exposure."""
    kind = "ldr" if developed else "raw"
    camera = CameraRecord(name="cam", serial="1", make="Foreign", model="F1", kind=kind)
    made = Session.create(
        folder, SessionRecord(name="foreign", created=datetime.now(UTC), origin="test", cameras=(camera,))
    )
    time = float(0.18 / 15 / np.median(light))
    for frame, view in enumerate(light):
        shots = jpeg(view, frame, time) if developed else raw(view, frame)
        for step, (image, exposure) in enumerate(shots):
            file = f"raw/{frame:04d}/cam_{step}.{'jpg' if developed else 'dng'}"
            if isinstance(image, RawMosaic):
                store.make_folder((folder / file).parent)
                write_dng(folder / file, image)
                height, width = image.pixels.shape
            else:
                store.write_bytes(folder / file, encode_jpeg(image, 95))
                height, width = image.shape[:2]
            made.append_shot(
                ShotRecord(
                    kind="scene", plan="foreign", camera="cam", frame=frame, step=step, file=file,
                    sha256=store.sha256(folder / file), reported=exposure, width=width, height=height,
                )
            )  # fmt: skip
    return folder


def probe(path: Path) -> Array32:
    """A light probe of a Radiance file: latitude and longitude, [H, W, 3]."""
    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1], np.float32)
