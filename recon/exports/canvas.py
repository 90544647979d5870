# mypy: allow-untyped-defs, allow-untyped-calls
"""Canvases of viewers: Gaussians of display values, painted from back to front in steps of 8 bits.

As PlayCanvas 2.23 and Spark 2.2 paint them, by their shaders and by pictures of their canvases
(`tests/foreign_viewers/`). Beside the blur (`recon/result/splats/viewers.py`) they differ from `rig` in the
order of layers, in the falloff, and in that each layer is rounded.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch

from imaging.arrays import Array
from imaging.compute.jit import kernel
from recon.exports.splats import Splats
from recon.result.splats.viewers import PLAYCANVAS_BLUR, SPARK_BLUR
from recon.scene.appearance import PlainHarmonics
from recon.splat import SplatCamera
from recon.splat.reference import rotation_matrices

_REACH = 8.0
"""Squared distance from the middle, in standard deviations, at which both stop."""
_RIM = math.exp(-_REACH / 2)
_NEAR = 0.01


@dataclass(frozen=True)
class Manner:
    """blur: variance, px^2, that is added to a Gaussian's. thinned: its opacity makes up for the blur.
    radial: layers are ordered by their distance from the camera, not along its axis. fading: the falloff is
    stretched to end at 0. least: alpha below which nothing is painted.
    """

    blur: float
    thinned: bool
    radial: bool
    fading: bool
    least: float


PLAYCANVAS = Manner(PLAYCANVAS_BLUR, thinned=False, radial=False, fading=True, least=1 / 255)
SPARK = Manner(SPARK_BLUR, thinned=True, radial=True, fading=False, least=0.5 / 255)


def manners_of(end: float) -> tuple[Manner, ...]:
    """Those of viewers of colours that go up to `end`: above 1 that of PlayCanvas alone."""
    return (PLAYCANVAS,) if end > 1 else (PLAYCANVAS, SPARK)


def canvas(splats: Splats, camera: SplatCamera, manner: Manner) -> Array:
    """Codes [H, W, 3], steps of 1/255 up to `splats.end`, that a viewer paints of display values over black.

    camera: a pinhole in the coordinates of the scene.
    """
    gaussians = splats.gaussians()
    parameters = gaussians.parameters
    pose = camera.cam_from_world
    at = parameters["means"].double().numpy() @ pose[:3, :3].T + pose[:3, 3]
    distance = np.linalg.norm(at, axis=1) if manner.radial else at[:, 2]
    order = np.argsort(-distance, kind="stable")
    order = order[at[order, 2] > _NEAR]
    x, y, z = at[order].T
    turns = rotation_matrices(parameters["quats"].double()).numpy()[order]
    lens = np.zeros((len(order), 2, 3))
    lens[:, 0, 0], lens[:, 0, 2] = camera.fx / z, -camera.fx * x / z**2
    lens[:, 1, 1], lens[:, 1, 2] = camera.fy / z, -camera.fy * y / z**2
    root = lens @ pose[:3, :3] @ turns * gaussians.scales().double().numpy()[order, None]
    across, down = (root**2).sum(2).T + manner.blur
    skew = (root[:, 0] * root[:, 1]).sum(1)
    # A difference of products would lose the digits of needles.
    sharp = (np.cross(root[:, 0], root[:, 1]) ** 2).sum(1)
    area = sharp + manner.blur * (across + down) - manner.blur**2
    opacities = gaussians.opacities().double().numpy()[order]
    if manner.thinned:
        opacities = opacities * np.sqrt(sharp / area)
    directions = torch.from_numpy(at @ pose[:3, :3])
    directions = (directions / directions.norm(dim=1, keepdim=True).clamp_min(1e-12)).float()
    colours = PlainHarmonics().colours(parameters, directions, min(splats.degree, 2)).double().numpy()[order]
    places = np.column_stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy])
    forms = np.column_stack([across, skew, down, area])
    image = np.zeros((camera.height, camera.width, 3))
    rim = _RIM if manner.fading else 0.0
    _paint(places, forms, opacities, colours.clip(0, splats.end), rim, manner.least, splats.end, image)
    return image


@kernel
def _paint(places, forms, opacities, colours, rim, least, end, image):
    """Paint ellipses over an image, each rounded to 1/255 and clipped; rim: falloff that counts as 0."""
    height, width, _ = image.shape
    for i in range(len(places)):
        x, y = places[i]
        across, skew, down, area = forms[i]
        wide, high = math.sqrt(_REACH * across), math.sqrt(_REACH * down)
        for row in range(max(0, int(y - high)), min(height, int(y + high) + 1)):
            v = row + 0.5 - y
            for column in range(max(0, int(x - wide)), min(width, int(x + wide) + 1)):
                u = column + 0.5 - x
                squared = (down * u * u - 2 * skew * u * v + across * v * v) / area
                if squared > _REACH:
                    continue
                alpha = opacities[i] * (math.exp(-0.5 * squared) - rim) / (1 - rim)
                if alpha < least:
                    continue
                for k in range(3):
                    value = colours[i, k] * alpha + image[row, column, k] * (1 - alpha)
                    image[row, column, k] = min(end, math.floor(255 * value + 0.5) / 255)
