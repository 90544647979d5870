"""Depth for every pixel of a training view, by sweeping planes through its neighbours' images.

A sparse model leaves walls and shadows without points, and Gaussians reach such places slowly. A coarse plane
sweep (Collins 1996) over inverse depth, scored by zero-mean normalised correlation of log-radiance patches in
the neighbouring views, gives a point for most pixels in seconds. It uses training views only.
"""

from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from imaging.arrays import Array, Array32, Mask
from imaging.compute.threads import thread_count
from imaging.progress import Progress, unreported
from recon.data.dataset import View
from recon.data.geometry import inside, lift, lift_along, project, rays
from recon.data.light import Images, grey
from recon.start.warped_plane import compare_planes

PLANES = 56
WIDTH = 160
"""px of the pictures that are swept."""
NEIGHBOURS = 4
MOST_SWEPT = 48
"""Most views of a larger session whose depths are swept; the others serve as their neighbours."""
GOLDEN = 0.6180339887498949
TRUSTED_SCORE = 0.6
MEASURED = 2.0
"""The score of what was measured, above any correlation: it needs no other view to confirm it."""
NOWHERE = 1e9
"""Depth where a scanner saw nothing: what no view confirms."""
MOST_PARALLAX = 1.5
"""Largest parallax, coarse pixels, between two planes in a neighbouring view, where no points limit the range
of depths.
"""
AGREEMENT = 0.03
"""Relative difference of depth at which two views still confirm each other."""


@dataclass(frozen=True, eq=False)
class DepthMap:
    """Depth along the axis [h, w] at the coarse pixel centres.

    trusted [h, w]: where texture determines it and views agree; elsewhere it is filled in from there.
    believed [h, w]: there, and where the filled-in depth of another view agrees, as it does on a bare wall.
    lit [h, w]: where the view shows light that matters.
    """

    view: View
    depth: Array32
    trusted: Mask
    believed: Mask
    lit: Mask
    centres: Array


def plane_sweep(
    views: tuple[View, ...],
    images: Images,
    points: Array | None,
    *,
    dimmest: float = 0.0,
    progress: Progress = unreported,
    most: int = MOST_SWEPT,
    over: Callable[[], bool] | None = None,
    skipped: list[int] | None = None,
) -> list[DepthMap]:
    """Depth maps of at most `most` of the `views`, from the radiance images of all of them.

    The range of depths of each view comes from the points in front of it, widened by a quarter in inverse
    depth; views that see fewer than 8 of them get no map. Views whose depth was measured are not swept, and
    gaps of their scanners are filled in from the surroundings. Without points the range goes from infinity to
    as near as the planes resolve, seen from the neighbours. Views are taken in an order that soon has some of
    everywhere.

    Args:
        views: Training views.
        images: Radiance images of all views.
        points: Sparse points of the scene, [P, 3], scene coordinates; None: without.
        dimmest: Least radiance that matters.
        progress: Callback for the current step, the steps done, and all of them.
        most: Number of maps at most.
        over: Callback, from any thread, before each view; where it returns True the view gets no map.
        skipped: List that receives the indices of the views that got no map for that reason.

    Returns:
        The maps, in the order of the views.

    Raises:
        InputError: A depth map is missing or damaged.
    """
    chosen = spread(views, most)
    everyone = range(len(views))
    # Logarithms of light: a patch correlates as well in the shade as in the sun.
    logs, lit = [], {}
    for index, (view, (image, _)) in enumerate(zip(views, images, strict=True)):
        logs.append(_log_image(image, view))
        if index in chosen:
            lit[index] = _at_size(np.nanmax(image, axis=-1), logs[-1]) > dimmest

    def depth_of(index: int) -> tuple[Array32, Array32] | None:
        if over is not None and over():
            if skipped is not None:
                skipped.append(index)
            return None
        if (measured := _measured(views[index], logs[index])) is not None:
            return measured
        near = _neighbours(index, views, everyone)
        bounds = _reach(views[index], near, views) if points is None else _bounds(views[index], points)
        return _sweep_one(index, near, views, logs, bounds) if bounds and near else None

    # Steps of the golden ratio have views from everywhere whenever the time ends.
    swept: dict[int, tuple[Array32, Array32]] = {}
    order = sorted(chosen, key=lambda index: index * GOLDEN % 1)
    with ThreadPoolExecutor(thread_count()) as pool:
        for done, (index, depth_map) in enumerate(zip(order, pool.map(depth_of, order), strict=True)):
            progress("sweeping depth", done, len(chosen))
            if depth_map is not None:
                swept[index] = depth_map
    # Depth is trusted where two views say the same; the rest is filled in from what is trusted around it.
    depths = {index: swept[index][0] for index in sorted(swept)}
    centres = {index: _coarse_centres(views[index], *depth.shape[::-1]) for index, depth in depths.items()}
    directions = {index: rays(views[index].lens, at) for index, at in centres.items()}
    trusted, filled = {}, {}
    for index, depth in depths.items():
        score = swept[index][1]
        sure = _confirmed(index, depths, directions[index], views, chosen) | (score == MEASURED)
        sure &= score > TRUSTED_SCORE
        trusted[index] = sure & (_at_size(views[index].valid.astype(np.float32), depth) > 0.5)
        filled[index] = _fill(depth, trusted[index])
    return [
        DepthMap(
            view=views[index],
            depth=depth,
            trusted=trusted[index],
            believed=trusted[index] | _confirmed(index, filled, directions[index], views, chosen),
            lit=lit[index],
            centres=centres[index],
        )
        for index, depth in filled.items()
    ]


