"""Start of an environment: the light of each direction that views from several places agree on."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from imaging.arrays import Array, Array32, Integers, Mask
from recon.data.dataset import View
from recon.data.geometry import inside, project, project_camera, rays
from recon.scene.environment import Environment, texels
from recon.start.initialisation import FEWEST_POINTS, Start

FINEST = 768
"""Rows at most: 3.5 million numbers, whose steps take a tenth of a training's time."""
TEXEL = 1.0
"""Pixels of a training view that a texel is across. Of a sun of three pixels, and its halo, fitted alone, 1.5
leave it a stop too dark, and 1.0 a quarter."""
MOST_LOOKS = 8
"""Most samples of a direction; more views add nothing."""
ALIKE = 0.2
"""Natural log: two views agree on light that differs by less."""
BEYOND = 10.0
"""Extents of the rig from its middle: Gaussians start nearer."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
FLOOR = 2.0**-20
"""Least start value of a direction, relative to the brightest light."""


def far_light(
    views: Sequence[View],
    images: Sequence[tuple[Array32, Mask]],
    units: Callable[[torch.Tensor], torch.Tensor],
    finest: int = FINEST,
) -> Environment:
    """The environment that training starts from.

    Of the lights that views see in the direction of a texel it has the one that most others are like: what
    stands before it in one view looks otherwise from the next. Saturated pixels are lower bounds, which are
    like any brighter light. Directions in which no two views see alike have the light of the nearest in which
    two do.

    Args:
        views: Training views.
        images: Radiance image [H, W, 3] of each view, and the mask [H, W] of where it is trusted; elsewhere
            it counts as a lower bound.
        units: Conversion from radiance to what a rendered image holds (`Observation.units`).
        finest: Rows of the map at most.

    Returns:
        The environment, whose poles lie where the cameras' own up and down do.
    """
    focal = float(np.median([max(view.lens.fx, view.lens.fy) for view in views]))
    rows = int(np.clip(round(np.pi * focal / TEXEL), 16, finest))
    axes = _axes(views)
    directions = (texels(rows) @ axes).reshape(-1, 3)
    light = np.full((MOST_LOOKS, len(directions), 3), np.nan, np.float32)
    bound = np.zeros(light.shape[:2], bool)
    count = np.zeros(len(directions), np.int64)
    for view, (rgb, trusted) in zip(views, images, strict=True):
        at, looks, measured = _looks(view, rgb, trusted, directions)
        room = count[at] < MOST_LOOKS
        at, looks, measured = at[room], looks[room], measured[room]
        light[count[at], at] = looks
        bound[count[at], at] = ~measured
        count[at] += 1
    best, friends = _most_like(light, bound)
    planes = light[best, np.arange(len(directions))].reshape(rows, 2 * rows, 3)
    unsure = (friends == 0).reshape(rows, 2 * rows)
    nearest = distance_transform_edt(unsure, return_distances=False, return_indices=True)
    filled = np.zeros_like(planes) if unsure.all() else planes[tuple(nearest)]
    scaled = units(torch.from_numpy(np.maximum(filled, 0))).movedim(2, 0)
    floor = max(float(scaled.max()) * FLOOR, 1e-12)
    return Environment(scaled.clamp_min(floor).log().float().contiguous(), axes)


def _most_like(light: Array32, bound: Mask) -> tuple[Integers, Integers]:
    """Sample among [L, D, 3], NaN where missing, that most others resemble, and their number, [D].

    bound [L, D]: samples that are lower bounds.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.log(light @ LUMINANCE)
    logs[~np.isfinite(logs)] = np.nan
    best, friends = np.zeros(light.shape[1], np.int64), np.full(light.shape[1], -1, np.int64)
    for one, log in enumerate(logs):
        alike = (_apart(logs - log, bound) < ALIKE).sum(0) - np.isfinite(log)
        better = np.isfinite(log) & (alike > friends)
        best[better], friends[better] = one, alike[better]
    return best, np.maximum(friends, 0)


def _apart(difference: Array, bound: Mask) -> Array:
    """Distance to a light that is `difference` darker; of a lower `bound` 0 where that is brighter."""
    return np.asarray(np.where(bound, np.maximum(difference, 0), np.abs(difference)))


def within_reach(views: Sequence[View], points: Array) -> Mask:
    """Return which of points [P, 3] lie within `BEYOND` extents of the views' cameras, bool [P]."""
    centres = np.array([view.centre for view in views])
    middle = centres.mean(0)
    extent = float(np.linalg.norm(centres - middle, axis=1).max())
    return np.asarray(np.linalg.norm(points - middle, axis=1) < BEYOND * extent)


