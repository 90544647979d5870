"""Noisy mosaics of a phone at night, of a scene whose light is known: many views to train on, some to test.

One exposure a view, in which nothing clips: what is brighter than half of white counts as that bright.
 Sensor: 12 bits, black 528, the noise that an iPhone X states at ISO 2000 in RawNeRF's
data set; shot noise is Poisson's, read noise Gaussian. The median of the scene's green is 1 % of white.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from bench.support.hdr_nerf_scene import RADIUS
from drivers.sim.mounting import look_at
from drivers.sim.scene.tabletop import TARGET, demo_scene
from imaging.arrays import Array, Array32
from imaging.files.colmap import SparsePoints
from imaging.merge.linear_frame import SensorSignalNoise
from imaging.optics.lens import Lens
from imaging.sensor.cfa import Cfa, mosaic
from imaging.session.calibration import CalibrationRecord, Response
from recon.data.dataset import Dataset, Sensor, View
from recon.data.light import radiance_image
from recon.data.shot import HeldPlanes, Shot
from recon.measure.protocols.rawnerf import Reference
from recon.splat import SplatCamera
from recon.start.initialisation import start_points

NOISE = SensorSignalNoise(1.690e-4, 3.223e-6)
BLACK, WHITE = 528, 4095
LEVEL = 0.01
"""Signal at which the median of green lies."""
BRIGHTEST = 0.5
NEUTRAL = (0.55, 1.0, 0.65)
"""Camera RGB of white."""
TESTED = 6
POINTS = 1500
WIDTH, HEIGHT, FOCAL = 160, 120, 150.0
_EVEN = np.ones((HEIGHT, WIDTH), np.float32)
_LINEAR = Response(kind="linear", evidence="the truth")
PHONE = Sensor("raw", Cfa.RGGB, np.diag(NEUTRAL), _EVEN, _LINEAR)
LIGHT = Sensor("hdr", None, np.eye(3), _EVEN, _LINEAR)


@dataclass(frozen=True, eq=False)
class PhoneViews:
    """Views of a telephone. dataset: all training views, nothing held out. cameras and references: of the
    tested views, in a row.

    `points` are those of a plane sweep through the true light of every third training view, in place of those
    that structure from motion finds in a whole set.
    """

    dataset: "PosedViews"
    cameras: list[SplatCamera]
    references: list[Reference]

    def of(self, count: int) -> Dataset:
        """Make a data set of that many training views, evenly chosen."""
        views = self.dataset.train
        places = np.rint(np.linspace(0, len(views) - 1, count)).astype(int)
        return replace(self.dataset, train=tuple(views[place] for place in places))


@dataclass(frozen=True, eq=False)
class PosedViews(Dataset):
    """A data set in memory, with its points."""

    sparse: Array | None = None

    def points(self) -> SparsePoints:
        """Points without tracks."""
        xyz = np.zeros((0, 3)) if self.sparse is None else self.sparse
        return SparsePoints(xyz, np.zeros(len(xyz)), np.zeros(len(xyz), np.int64))


def phone_views(work: Path, name: str, seed: int) -> PhoneViews:
    """Views of a scene of `SCENES`; light, places and points are kept in a folder: they take minutes."""
    file = work / f"{name.replace(' ', '-')}-{seed}.npz"
    if not file.exists():
        light, poses, focal = SCENES[name](seed)
        light = np.asarray(
            np.minimum(light * (LEVEL / np.median(light[..., 1][light[..., 1] > 0])), BRIGHTEST), np.float32
        )
        cameras = _cameras(poses, focal)
        clean = [_view(n, cameras[n], LIGHT, _light_shot(light[n])) for n in _trained(len(poses))[::3]]
        start = start_points(
            _dataset(clean, "hdr"),
            [radiance_image(view) for view in clean],
            POINTS,
            np.random.default_rng(seed),
        )
        work.mkdir(parents=True, exist_ok=True)
        np.savez(file, light=light, poses=poses, focal=focal, points=start.xyz)
    with np.load(file) as arrays:
        light, points, cameras = (
            arrays["light"],
            arrays["points"],
            _cameras(arrays["poses"], float(arrays["focal"])),
        )
    signals = [
        np.asarray(mosaic(picture @ PHONE.camera_from_rec709.T, Cfa.RGGB), np.float64)
        for picture in light.astype(np.float64)
    ]
    rng, trained = np.random.default_rng([seed, 0xDA4C]), _trained(len(light))
    views = [_view(n, cameras[n], PHONE, _shot(f"{n:04d}", signals[n], rng)) for n in trained]
    tested = [number for number in range(len(light)) if number not in trained]
    inverse = np.asarray(np.linalg.inv(PHONE.camera_from_rec709), np.float64)
    references = [Reference(signals[n].clip(0, 1).astype(np.float32), Cfa.RGGB, inverse) for n in tested]
    return PhoneViews(_dataset(views, "raw", points), [cameras[number] for number in tested], references)


def _trained(count: int) -> list[int]:
    tested = np.rint(np.linspace(0, count - 1, TESTED + 2)[1:-1]).astype(int)
    return [number for number in range(count) if number not in tested]


def _cameras(poses: Array, focal: float) -> list[SplatCamera]:
    return [SplatCamera(pose, focal, focal, WIDTH / 2, HEIGHT / 2, WIDTH, HEIGHT) for pose in poses]


def _view(number: int, camera: SplatCamera, sensor: Sensor, shot: Shot) -> View:
    return View("phone", number, camera, sensor, (shot,))


def tabletop(seed: int) -> tuple[Array32, Array, float]:
    """The demo's table from a grid of 9 x 6 places; the seed is of where the cameras stand and look."""
    rng, poses = np.random.default_rng([seed, 0x7AB]), []
    for row, up in enumerate(np.linspace(12.0, 40.0, 6)):
        across = np.linspace(-32.0, 32.0, 9)
        for turn in across if row % 2 == 0 else across[::-1]:
            side, height = np.radians(225.0 + turn + rng.uniform(-2, 2)), np.radians(up + rng.uniform(-2, 2))
            away = (np.cos(height) * np.cos(side), np.cos(height) * np.sin(side), np.sin(height))
            eye = TARGET + RADIUS * rng.uniform(0.95, 1.05) * np.array(away)
            poses.append(look_at(eye, TARGET + rng.uniform(-0.08, 0.08, 3)))
    middle = {"cx": WIDTH / 2, "cy": HEIGHT / 2}
    lens = Lens(model="PINHOLE", width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, **middle)
    scene = demo_scene()
    return np.stack([scene.render(lens, pose, 2) for pose in poses]), np.stack(poses), FOCAL


