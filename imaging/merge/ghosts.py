"""Removal of motion between the exposures of a bracket."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, special

from imaging.arrays import Array32, Mask
from imaging.merge.bracket import MARGIN, Merged, merge_bracket
from imaging.merge.linear_frame import LinearFrame

CHANCE = 1e-4
"""Probability that noise alone makes a place disagree that much."""
TOLERANCE = 0.02
"""Disagreement of exposures, relative, that is no motion: flicker and rounded ratios."""
OPENING = 3
"""Places in a row, along both axes, that have to disagree: one alone is an outlier of the sensor."""
SATURATED = 0.01
"""Share of the moved places that may be saturated in the exposure that is to show them."""


@dataclass(frozen=True, eq=False)
class Deghosted:
    """merged: a bracket, where something moved from one exposure alone; ghost: bool, of merged's shape.

    reference: index of that exposure among the frames, or of that for most of it; None where nothing moved.
    noise: how many times its model the noise of the bracket is, at least 1.
    """

    merged: Merged
    ghost: Mask
    reference: int | None
    noise: float


def without_ghosts(
    frames: Sequence[LinearFrame], tolerance: float = TOLERANCE, hidden: Mask | None = None
) -> Deghosted:
    """Merge a bracket (see `merge_bracket`), but take what moved from the best single exposure.

    tolerance: relative disagreement of exposures that does not count as motion. hidden: bool [H, W], pixels
    excluded by masks. Without a noise model, or with one exposure, motion cannot be detected.
    """
    merged = merge_bracket(frames)
    ghost, noise = find_ghosts(frames, merged, tolerance, hidden)
    if not ghost.any():
        return Deghosted(merged, ghost, None, noise)
    references, remaining = _references(frames, ghost), ghost
    for reference in references:
        alone = merge_bracket([frames[reference]])
        number = remaining & np.isfinite(alone.radiance)
        merged = _with(merged, alone, number)
        remaining = remaining & ~number
        if not remaining.any():
            break
    return Deghosted(merged, ghost, references[0], noise)


def _with(merged: Merged, alone: Merged, place: Mask) -> Merged:
    """Return what was merged, with one exposure alone at a place."""
    assert merged.sigma is not None
    assert alone.sigma is not None
    return replace(
        merged,
        radiance=np.where(place, alone.radiance, merged.radiance),
        sigma=np.where(place, alone.sigma, merged.sigma),
        valid=np.where(place, alone.valid, merged.valid),
        clipped=np.where(place, alone.clipped, merged.clipped),
        dark=np.where(place, alone.dark, merged.dark),
    )


def find_ghosts(
    frames: Sequence[LinearFrame],
    merged: Merged,
    tolerance: float = TOLERANCE,
    hidden: Mask | None = None,
) -> tuple[Mask, float]:
    """Find where the exposures contradict the merged value.

    The chi-square of the rates is summed over the channels of a pixel, or the cell of a mosaic. Its median
    over the picture measures how much noisier than their model the frames are; the threshold scales with it.

    Args:
        frames: Exposures of the bracket.
        merged: The same exposures merged.
        tolerance: Relative disagreement of exposures that does not count as motion.
        hidden: Pixels excluded by masks, bool [H, W].

    Returns:
        The contradictions, bool of the shape of `merged`, and the noise over its model, at least 1. Without a
        noise model, or with one exposure, motion cannot be detected: no place is marked, and the noise is 1.
    """
    shape = merged.radiance.shape
    if len(frames) < 2 or any(frame.noise is None for frame in frames):
        return np.zeros(shape, bool), 1.0
    square, count = _disagreement(frames, merged, tolerance)
    if hidden is not None:
        count = np.where(hidden if count.ndim == 2 else hidden[..., None], np.float32(0), count)
        square = np.where(count > 0, square, np.float32(0))
    cell = 1 if frames[0].cfa is None else frames[0].cfa.cell
    square, count = _places(square, cell), _places(count, cell)
    freedom = np.maximum(count, 1).astype(np.intp)
    compared = count > 0
    if not compared.any():
        return np.zeros(shape, bool), 1.0
    table = np.arange(1, int(freedom.max()) + 1)
    middle, limit = special.chdtri(table, 0.5)[freedom - 1], special.chdtri(table, CHANCE)[freedom - 1]
    excess = max(float(np.median((square / middle)[compared])), 1.0)
    moved = compared & (square / excess > limit)
    moved = ndimage.binary_opening(moved, np.ones((OPENING, OPENING), bool))
    return _spread(moved, shape, cell), float(np.sqrt(excess))


def _disagreement(frames: Sequence[LinearFrame], merged: Merged, tolerance: float) -> tuple[Array32, Array32]:
    """Chi-square of the exposures against the merged value, and its degrees of freedom.

    A saturated exposure only says that the light is at least so much, a dark one that it is at most.
    """
    radiance = np.where(np.isfinite(merged.radiance), merged.radiance, 0.0)
    square, count = np.zeros(radiance.shape, np.float32), np.zeros(radiance.shape, np.float32)
    for frame in frames:
        assert frame.noise is not None
        expected = radiance * np.float32(frame.k)
        variance = frame.noise.variance(expected) + (tolerance * expected) ** 2
        residual = frame.signal - expected
        number = frame.valid & np.isfinite(frame.signal)
        near = expected + MARGIN * np.sqrt(variance) >= (np.inf if frame.ceiling is None else frame.ceiling)
        usable = number & ~frame.saturated & ~frame.dark & ~near
        bound = number & ((frame.saturated & (residual > 0)) | (frame.dark & (residual < 0)))
        square += np.where(usable | bound, residual**2 / variance, 0.0).astype(np.float32)
        count += usable
    return np.where(merged.valid, square, 0.0), np.where(merged.valid, np.maximum(count - 1, 0), 0)


def _places(values: Array32, cell: int) -> Array32:
    """Sums over the channels of a pixel, or the cells of a mosaic, the last ones of which may be short."""
    if values.ndim == 3:
        return np.asarray(values.sum(-1))
    height, width = values.shape
    whole = np.pad(values, ((0, -height % cell), (0, -width % cell)))
    return np.asarray(whole.reshape(-(-height // cell), cell, -(-width // cell), cell).sum((1, 3)))


def _spread(places: Mask, shape: tuple[int, ...], cell: int) -> Mask:
    """Flags of places as flags of all that belongs to them."""
    if places.shape != shape[:2]:
        places = places.repeat(cell, 0).repeat(cell, 1)[: shape[0], : shape[1]]
    return places if len(shape) == 2 else np.repeat(places[..., None], shape[2], axis=2)


def _references(frames: Sequence[LinearFrame], ghost: Mask) -> list[int]:
    """Exposures to show what moved, the best first: the longest that is hardly saturated there.

    The next ones stand in where a mask or a defect left it no number.
    """
    shares = [float(frame.saturated[ghost].mean()) for frame in frames]
    most = max(SATURATED, min(shares))
    excess = [share if share > most else 0.0 for share in shares]
    return sorted(range(len(frames)), key=lambda i: (excess[i], -frames[i].k))