def without_far(
    start: Start,
    views: Sequence[View],
    images: Sequence[tuple[Array32, Mask]],
    far: Environment,
    units: Callable[[torch.Tensor], torch.Tensor],
) -> Start:
    """The points that Gaussians start from where an environment has the light of all beyond.

    A sky has no depth: the swept points of it stand in the air, and a Gaussian there that shows it to one
    camera hides a sun from the next.

    Args:
        start: Points to choose from.
        views: Training views.
        images: Radiance image [H, W, 3] of each view, and the mask [H, W] of where it is trusted; elsewhere
            it counts as a lower bound.
        far: Environment of the scene (`far_light`).
        units: Conversion from radiance to what a rendered image holds (`Observation.units`).

    Returns:
        The points within `BEYOND` extents of the cameras that views do not look through; all of `start` where
        these would be fewer than 8.
    """
    reachable = within_reach(views, start.xyz) & ~looked_through(start, views, images, far, units)
    if reachable.sum() < FEWEST_POINTS:
        return start
    return replace(
        start, xyz=start.xyz[reachable], rgb=start.rgb[reachable], sparse=int(reachable[: start.sparse].sum())
    )


def looked_through(
    start: Start,
    views: Sequence[View],
    images: Sequence[tuple[Array32, Mask]],
    far: Environment,
    units: Callable[[torch.Tensor], torch.Tensor],
) -> Mask:
    """Return at which swept points the views rather see the light from far away, bool [P].

    Most of those that look there see it to `ALIKE`, and all together differ less from it than from the light
    of the point; saturated pixels are lower bounds of both.

    Args:
        start: P points with their radiance, of which the swept ones, behind the first `sparse`, are examined.
        views: Training views.
        images: Radiance image [H, W, 3] of each view, and the mask [H, W] of where it is trusted; elsewhere
            it counts as a lower bound.
        far: Environment of the scene (`far_light`).
        units: Conversion from radiance to what a rendered image holds (`Observation.units`).

    Returns:
        The mask; False at all other points.
    """
    looks, through = np.zeros(len(start.xyz), np.int64), np.zeros(len(start.xyz), np.int64)
    gain = np.zeros(len(start.xyz))
    of_point = _log_luminance(units(torch.from_numpy(start.rgb)))
    for view, (rgb, trusted) in zip(views, images, strict=True):
        pixels, depth = project(view.lens, start.xyz)
        at = np.flatnonzero(inside(view.lens, pixels, depth))
        column, row = np.floor(pixels[at]).astype(int).T
        unmasked = view.valid[row, column]
        at, column, row = at[unmasked], column[unmasked], row[unmasked]
        directions = torch.from_numpy((start.xyz[at] - view.centre) @ far.axes.T).to(far.ln_light)
        shown = _log_luminance(units(torch.from_numpy(rgb[row, column])))
        bound = ~trusted[row, column]
        from_far = _apart(shown - _log_luminance(far.light(directions)), bound)
        looks[at] += 1
        through[at] += from_far < ALIKE
        gain[at] += np.minimum(_apart(shown - of_point[at], bound), 1) - np.minimum(from_far, 1)
    swept = np.arange(len(start.xyz)) >= start.sparse
    return np.asarray(swept & (2 * through > looks) & (gain > 0))


def _log_luminance(light: torch.Tensor) -> Array:
    """Natural log of the luminance [N] of light [N, 3]."""
    return np.log(np.maximum(light.numpy() @ LUMINANCE, 1e-30))


def _axes(views: Sequence[View]) -> Array:
    """Scene axes of a map whose poles lie where the cameras' own up and down do."""
    up = -np.mean([view.lens.cam_from_world[1, :3] for view in views], axis=0)
    if np.linalg.norm(up) < 0.1:  # turned all ways: any axis will do
        up = -views[0].lens.cam_from_world[1, :3]
    up = up / np.linalg.norm(up)
    ahead = views[0].lens.cam_from_world[2, :3]
    side = np.cross(up, ahead)
    if np.linalg.norm(side) < 1e-6:
        side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    return np.stack([side, up, np.cross(side, up)])


def _looks(view: View, rgb: Array32, trusted: Mask, directions: Array) -> tuple[Integers, Array32, Mask]:
    """Return which of far directions [D, 3] a view shows, their light [M, 3], and where it is measured."""
    lens, turn = view.lens, view.lens.cam_from_world[:3, :3]
    border = rays(lens, [[0, 0], [lens.width, 0], [0, lens.height], [lens.width, lens.height]])
    widest = float((border[:, 2] / np.linalg.norm(border, axis=1)).min())
    ahead = np.flatnonzero(directions @ turn[2] > widest)
    pixels, depth = project_camera(lens, directions[ahead] @ turn.T)
    shown = inside(lens, pixels, depth)
    ahead, pixels = ahead[shown], pixels[shown]
    at = np.floor(pixels).astype(int)
    valid = view.valid[at[:, 1], at[:, 0]]
    measured = trusted[at[:, 1], at[:, 0]][valid]
    ahead, pixels = ahead[valid], (pixels[valid] - 0.5).astype(np.float32)
    if not len(ahead):
        return ahead, np.zeros((0, 3), np.float32), measured
    # OpenCV maps no more than 32767 places a side.
    width = 1 << 14
    padded = np.zeros((-(-len(pixels) // width) * width, 2), np.float32)
    padded[: len(pixels)] = pixels
    where = padded.reshape(-1, width, 2)
    light = cv2.remap(
        np.ascontiguousarray(rgb),
        where[..., 0],
        where[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return ahead, light.reshape(-1, 3)[: len(ahead)], measured
