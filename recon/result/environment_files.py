"""The environment of a scene for other programs: a map as EXR, and a sphere of Gaussians for viewers."""

import math
from pathlib import Path

import numpy as np
import torch

from imaging.arrays import Array
from imaging.files import store
from imaging.files.exr.writing import white_luminance, write_exr
from recon.result.model import ENVIRONMENT
from recon.scene.appearance import Appearance
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians
from recon.train.training import Training

LAYOUT = (
    "latitude and longitude as OpenEXR has them: the middle of the picture is longitude 0, its left end 180 "
    "degrees, its uppermost row latitude 90; vectors are in world axes"
)
DOME = 50.0
"""Radius of the sphere in units of the scene, in which the subject is about 1 away."""
FEWEST, MOST = 2000, 20_000
"""Gaussians of the sphere; between, a third of those of the scene."""
OVERLAP = 0.6
"""Standard deviation of a Gaussian over the distance to its neighbours, as training starts with."""


def write_environment(
    folder: Path, training: Training, gauge: str, luminance: tuple[float, float] | None
) -> None:
    """environment.exr: linear Rec.709 radiance in the units of the calibration; none without environment."""
    far = training.environment
    if far is None:
        store.discard(folder / ENVIRONMENT)
        return
    with torch.no_grad():
        units = training.method.observation.radiance(far.ln_light.detach().cpu().exp().movedim(0, 2))
    right, up, middle = (" ".join(f"{part:.9g}" for part in axis) for axis in far.axes)
    write_exr(
        folder / ENVIRONMENT,
        units.float().numpy(),
        attributes={
            **({} if luminance is None else white_luminance(*luminance)),
            "rig:values": f"linear radiance relative to {gauge}",
            "rig:layout": LAYOUT,
            "rig:up": up,
            "rig:middle": middle,
            "rig:longitude90": right,
        },
    )


def dome_of(far: Environment, appearance: Appearance, gaussians: int) -> Gaussians:
    """Round, opaque Gaussians evenly on a sphere about the scene's origin, of the light behind them."""
    count = int(np.clip(gaussians // 3, FEWEST, MOST))
    directions = evenly(count)
    with torch.no_grad():
        light = far.light(torch.from_numpy(directions @ far.axes.T).to(far.ln_light)).float().cpu()
    spacing = DOME * math.sqrt(4 * math.pi / count)
    quats = torch.zeros(count, 4)
    quats[:, 0] = 1
    return Gaussians(
        {
            "means": torch.from_numpy((DOME * directions).astype(np.float32)),
            "log_scales": torch.full((count, 3), math.log(OVERLAP * spacing)),
            "quats": quats,
            "opacity_logits": torch.full((count,), 6.0),
            **appearance.start(light),
        }
    )


def evenly(count: int) -> Array:
    """Unit vectors [count, 3] evenly over the sphere, on a spiral in steps of the golden angle."""
    height = 1 - 2 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], 1)
