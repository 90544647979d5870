"""Irradiance at places of a scene: what arrives there over the hemisphere about a normal, drawn and summed.

A hemisphere is one equidistant fisheye, about as fine as the views: of a lamp smaller than a pixel the
Gaussians, which hide each other, would be drawn side by side, and their light counted several times.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch

from imaging.arrays import Array, Mask
from imaging.progress import Progress, unreported
from recon.result.scene import Scene
from recon.splat import SplatCamera, rasterize
from recon.splat.torch_threads import torch_on_one_thread

SIZE = 256
"""Pixels across a hemisphere."""
WIDE = np.radians(85.0)
"""Angle from its axis, radians. A hundredth of an even sky lies beyond, and is taken to be as the rest is."""
RISE = 0.1
"""Sine of the elevation up to which Gaussians belong to the surface itself."""
SMALL = 0.002
"""Share of the hemisphere, by cosine, that a small source fills."""


@dataclass(frozen=True, eq=False)
class Irradiance:
    """Irradiance at M places, in scene units.

    light [M, 3]: integral of radiance times cosine, directions that no view saw taken to be as bright as the
    others are without small sources. filled [M]: share of it that is of those. slope [M]: relative change by
    a tilt of the normal, per radian. unseen [M]: share of directions, by cosine, or of light, whichever is
    larger, that no view saw. small [M]: share of the light that comes from the brightest `SMALL` of
    directions.
    """

    light: Array
    filled: Array
    slope: Array
    unseen: Array
    small: Array


def irradiance_at(
    scene: Scene,
    points: Array,
    normals: Array,
    clearance: Array,
    observed: Mask,
    sky: Mask | None,
    progress: Progress = unreported,
) -> Irradiance:
    """Measure the light that arrives at places.

    Args:
        scene: Scene of linear light of three channels.
        points: [M, 3] on surfaces, scene coordinates.
        normals: [M, 3] unit, scene axes.
        clearance: [M] height up to which Gaussians belong to the surface, scene units.
        observed: [N] Gaussians that views saw and measured.
        sky: [rows, 2 * rows] texels of the environment that views did; None without an environment.
        progress: Callback.

    Returns:
        The irradiance of each place.
    """
    weight, directions = _lens()
    means = scene.gaussians.parameters["means"].detach()
    known = torch.from_numpy(observed)
    light, slope, unseen, small = np.zeros((len(points), 3)), *(np.zeros(len(points)) for _ in range(3))
    brightest = max(1, int(SMALL * SIZE * SIZE))
    for number, (point, normal) in enumerate(zip(points, normals, strict=True)):
        if number % 16 == 0:
            progress("measuring the light that arrives", number, len(points))
        camera = _looking(point, normal)
        away = means - torch.from_numpy(point.astype(np.float32))
        height = away @ torch.from_numpy(normal.astype(np.float32))
        apart = (height > RISE * away.norm(dim=1)) & (height > float(clearance[number]))
        picture, seen_share, unseen_light = _drawn(scene, camera, apart, known, sky)
        arriving = picture * weight[..., None]
        light[number] = arriving.sum((0, 1)) * np.pi / weight.sum()
        grey = arriving.mean(-1)
        total = max(float(grey.sum()), 1e-30)
        # The normal turned towards a direction of its plane adds what lies there over the cosine.
        tilted = np.einsum("hw,hwc->c", grey / np.maximum(directions[..., 2], 0.05), directions[..., :2])
        slope[number] = np.linalg.norm(tilted) / total
        dark_share = 1 - float((seen_share * weight).sum() / weight.sum())
        unseen[number] = max(dark_share, float((unseen_light * weight).sum()) / total)
        small[number] = np.partition(grey.ravel(), -brightest)[-brightest:].sum() / total
    missing = np.minimum(unseen, 0.95)
    added = (1 - small) * missing / (1 - missing)
    return Irradiance(light * (1 + added)[:, None], added / (1 + added), slope, unseen, small)


def _drawn(
    scene: Scene, camera: SplatCamera, apart: torch.Tensor, known: torch.Tensor, sky: Mask | None
) -> tuple[Array, Array, Array]:
    """Radiance [S, S, 3], the share of it that views saw, and the light, mean of channels, that none did."""
    renderer, gaussians = scene.renderer, scene.gaussians
    with torch.no_grad(), torch_on_one_thread():
        shapes = renderer.shapes(gaussians, camera).rows(apart)
        colours = renderer.colours(gaussians, camera, scene.record.degree)[apart]
        here = known[apart].to(colours)[:, None]
        unit = renderer.limits.luminance_reference or 1.0
        layers = torch.cat([colours, unit * here, (1 - here) * colours.mean(1, keepdim=True)], 1)
        render = rasterize(*shapes, layers, camera, None, renderer.limits)
        image = render.image.double().numpy()
        picture, share, dark = image[..., :3], image[..., 3] / unit, image[..., 4]
        if renderer.environment is not None and sky is not None:
            left_over = (1 - render.alpha.double().numpy()).clip(0, 1)
            far = renderer.environment.render(camera).double().numpy()
            there = _texels_of(camera, renderer.environment.axes, sky)
            picture = picture + left_over[..., None] * far
            share = share + left_over * there
            dark = dark + left_over * ~there * far.mean(-1)
    return picture, share, dark


def _texels_of(camera: SplatCamera, axes: Array, sky: Mask) -> Mask:
    """Look up a map [rows, 2 * rows] at each pixel of a camera, the nearest texel."""
    x, y, z = np.moveaxis(_lens()[1] @ camera.cam_from_world[:3, :3] @ axes.T, -1, 0)
    rows = len(sky)
    row = ((0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * rows).astype(np.intp).clip(0, rows - 1)
    column = ((0.5 - np.arctan2(x, z) / (2 * np.pi)) * 2 * rows).astype(np.intp) % (2 * rows)
    return np.asarray(sky[row, column])


def _looking(point: Array, normal: Array) -> SplatCamera:
    """A fisheye at a place that looks along the normal."""
    aside = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    aside /= np.linalg.norm(aside)
    motion = np.eye(4)
    motion[:3, :3] = np.stack([aside, np.cross(normal, aside), normal])
    motion[:3, 3] = -motion[:3, :3] @ point
    focal = SIZE / 2 / WIDE
    return SplatCamera(motion, focal, focal, SIZE / 2, SIZE / 2, SIZE, SIZE, fisheye=True)


@cache
def _lens() -> tuple[Array, Array]:
    """Solid angle times cosine of each pixel [S, S], 0 outside, and its direction [S, S, 3]."""
    side = (np.arange(SIZE) + 0.5 - SIZE / 2) * (2 * WIDE / SIZE)
    x, y = np.meshgrid(side, side)
    angle = np.hypot(x, y)
    sine = np.sinc(angle / np.pi)
    directions = np.stack([x * sine, y * sine, np.cos(angle)], -1)
    return np.where(angle < WIDE, np.cos(angle) * sine, 0.0), directions
