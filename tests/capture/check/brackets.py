"""Brackets of a known scene, rectangles and fine grain over two decades of light, on a simulated sensor."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from capture.pictures.reduced_pictures import ReducedPicture, of_raw
from drivers.sim.camera.response import develop
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor
from imaging.arrays import Array, Bytes
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.files.tiff.dng import encode_dng
from imaging.merge.linear_frame import from_raw
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa, mosaic
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord, ShotRecord
from imaging.session.session import Session
from tests.capture.conftest import WHEN

BLACK, WHITE = 256.0, 4095
SENSOR = SensorModel(0.4, 3.0, 10_300.0, ((BLACK,),), 12, prnu=0.005, dsnu=0.4)
ELECTRONS = (WHITE - BLACK) / SENSOR.gain


def scene(seed: int = 0, height: int = 160, width: int = 240) -> Array:
    """Light [H, W, 3], about 1 at its middle."""
    random = np.random.default_rng(seed)
    light = np.ones((height, width, 3))
    for _ in range(120):
        top, left = random.integers(0, height), random.integers(0, width)
        high, wide = random.integers(4, height // 3), random.integers(4, width // 3)
        light[top : top + high, left : left + wide] = np.exp(random.normal(0, 1.0) + random.normal(0, 0.1, 3))
    grain = cv2.GaussianBlur(random.normal(0, 1, (height, width)), (0, 0), 0.8)
    return light * np.exp(0.3 * grain)[..., None]


def blurred(light: Array, sigma: float) -> Array:
    """Blur as a lens out of focus does."""
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma))


def shifted(light: Array, right: int, down: int) -> Array:
    """Seen by a camera that turned by whole pixels."""
    return np.roll(light, (down, right), axis=(0, 1))


def raw(light: Array, exposure: Exposure, seed: int = 0) -> RawMosaic:
    """A frame; light times the exposure scale is the share of white."""
    height, width = light.shape[:2]
    sensor = SimulatedSensor(SENSOR, width, height, 0, "unit")
    electrons = mosaic(light, Cfa.RGGB) * exposure.scale * ELECTRONS
    noise = np.random.default_rng([seed, int(1e6 * exposure.time)])
    pixels = sensor.expose(electrons, exposure.time, 1.0, noise)
    span, gain = WHITE - BLACK, SENSOR.gain
    profile = (gain / span, ((gain * SENSOR.read_noise) ** 2 + 1 / 12) / span**2)
    metadata = FrameMetadata(serial="unit", exposure=exposure)
    return RawMosaic(pixels, Cfa.RGGB, ((BLACK,),), WHITE, noise_profile=profile, metadata=metadata)


def seen_raw(light: Array, exposure: Exposure, seed: int = 0) -> ReducedPicture:
    """The same as `rig check` sees it."""
    return of_raw(from_raw(raw(light, exposure, seed), 1.0), Cfa.RGGB)


def photo(light: Array, exposure: Exposure, seed: int = 0) -> Bytes:
    """Photograph with a curve that is neither sRGB nor a gamma; codes [H, W, 3]."""
    random = np.random.default_rng([seed, int(1e6 * exposure.time)])
    electrons = random.poisson(np.minimum(light * exposure.scale, 4.0) * 40_000.0)
    return np.rint(255 * develop(electrons / 40_000.0)).astype(np.uint8)


class Studio:
    """A session whose shots are put in one after the other; every camera is of one model."""

    def __init__(self, folder: Path, cameras: Sequence[str], kind: str = "raw") -> None:
        records = tuple(
            CameraRecord.model_validate(
                {"name": name, "serial": name, "make": "M", "model": "1", "kind": kind}
            )
            for name in cameras
        )
        self.folder = folder
        self.kind = kind
        self.cameras = list(cameras)
        self.session = Session.create(
            folder, SessionRecord(name="studio", created=WHEN, origin="test", cameras=records)
        )

    def plan(self, bracket: Sequence[Exposure], frames: int, kind: str = "scene") -> None:
        """Plan of shots of all cameras."""
        fields = {"plan": kind, "kind": kind, "created": WHEN, "bracket": bracket, "reason": "test"}
        self.session.append_plan(
            PlanRecord.model_validate(fields | {"frames": range(frames), "cameras": self.cameras})
        )

    def shoot(
        self,
        camera: str,
        frame: int,
        step: int,
        light: Array,
        exposure: Exposure,
        label: Exposure | None = None,
        kind: str = "scene",
    ) -> str:
        """Expose and record; the file. label: what the file claims, if it is not true."""
        label = label or exposure
        seed = 1000 * self.cameras.index(camera) + 10 * frame + step
        metadata = FrameMetadata(serial=camera, exposure=label)
        if self.kind == "raw":
            data, suffix = encode_dng(replace(raw(light, exposure, seed), metadata=metadata)), "dng"
        else:
            data, suffix = encode_jpeg(photo(light, exposure, seed), 95, metadata), "jpg"
        file = f"raw/{kind}/{frame:04d}/{camera}_{step}.{suffix}"
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        fields = {"kind": kind, "plan": kind, "camera": camera, "frame": frame, "step": step, "file": file}
        size = {"width": light.shape[1], "height": light.shape[0]}
        exposures = {"requested": label, "reported": label, "sha256": store.sha256(path)}
        self.session.append_shot(ShotRecord.model_validate(fields | size | exposures))
        return file