def _log_image(image: Array32, view: View) -> Array32:
    size = (min(WIDTH, view.lens.width), max(1, round(view.lens.height * min(1, WIDTH / view.lens.width))))
    small = cv2.resize(grey(image), size, interpolation=cv2.INTER_AREA)
    # Noise of the shadows would be the only texture left without a floor; a thousandth of the view's
    # bright end keeps ten stops of structure.
    floor = max(float(np.percentile(small, 99)) / 1000, 1e-12)
    return np.asarray(np.log(np.maximum(small, 0) + floor), np.float32)


def _coarse_centres(view: View, width: int, height: int) -> Array:
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x * view.lens.width / width, y * view.lens.height / height], -1)


def _bounds(view: View, points: Array) -> tuple[float, float] | None:
    pixels, depth = project(view.lens, points)
    shown = inside(view.lens, pixels, depth) & (depth > 1e-6)
    if shown.sum() < 8:
        return None
    far, near = np.percentile(1 / depth[shown], [1, 99])
    return float(far * 0.75), float(near * 1.25)


def _reach(view: View, near: list[int], views: tuple[View, ...]) -> tuple[float, float] | None:
    if not near:
        return None
    baseline = float(np.median([np.linalg.norm(views[other].centre - view.centre) for other in near]))
    focal = view.lens.fx * min(1.0, WIDTH / view.lens.width)
    return 0.0, (PLANES - 1) * MOST_PARALLAX / (focal * baseline)


def spread(views: tuple[View, ...], most: int) -> list[int]:
    """Choose at most that many views, in order: pairs of near ones, the pairs as far from each other as can
    be.
    """
    if len(views) <= most:
        return list(range(len(views)))
    centres = np.stack([view.centre for view in views])
    ahead = np.stack([view.lens.cam_from_world[2, :3] for view in views])
    reach = float(np.linalg.norm(centres - centres.mean(0), axis=1).max())
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) / max(reach, 1e-9)
    apart += np.linalg.norm(ahead[:, None] - ahead, axis=2)
    chosen: list[int] = []
    distance = np.full(len(views), np.inf)
    while len(chosen) + 2 <= most and distance.max() > 0:
        farthest = int(distance.argmax())
        for index in (farthest, *_neighbours(farthest, views, range(len(views)))[:1]):
            if distance[index] > 0:
                chosen.append(index)
                distance = np.minimum(distance, apart[index])
                distance[index] = 0
    return sorted(chosen)


def _neighbours(index: int, views: tuple[View, ...], among: Collection[int]) -> list[int]:
    """The views nearest to this one that look the same way and do not stand in the same place."""
    reference = views[index]
    others = []
    for other in among:
        view = views[other]
        distance = float(np.linalg.norm(view.centre - reference.centre))
        facing = float(reference.lens.cam_from_world[2, :3] @ view.lens.cam_from_world[2, :3])
        if other != index and distance > 1e-9 and facing > 0.5:
            others.append((distance, other))
    return [other for _, other in sorted(others)[:NEIGHBOURS]]


def _measured(view: View, image: Array32) -> tuple[Array32, Array32] | None:
    """Depth and score [h, w] of a view by its depth map, or None."""
    if view.depth is None:
        return None
    whole, (height, width) = view.depth.read(view), image.shape
    x, y = _coarse_centres(view, width, height).astype(int).transpose(2, 0, 1)
    depth = whole[y, x]
    if not depth.any():
        return None
    return np.where(depth > 0, depth, np.float32(NOWHERE)), np.where(depth > 0, np.float32(MEASURED), 0)


