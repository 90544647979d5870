"""A wall of seven known radiances, as a scene: flat opaque Gaussians, side by side.

Before it there may be a veil of half-transparent ones, which viewers blend in their own way.
"""

import math
from pathlib import Path

import numpy as np
import torch

from imaging.arrays import Array
from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from recon.data.world import WorldTransform
from recon.result.model import CHECKPOINT, MODEL, SceneView, read_model
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.checkpoint import Checkpoint, write_checkpoint
from recon.splat import SplatCamera
from tests.recon.exports.made_scene import write_made

RADIANCES = (0.01, 0.05, 0.18, 0.5, 1.0, 4.0, 16.0)
"""From left to right: white is 1."""
TINT = (1.0, 0.5, 0.25)
"""Colour of the lower half, against that of the upper one."""
ACROSS, DOWN = 12, 15
"""Gaussians of a strip."""
SIZE = 1 / ACROSS
"""Distance of Gaussians, which are that large: a strip is 1 wide, the wall 7 by 1.25."""
THICK = 0.1
"""Half of its thickness, so that all viewers draw its Gaussians in one order."""
AWAY = 5.0
WIDTH, HEIGHT, FOCAL = 280, 60, 200.0
"""A strip is 40 px wide in the picture from the front."""


VEIL = 120
"""Gaussians of the veil, of radiances from 0.02 to 1."""


def write_wall(folder: Path, *, veil: bool = False) -> Path:
    """The folder of the scene."""
    x = (np.arange(len(RADIANCES) * ACROSS) + 0.5) * SIZE - len(RADIANCES) / 2
    y = (np.arange(DOWN) + 0.5) * SIZE - DOWN * SIZE / 2
    across, down = (part.ravel() for part in np.meshgrid(x, y))
    count = len(across)
    strip = np.floor(across + len(RADIANCES) / 2).astype(int)
    light = np.array(RADIANCES)[strip][:, None] * np.where(down[:, None] > 0, TINT, 1.0)
    tensors = {
        "means": np.column_stack([across, down, np.random.default_rng(1).uniform(-THICK, THICK, count)]),
        "log_scales": np.log(np.tile([0.9 * SIZE, 0.9 * SIZE, 0.001], (count, 1))),
        "quats": np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        "opacity_logits": np.full(count, 12.0),
    }
    if veil:
        rng = np.random.default_rng(0)
        before = {
            "means": rng.uniform((-3.5, -0.6, -1.0), (3.5, 0.6, -0.2), (VEIL, 3)),
            "log_scales": rng.uniform(-4.0, -2.0, (VEIL, 3)),
            "quats": rng.normal(size=(VEIL, 4)),
            "opacity_logits": rng.normal(0, 1, VEIL),
        }
        tensors = {name: np.concatenate([values, before[name]]) for name, values in tensors.items()}
        light = np.concatenate([light, 2.0 ** rng.uniform(-5.6, 0, (VEIL, 3))])
        count += VEIL
    write_made(folder, count=count, bent=False)
    parts = {name: torch.from_numpy(value.astype(np.float32)) for name, value in tensors.items()}
    parts |= LuminanceChromaticity().start(torch.from_numpy(light.astype(np.float32)))
    write_checkpoint(
        folder / CHECKPOINT, Checkpoint({f"gaussians.{name}": value for name, value in parts.items()}, {})
    )
    record = read_model(folder).model_copy(
        update={
            "normaliser": 1.0,
            "exposure": 1.0,
            "iterations": 300,
            "luminance": None,
            "world": WorldTransform(origin=(0.0, 0.0, 0.0), unit=1.0),
            "gaussians": count,
            "views": tuple(_view(frame, angle) for frame, angle in enumerate((0.0, -0.2, 0.2, -0.1, 0.1))),
        }
    )
    store.write_json(folder / MODEL, record.model_dump(mode="json"))
    return folder


def front() -> SplatCamera:
    """The camera before the middle of the wall."""
    return _view(0, 0.0).splat_camera


def strips(codes: Array) -> tuple[Array, Array]:
    """Mean of the middles of the strips of a picture from the front, [7, 3] each: upper and lower half."""
    wide = WIDTH // len(RADIANCES)
    boxes = codes.reshape(HEIGHT, len(RADIANCES), wide, 3)[:, :, wide // 3 : -(wide // 3)]
    upper, lower = boxes[12:25], boxes[-25:-12]
    return upper.mean((0, 2)), lower.mean((0, 2))


def _view(frame: int, angle: float) -> SceneView:
    """Turned about the middle of the wall."""
    return SceneView(
        camera="front",
        frame=frame,
        use="training",
        lens=Lens(
            model="OPENCV", width=WIDTH, height=HEIGHT, fx=FOCAL, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2
        ),
        cam_from_world=Pose(
            quaternion=(math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0), translation=(0.0, 0.0, AWAY)
        ),
        shots=(),
    )
