"""Scenes of a few surfaces of Gaussians, opened without training: their depths and normals are known."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from recon.data.world import SAME, WorldTransform
from recon.result.model import ModelRecord, SceneShot, SceneView
from recon.result.scene import Scene
from recon.scene.appearance import LuminanceChromaticity
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians, Renderer, limits_for

APPEARANCE = LuminanceChromaticity()
LENS = Lens(model="OPENCV", width=48, height=36, fx=40.0, fy=40.0, cx=24.0, cy=18.0)
AHEAD = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, 0))


def sheet(
    centre: Sequence[float], right: Sequence[float], down: Sequence[float], light: float, spacing: float
) -> Gaussians:
    """A flat, opaque rectangle of discs, `right` and `down` being half its sides."""
    u, v = np.asarray(right, float), np.asarray(down, float)
    counts = [max(1, round(2 * float(np.linalg.norm(side)) / spacing)) for side in (u, v)]
    a, b = np.meshgrid(*((np.arange(count) + 0.5) / count * 2 - 1 for count in counts))
    means = np.asarray(centre, float) + a.reshape(-1, 1) * u + b.reshape(-1, 1) * v
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    # The turn that takes the z axis, along which the discs are thin, to the normal.
    half = np.array([1 + normal[2], -normal[1], normal[0], 0.0])
    count = len(means)
    return Gaussians(
        {
            "means": torch.from_numpy(means).float(),
            "log_scales": torch.tensor([0.6, 0.6, 0.02]).mul(spacing).log().repeat(count, 1),
            "quats": torch.from_numpy(half).float().repeat(count, 1),
            "opacity_logits": torch.full((count,), 4.0),
            **APPEARANCE.start(torch.full((count, 3), light)),
        }
    )


def view(
    name: str = "cam0", pose: Pose = AHEAD, shots: tuple[SceneShot, ...] = (), lens: Lens = LENS
) -> SceneView:
    return SceneView(
        camera=name, frame=0, use="training", lens=lens, cam_from_world=pose, shots=shots or (shot(),)
    )


def shot(least: float = 0.0, most: float = math.inf) -> SceneShot:
    return SceneShot.model_construct(file="raw/0000/cam0_0.dng", k=1.0, measures=(least, most))


def scene(
    gaussians: Gaussians,
    views: tuple[SceneView, ...] = (),
    world: WorldTransform = SAME,
    environment: Environment | None = None,
) -> Scene:
    record = ModelRecord.model_construct(
        world=world,
        views=views or (view(),),
        display=None,
        normaliser=1.0,
        degree=0,
        bands=(),
        exposure=1.0,
        luminance=None,
        transparent=False,
        radiance="relative to 1",
    )
    return Scene(Path("none"), record, gaussians, Renderer(APPEARANCE, limits_for(1.0), environment))


def axis_of(direction: npt.ArrayLike) -> Array:
    vector = np.asarray(direction, float)
    return vector / np.linalg.norm(vector)