def objects(seed: int) -> tuple[Array32, Array, float]:
    """Crate, metal and glass, path-traced by Mitsuba, seen all around; behind them darkness. Of one seed."""
    from tests.foreign.subjects import objects as foreign

    scene = foreign()
    light = scene.light() * (scene.shown() > 0)[..., None]
    small = np.stack(
        [cv2.resize(picture, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) for picture in light]
    )
    return small, scene.poses, scene.focal * WIDTH / scene.width


SCENES: dict[str, Callable[[int], tuple[Array32, Array, float]]] = {
    "tabletop": tabletop,
    "path-traced objects": objects,
}


def _shot(name: str, signal: Array, rng: np.random.Generator) -> Shot:
    electrons = rng.poisson(signal / NOISE.slope)
    noisy = electrons * NOISE.slope + rng.normal(0, np.sqrt(NOISE.floor), signal.shape)
    codes = np.clip(np.rint(BLACK + noisy * (WHITE - BLACK)), 0, WHITE)
    pixels = np.asarray((codes - BLACK) / (WHITE - BLACK), np.float32)
    never = np.zeros(pixels.shape, bool)
    return Shot(name, 1.0, HeldPlanes(pixels, codes >= WHITE, never, ~never), NOISE, 1.0)


def _light_shot(light: Array32) -> Shot:
    never = np.zeros(light.shape, bool)
    return Shot("light", 1.0, HeldPlanes(light, never, never, ~never))


def _dataset(views: list[View], kind: Literal["raw", "hdr"], points: Array | None = None) -> PosedViews:
    record = CalibrationRecord(
        created=datetime.now(UTC), versions={}, shots_sha256="", cameras=(), views=(), exposure_scale={}
    )
    return PosedViews(Path("memory"), kind, tuple(views), (), record, "", sparse=points)
