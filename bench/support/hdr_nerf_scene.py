"""Scenes of the simulator in the layout of HDR-NeRF's rendered scenes (Huang et al., CVPR 2022).

A grid of views over the demo's table, all facing it; every other one is a training view. Each is exposed
five times, two stops apart, through that data set's curve, and stored as 8-bit PNG; true light as EXR.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.sim.mounting import look_at
from drivers.sim.scene.tabletop import LAMP, TARGET, demo_scene
from imaging.arrays import Array, Floats
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_png
from imaging.optics.lens import Lens

TIMES = (0.125, 0.5, 2.0, 8.0, 32.0)
"""Seconds."""
TOP = 160.0
"""Radiance of the lamp: 20 times unit exposure at the shortest time, 243 codes of 255."""
RADIUS = 2.4
"""m from the middle of the table."""


@dataclass(frozen=True)
class Size:
    """Pixels along a side, and views in a grid of columns and rows."""

    pixels: int
    columns: int
    rows: int

    @property
    def views(self) -> int:
        """Number of views; the paper has 35."""
        return self.columns * self.rows


def curve(log_exposure: Floats) -> Array:
    """Code 0..1 of ln(E t): `sigmoid(x) ^ (1 / 2.2)`, 0.73 at unit exposure."""
    return np.asarray((1 / (1 + np.exp(-np.asarray(log_exposure, np.float64)))) ** (1 / 2.2))


def write_scene(folder: Path, size: Size, seed: int, samples: int = 4) -> None:
    """Write a scene; the seed is of where the cameras stand and look. A scene that is there stays."""
    if folder.exists():
        return
    lens = _lens(size.pixels)
    scene = demo_scene().brightened(TOP / LAMP)
    poses = _poses(size, np.random.default_rng([seed, 0x4DF]))
    with store.replacing(folder) as part:
        for split, members in (("train", poses[::2]), ("test", poses[1::2])):
            frames, times = [], {}
            for number, pose in enumerate(members):
                light = scene.render(lens, pose, samples)
                name = f"./{split}/{number:03d}"
                frames.append({"file_path": name, "transform_matrix": _blender(pose)})
                for step, time in enumerate(TIMES):
                    with np.errstate(divide="ignore"):
                        codes = np.rint(255 * curve(np.log(light.astype(np.float64) * time)))
                    store.write_bytes(part / f"{name}_{step}.png", encode_png(codes.astype(np.uint8)))
                    times[f"{name}_{step}.png"] = time
                write_exr(part / f"{split}_hdr" / f"hdr_{number:03d}.exr", light)
            angle = 2 * math.atan(lens.width / (2 * lens.fx))
            transforms = {"camera_angle_x": angle, "frames": frames}
            store.write_bytes(part / f"transforms_{split}.json", json.dumps(transforms).encode())
            store.write_bytes(part / f"exposure_{split}.json", json.dumps(times).encode())


def _lens(pixels: int) -> Lens:
    half = pixels / 2
    return Lens(model="PINHOLE", width=pixels, height=pixels, fx=pixels, fy=pixels, cx=half, cy=half)


def _poses(size: Size, rng: np.random.Generator) -> list[Array]:
    """cam_from_world of every view, row by row, there and back, so that neighbours are of both splits."""
    poses = []
    for row, up in enumerate(np.linspace(12.0, 36.0, size.rows)):
        across = np.linspace(-24.0, 24.0, size.columns)
        for turn in across if row % 2 == 0 else across[::-1]:
            side, height = np.radians(225.0 + turn + rng.uniform(-1, 1)), np.radians(up + rng.uniform(-1, 1))
            away = (math.cos(height) * math.cos(side), math.cos(height) * math.sin(side), math.sin(height))
            eye = TARGET + RADIUS * rng.uniform(0.97, 1.03) * np.array(away)
            poses.append(look_at(eye, TARGET + rng.uniform(-0.05, 0.05, 3)))
    return poses


def _blender(cam_from_world: Array) -> list[list[float]]:
    """world_from_cam with y up and z back, as Blender has a camera's axes."""
    world_from_cam = np.linalg.inv(cam_from_world) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return [[float(value) for value in row] for row in world_from_cam]
