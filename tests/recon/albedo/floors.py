"""Matte floors of known albedo under light that is known in closed form."""

from collections.abc import Sequence

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from imaging.arrays import Array
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from recon.result.model import SceneView
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians
from tests.recon.rendering.scenes import APPEARANCE, sheet, view

WIDE = Lens(model="OPENCV", width=64, height=64, fx=27.0, fy=27.0, cx=32.0, cy=32.0)
"""100 degrees across."""
Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Axes of an environment whose uppermost row is along z."""


def looking(name: str, centre: Sequence[float], target: Sequence[float]) -> SceneView:
    """A training view."""
    ahead = np.subtract(target, centre).astype(float)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1] if abs(ahead[2]) < 0.95 else [0, 1, 0])
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(ahead, right), ahead])
    w, x, y, z = Rotation.from_matrix(turn).as_quat(canonical=True, scalar_first=True).tolist()
    shift = (-turn @ np.asarray(centre, float)).tolist()
    return view(name, Pose(quaternion=(w, x, y, z), translation=tuple(shift)), lens=WIDE)


def around(count: int = 4) -> tuple[SceneView, ...]:
    """Views of the floor from all sides, which see nothing above themselves."""
    turns = 2 * np.pi * np.arange(count) / count
    return tuple(
        looking(f"around{number}", (1.6 * np.cos(turn), 1.6 * np.sin(turn), 1.2), (0, 0, -1))
        for number, turn in enumerate(turns)
    )


def upwards() -> tuple[SceneView, ...]:
    """Views from two places that together see all that is above the floor."""
    targets = ((3, 0, 1.2), (-3, 0, 1.2), (0, 3, 1.2), (0, -3, 1.2), (0.1, 0, 5))
    return tuple(
        looking(f"up{side}_{number}", (0.3 * side, 0.2 * side, 0.6), target)
        for side in (1, -1)
        for number, target in enumerate(targets)
    )


def floor(spacing: float = 0.2) -> Gaussians:
    """A floor of 4 by 4 at z = 0, of light 1."""
    return sheet((0, 0, 0), (2, 0, 0), (0, 2, 0), 1.0, spacing)


def lit(gaussians: Gaussians, light: Array) -> Gaussians:
    """The same with a radiance [N, 3]."""
    return Gaussians(gaussians.parameters | APPEARANCE.start(torch.from_numpy(light).float()))


def sky(light: Sequence[float]) -> Environment:
    """The same light from everywhere."""
    rows = torch.tensor(light, dtype=torch.float32).log()[:, None, None].repeat(1, 16, 32)
    return Environment(rows, Z_UP)


def middle(gaussians: Gaussians, reach: float = 1.5) -> Array:
    """Those near the middle, [N]."""
    return np.asarray(torch.linalg.norm(gaussians.parameters["means"][:, :2], dim=1).numpy() < reach)
