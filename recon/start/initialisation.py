"""Start of training: points on the surfaces, and Gaussians of the right size and colour there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from imaging.arrays import Array, Array32, Mask
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.progress import Progress, unreported
from recon.data.dataset import Dataset, View
from recon.data.geometry import lift, project
from recon.data.light import Images, Light, light_of
from recon.scene.appearance import Appearance
from recon.scene.gaussians import Gaussians
from recon.start.plane_sweep import plane_sweep, sample

FEWEST_POINTS = 8
SAMPLES_AT_ONCE = 250_000
"""Samples of points, of all views together, held in memory at once."""
DARK = 1 / 12.92
"""Share of the dimmest radiance that matters below which light counts as black: a photograph's code at its
dark end.
"""
MOST_FIRST = 16
"""Views that are swept over all depths, where poses came without points."""
OPACITY, SIZE = 0.7, 0.6
"""Opacity of Gaussians at their start, and their standard deviation over the distance to neighbours."""


@dataclass(frozen=True)
class Start:
    """Points that training may start from: SfM points first, swept ones behind. Colours are radiance,
    [P, C].

    left_out: views whose depths were not swept for want of time.
    """

    xyz: Array
    rgb: Array
    sparse: int
    left_out: int = 0


def start_points(
    dataset: Dataset,
    images: Images,
    count: int,
    rng: np.random.Generator,
    progress: Progress = unreported,
    over: Callable[[], bool] | None = None,
    first: Array | None = None,
    light: Light | None = None,
) -> Start:
    """Choose at most `count` coloured points: SfM points (as many as fit), then points of the plane sweep.

    Poses that came without any points get theirs from a first sweep over all depths.

    Args:
        dataset: Data set to train on.
        images: Radiance images of the training views.
        count: Number of points at most.
        rng: Source of the random choice of points.
        progress: Callback for the current step, the steps done, and all of them.
        over: Callback that is asked before each view is swept; a view at which it returns True is left out.
        first: Points [P, 3] that `points_of_poses` found by the first sweep, if it was made.
        light: Light of the scene, if it is known; None: computed from the images.

    Returns:
        The points that the images show, SfM points first.

    Raises:
        ReconstructionError: There are fewer than 8 points, or fewer are seen, so that nothing says where the
            scene is.
        InputError: A depth map is missing or damaged.
        StorageError: The disk refuses the scratch file of views that are not held in memory.
    """
    model = dataset.points()
    # Points that came with somebody else's poses, but without the images that saw them, are believed.
    good = np.isfinite(model.xyz).all(1) & ((model.views >= 2) | ~model.views.any())
    if good.any():
        good &= model.error <= max(2.0, 3 * float(np.median(model.error[good])))
    if len(model.xyz):
        sparse = model.xyz[good]
    else:
        sparse = points_of_poses(dataset, images, progress, light) if first is None else first
    if len(sparse) < FEWEST_POINTS:
        raise ReconstructionError(
            f"{dataset.session} has {len(sparse)} scene points in calibration/colmap, too few to start from: "
            "take images that overlap more and show more texture, and calibrate again."
        )
    if len(sparse) > count:
        sparse = sparse[np.sort(rng.choice(len(sparse), size=count, replace=False))]
    skipped: list[int] = []
    dimmest = _dimmest(dataset, images, light)
    xyz = sparse
    if len(sparse) < count:
        maps = plane_sweep(
            dataset.train, images, sparse, dimmest=dimmest, progress=progress, over=over, skipped=skipped
        )
        xyz = np.concatenate([sparse, sample(maps, count - len(sparse), rng)])
    rgb, visible = colours_at(dataset, images, xyz)
    # A swept point that is dark to most views that look there stands in empty space against black.
    visible[len(sparse) :] &= rgb[len(sparse) :].max(-1) > dimmest
    if visible.sum() < FEWEST_POINTS:
        raise ReconstructionError(
            f"{dataset.session} shows {int(visible.sum())} of its {len(xyz)} scene points where its images "
            "hold numbers and no mask hides them, too few to start from: look at the images and the masks."
        )
    return Start(xyz[visible], rgb[visible], int(visible[: len(sparse)].sum()), len(skipped))


def _dimmest(dataset: Dataset, images: Images, light: Light | None) -> float:
    """Radiance below which a start has nothing."""
    light = light or light_of(dataset, images)
    return DARK * light.normaliser * (light.reference or 0.0)


def scattered(dataset: Dataset, count: int, seed: int) -> Start:
    """About `count` points anywhere in the pictures of the training views, as deep as the scene is wide.

    A training from these is as slow as one from a start, and nothing has to be found for it.
    """
    rng = np.random.Generator(np.random.PCG64([seed, 0x5CA7]))
    each = max(count // len(dataset.train), FEWEST_POINTS)
    depths = np.full(each, dataset.extent)
    xyz = np.concatenate(
        [
            lift(view.lens, rng.random((each, 2)) * (view.lens.width, view.lens.height), depths)
            for view in dataset.train
        ]
    )
    return Start(xyz, np.ones((len(xyz), dataset.train[0].channels)), len(xyz))


def points_of_poses(
    dataset: Dataset, images: Images, progress: Progress = unreported, light: Light | None = None
) -> Array:
    """Points [P, 3] where a sweep from infinity inwards finds what neighbouring views confirm.

    Args:
        dataset: Data set with poses.
        images: Radiance images of the training views.
        progress: Callback for the current step, the steps done, and all of them.
        light: Light of the scene, if it is known; None: computed from the images.

    Returns:
        The points, in scene coordinates.

    Raises:
        InputError: A depth map is missing or damaged.
    """
    points = [np.zeros((0, 3))]
    dimmest = _dimmest(dataset, images, light)
    for depth_map in plane_sweep(
        dataset.train, images, None, dimmest=dimmest, most=MOST_FIRST, progress=progress
    ):
        # Beyond the middle of the image's depths by so much, a match gives a direction and no place.
        near = depth_map.trusted & depth_map.lit & (depth_map.depth < 20 * np.median(depth_map.depth))
        points.append(lift(depth_map.view.lens, depth_map.centres[near], depth_map.depth[near]))
    return np.concatenate(points)


def colours_at(dataset: Dataset, images: Images, xyz: Array) -> tuple[Array, Mask]:
    """Median radiance [P, C] of points over the training views that see their place, and who was seen.

    The median forgives the views in which something else stands before the point.
    """
    at_once = max(SAMPLES_AT_ONCE // len(images), 1)
    pieces = [slice(first, first + at_once) for first in range(0, max(len(xyz), 1), at_once)]
    views = dataset.train
    if all(view.held for view in views):
        masks = [view.valid for view in views]
        parts = [
            _median(
                [
                    _looks(view, mask, image, xyz[piece])
                    for view, mask, (image, _) in zip(views, masks, images, strict=True)
                ]
            )
            for piece in pieces
        ]
    else:
        parts = _medians_by_disk(dataset, images, xyz, pieces)
    return np.concatenate([rgb for rgb, _ in parts]), np.concatenate([visible for _, visible in parts])


def _medians_by_disk(
    dataset: Dataset, images: Images, xyz: Array, pieces: list[slice]
) -> list[tuple[Array, Mask]]:
    """Images come once: the looks of all views at all points wait for each other on the disk."""
    with store.scratch(dataset.session) as file:
        try:
            for view, (image, _) in zip(dataset.train, images, strict=True):
                mask = view.valid
                for piece in pieces:
                    looks = _looks(view, mask, image, xyz[piece])
                    file.write(looks.data)
            channels, parts = looks.shape[1], []
            for piece in pieces:
                samples_of = np.empty((len(images), len(xyz[piece]), channels), np.float32)
                for row, row_samples in enumerate(samples_of):
                    file.seek(4 * channels * (row * len(xyz) + piece.start))
                    file.readinto(row_samples.data)
                parts.append(_median(samples_of))
        except OSError as error:
            raise store.refused(dataset.session, error) from error
    return parts


def _looks(view: View, mask: Mask, image: Array32, xyz: Array) -> Array32:
    """Radiance [P, C] that a view has at the places of points; NaN where it does not see them.

    mask: of the view, which takes a look at all its pixels.
    """
    colours = np.full((len(xyz), image.shape[-1]), np.nan, np.float32)
    pixels, depth = project(view.lens, xyz)
    x, y = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
    inside = (depth > 0) & (x >= 0) & (y >= 0) & (x < view.lens.width) & (y < view.lens.height)
    at = y[inside].astype(int), x[inside].astype(int)
    colours[inside] = np.where(mask[at][:, None], image[at], np.nan)
    return colours


def _median(looks: Sequence[Array32] | Array32) -> tuple[Array, Mask]:
    """Median of samples [V, P, C]."""
    samples = np.asarray(looks, np.float64)
    sampled = np.isfinite(samples).any(0)
    visible = sampled.any(-1)
    median = np.zeros(samples.shape[1:])
    median[sampled] = np.nanmedian(samples[:, sampled], axis=0)
    # A band that no view of the point was taken through starts as bright as the others.
    others = median.sum(-1, keepdims=True) / np.maximum(sampled.sum(-1, keepdims=True), 1)
    return np.maximum(np.where(sampled, median, others), 0.0), np.asarray(visible)


def gaussians_at(
    start: Start,
    appearance: Appearance,
    units: Callable[[torch.Tensor], torch.Tensor],
) -> Gaussians:
    """Round Gaussians at the points, as large as the distance to their neighbours.

    `units` turns radiance into what a rendered image holds (`Observation.units`).
    Standard deviation: `SIZE` times the root mean squared distance to the three nearest (3DGS takes
    the distance itself), not more than four times the median, so that a stray point is no fog.
    """
    distances = cKDTree(start.xyz).query(start.xyz, k=min(4, len(start.xyz)))[0][:, 1:]
    spacing = np.sqrt((distances**2).mean(1))
    middle = float(np.median(spacing[spacing > 0])) if (spacing > 0).any() else 1.0
    spacing = spacing.clip(middle / 16, middle * 4) * SIZE
    count = len(start.xyz)
    quats = torch.zeros(count, 4)
    quats[:, 0] = 1
    return Gaussians(
        {
            "means": torch.from_numpy(start.xyz.astype(np.float32)),
            "log_scales": torch.from_numpy(np.log(spacing).astype(np.float32))[:, None].repeat(1, 3),
            "quats": quats,
            "opacity_logits": torch.full((count,), float(np.log(OPACITY / (1 - OPACITY)))),
            **appearance.start(units(torch.from_numpy(start.rgb.astype(np.float32)))),
        }
    )
