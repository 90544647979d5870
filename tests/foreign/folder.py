"""Photographs of foreign light as a user has them: files in a folder, from a camera that is no one's."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32, Bytes
from imaging.colour.spaces import REC709_FROM_XYZ
from imaging.files.photo import encode_jpeg
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic, as_matrix

CAMERA_FROM_REC709 = np.array([[0.42, 0.21, 0.03], [0.17, 0.72, 0.11], [0.03, 0.19, 0.44]])
"""Rows of red, green, blue: a sensor that sees less red and blue than green, and none of them pure."""
BEGAN = datetime(2024, 5, 17, 10, 0, 0)


@dataclass(frozen=True)
class Body:
    """A camera. bits: of its converter; well: electrons at the ceiling; read: electrons of noise.

    headroom: share of the codes between the ceiling and the white level that its files state. seconds: in
    which light of 1 (green) fills the well. labels: by how much its times differ from what EXIF says, as a
    standard deviation, of every time that it can be set to; a hundredth of it comes anew with every shot.
    """

    bits: int = 14
    well: float = 12_000.0
    read: float = 3.0
    headroom: float = 0.0
    seconds: float = 2.0
    labels: float = 0.04
    black: int = 512
    seed: int = 0

    @property
    def white(self) -> int:
        """DN, as the files state it."""
        return int(2**self.bits - 1)

    def applied(self, label: float, rng: np.random.Generator) -> float:
        """Seconds that the shutter was open."""
        of_label = np.random.default_rng([self.seed, round(1e6 * label)])
        return float(
            label * np.exp(self.labels * (of_label.standard_normal() + 0.01 * rng.standard_normal()))
        )

    def mosaic(self, light: Array32, seconds: float, rng: np.random.Generator) -> RawMosaic:
        """A RAW frame of radiance [H, W, 3]: shot and read noise, black, ceiling."""
        in_camera = light.astype(np.float64) @ CAMERA_FROM_REC709.T
        sites = in_camera[..., 1].copy()
        sites[0::2, 0::2], sites[1::2, 1::2] = in_camera[0::2, 0::2, 0], in_camera[1::2, 1::2, 2]
        full = (self.white - self.black) * (1 - self.headroom)
        electrons = rng.poisson(np.minimum(self.well * sites * seconds / self.seconds, 3 * self.well))
        codes = electrons + self.read * rng.standard_normal(sites.shape)
        codes = np.clip(np.rint(self.black + codes * full / self.well), 0, round(self.black + full))
        gain = full / self.well / (self.white - self.black)
        neutral = CAMERA_FROM_REC709.sum(1) / CAMERA_FROM_REC709.sum(1).max()
        return RawMosaic(
            codes.astype(np.uint16),
            Cfa.RGGB,
            ((self.black,),),
            self.white,
            neutral=(float(neutral[0]), float(neutral[1]), float(neutral[2])),
            camera_from_xyz=as_matrix(CAMERA_FROM_REC709 @ REC709_FROM_XYZ),
            noise_profile=(gain, (gain * self.read) ** 2),
        )

    def developed(self, light: Array32, seconds: float, rng: np.random.Generator) -> Bytes:
        """A JPEG's codes of radiance [H, W, 3]: noise, and a curve that is not sRGB's."""
        electrons = rng.poisson(np.minimum(self.well * light * seconds / self.seconds, 3 * self.well))
        signal = (electrons + self.read * rng.standard_normal(light.shape)) / self.well
        return np.rint(255 * s_curve(np.clip(signal, 0, 1))).astype(np.uint8)


def s_curve(signal: npt.ArrayLike) -> Array:
    """Codes 0..1 of signal 0..1: a toe, a shoulder, and a steeper middle than sRGB's."""
    root = np.asarray(signal, np.float64) ** (1 / 2.1)
    return np.asarray(root + 0.25 * root * (1 - root) * (2 * root - 1))


@dataclass(frozen=True)
class Shots:
    """Photographs. seconds: by file name, of the open shutter; labels: as EXIF has it."""

    folder: Path
    seconds: dict[str, float] = field(default_factory=dict)
    labels: dict[str, float] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)


def photograph(
    folder: Path, light: Array32, body: Body, times: Sequence[Sequence[float]], *, developed: bool = False
) -> Shots:
    """Files of views [V, H, W, 3] as DNG, or JPEG, in a new folder.

    times: EXIF's seconds of the shots of each view; if there are fewer lists than views they begin again.
    """
    folder.mkdir(parents=True)
    shots, moment = Shots(folder), BEGAN
    for frame, view in enumerate(light):
        for label in times[frame % len(times)]:
            number = len(shots.seconds)
            rng = np.random.default_rng([body.seed, number])
            seconds = body.applied(label, rng)
            metadata = FrameMetadata(
                "Foreign", "F1", "4711", Exposure(time=label, f_number=8.0, iso=100.0), moment
            )
            path = folder / f"IMG_{number:04d}.{'jpg' if developed else 'dng'}"
            if developed:
                path.write_bytes(encode_jpeg(body.developed(view, seconds, rng), 95, metadata))
            else:
                write_dng(path, replace(body.mosaic(view, seconds, rng), metadata=metadata))
            shots.seconds[path.name], shots.labels[path.name] = seconds, label
            shots.frames[path.name] = frame
            moment += timedelta(seconds=1 + label)
        moment += timedelta(minutes=1)
    return shots


def tell_poses(shots: Shots, poses: Array, focal: float, size: tuple[int, int], points: Array) -> None:
    """Write the true poses and lens, and points [P, 3], beside the photographs as nerfstudio has them."""
    width, height = size
    frames = [
        {
            "file_path": name,
            "transform_matrix": (np.linalg.inv(poses[frame]) @ np.diag([1.0, -1.0, -1.0, 1.0])).tolist(),
        }
        for name, frame in shots.frames.items()
    ]
    lens = {"fl_x": focal, "fl_y": focal, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
    transforms = {"camera_model": "PINHOLE", **lens, "ply_file_path": "points.ply", "frames": frames}
    (shots.folder / "transforms.json").write_text(json.dumps(transforms))
    head = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    head += [f"property float {axis}" for axis in "xyz"] + ["end_header"]
    rows = [" ".join(f"{value:.5f}" for value in point) for point in points]
    (shots.folder / "points.ply").write_text("\n".join([*head, *rows, ""]))