def _sweep_one(
    index: int, near: list[int], views: tuple[View, ...], logs: list[Array32], bounds: tuple[float, float]
) -> tuple[Array32, Array32]:
    reference, image = views[index].lens, logs[index]
    height, width = image.shape
    direction = rays(reference, _coarse_centres(views[index], width, height))
    planes = np.linspace(*bounds, PLANES)
    # The better half of the neighbours, two of four at most, so that one that is covered there has no vote.
    first = np.full((PLANES, height, width), -1.0, np.float32)
    second = first.copy() if len(near) > 2 else first
    for other in near:
        lens = views[other].lens
        relative = lens.cam_from_world @ np.linalg.inv(reference.cam_from_world)
        turned, shift = direction @ relative[:3, :3].T, relative[:3, 3].copy()
        compare_planes(lens, logs[other], turned, shift, planes, image, first, second)
    volume = np.float32(0.5) * (first + second)
    best = volume.argmax(0)
    return _subplane(volume, best, planes), np.take_along_axis(volume, best[None], 0)[0]


def _subplane(volume: Array32, best: npt.NDArray[np.intp], planes: Array) -> Array32:
    """Depth at the top of the parabola through the best plane and its two neighbours."""
    inner = best.clip(1, len(planes) - 2)
    left, middle, right = (np.take_along_axis(volume, (inner + step)[None], 0)[0] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    offset = np.where(bend < -1e-6, 0.5 * (left - right) / np.minimum(bend, -1e-6), 0.0).clip(-1, 1)
    offset = np.where(inner == best, offset, best - inner)
    inverse = planes[0] + (inner + offset) * (planes[1] - planes[0])
    return np.asarray(1 / np.maximum(inverse, 1e-9), np.float32)


def _at_size(picture: Array32, depth: Array32) -> Array32:
    """A picture [H, W] averaged to the size of a depth map."""
    return np.asarray(cv2.resize(picture, depth.shape[::-1], interpolation=cv2.INTER_AREA), np.float32)


def _confirmed(
    index: int,
    depths: Mapping[int, Array32],
    directions: Array,
    views: tuple[View, ...],
    swept: Collection[int],
) -> Mask:
    """Return where at least one other view puts a surface at the same place."""
    place = lift_along(views[index].lens, directions, depths[index])
    confirmed = np.zeros(depths[index].shape, bool)
    for other in _neighbours(index, views, swept):
        depth = depths.get(other)
        if depth is None:
            continue
        lens = views[other].lens
        pixels, at = project(lens, place)
        height, width = depth.shape
        x = np.floor(pixels[..., 0] * width / lens.width).astype(int)
        y = np.floor(pixels[..., 1] * height / lens.height).astype(int)
        there = (x >= 0) & (y >= 0) & (x < width) & (y < height) & (at > 0)
        other_depth = depth[y.clip(0, height - 1), x.clip(0, width - 1)]
        confirmed |= there & (np.abs(other_depth - at) < AGREEMENT * np.maximum(at, 1e-12))
    return confirmed


def _fill(depth: Array32, trusted: Mask) -> Array32:
    """Depth with the untrusted pixels taken from the trusted ones around them, smoothly, coarse to fine."""
    if not trusted.any():
        return depth
    weight = trusted.astype(np.float32)
    value = np.where(trusted, 1 / depth, 0).astype(np.float32)
    filled, coverage = value, weight
    sigma = 1.0
    while (coverage < 1e-3).any() and sigma < 2 * max(depth.shape):
        blurred = cv2.GaussianBlur(value, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        amount = cv2.GaussianBlur(weight, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
        new = (coverage < 1e-3) & (amount > 1e-3)
        filled = np.where(new, blurred / np.maximum(amount, 1e-12), filled)
        coverage = np.where(new, 1.0, coverage)
        sigma *= 2
    filled = np.where(coverage > 0, filled, np.median(1 / depth[trusted]))
    return np.asarray(1 / np.maximum(filled, 1e-9), np.float32)


def sample(maps: list[DepthMap], count: int, rng: np.random.Generator) -> Array:
    """Draw at most `count` scene points, evenly over the pixels of all maps that are believed and lit.

    Anywhere else depth is a guess, and a Gaussian there would hide what is behind it.
    """
    good = [(depth_map.lit & depth_map.believed).reshape(-1) for depth_map in maps]
    if not any(one.any() for one in good) or count <= 0:
        return np.zeros((0, 3))
    # All pixels have their turn, so that one more or less that is good changes one point and not all.
    turns = rng.permutation(sum(map(len, good)))
    chosen = np.sort(turns[np.concatenate(good)[turns]][:count])
    points, start = [], 0
    for depth_map, one in zip(maps, good, strict=True):
        pixels = chosen[(chosen >= start) & (chosen < start + len(one))] - start
        start += len(one)
        centres = depth_map.centres.reshape(-1, 2)[pixels]
        points.append(lift(depth_map.view.lens, centres, depth_map.depth.reshape(-1)[pixels]))
    return np.concatenate(points)
