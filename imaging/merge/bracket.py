"""Exposures of one view merged into one radiance map, as near to the best estimate as noise allows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array, Array32, Floats, Mask
from imaging.compute.jit import compiled
from imaging.merge.linear_frame import LinearFrame
from imaging.sensor.cfa import Cfa

ITERATIONS = 3
"""Fixed-point iterations of the weights; a variance taken at each noisy sample biases the dark by -4 %."""
MARGIN = 3.0
"""A sample nearer to saturation than this many standard deviations would be kept only if its noise is
negative, so it is left out where a shorter exposure can stand in."""
ROWS = 64
"""Rows merged at a time, which bounds the memory of the float64 sums, and keeps them near the processor."""


@dataclass(frozen=True, eq=False)
class Merged:
    """A merged bracket; every array has the shape of the frames, [H, W] or [H, W, 3].

    radiance: float32, signal per second of exposure scale; negative where noise is; NaN where no
    frame has a number. sigma: float32, its standard deviation, NaN or inf where the radiance is
    none or only a bound; None when the noise of the frames is not known. clipped: every frame is
    saturated, and the radiance is the lower bound that the shortest gives. dark: every frame is at the
    lower end of its codes, and the radiance is the upper bound of the longest. valid: a measured value.
    """

    radiance: Array32
    sigma: Array32 | None
    valid: Mask
    clipped: Mask
    dark: Mask
    cfa: Cfa | None = None


def merge_bracket(frames: Sequence[LinearFrame]) -> Merged:
    """Merge frames of one view that show the same scene without motion.

    Maximum likelihood for Gaussian noise: `sum(k x / var) / sum(k^2 / var)`, the variance taken at
    the merged estimate. Where the noise of any frame is not known, `sum(x) / sum(k)` (Hanji, Zhong and
    Mantiuk, "Noise-Aware Merging of High Dynamic Range Image Stacks without Camera Calibration", 2020).
    ValueError when there is no frame, the shapes differ or a k is not positive and finite.
    """
    if not frames or any(f.signal.shape != frames[0].signal.shape for f in frames):
        raise ValueError("merging takes one frame or more, all of one shape")
    if not all(np.isfinite(f.k) and f.k > 0 for f in frames):
        raise ValueError("exposure scales are positive and finite")
    ordered = sorted(frames, key=lambda f: f.k)
    shape = ordered[0].signal.shape
    known = all(f.noise is not None for f in ordered)
    radiance, sigma = np.empty(shape, np.float32), np.empty(shape, np.float32)
    masks = np.empty((3, *shape), bool)
    for top in range(0, shape[0], ROWS):
        rows = slice(top, min(top + ROWS, shape[0]))
        merged = _merge_rows(ordered, rows, known) if len(ordered) > 1 else _single(ordered[0], rows)
        radiance[rows], sigma[rows], masks[:, rows] = merged
    return Merged(radiance, sigma if known else None, masks[0], masks[1], masks[2], cfa=ordered[0].cfa)


def _single(frame: LinearFrame, rows: slice) -> tuple[Floats, Floats, Mask]:
    """One frame is its own weighted mean, whatever the weight."""
    signal = np.ascontiguousarray(frame.signal[rows], np.float32)
    radiance, sigma = np.empty(signal.shape, np.float32), np.empty(signal.shape, np.float32)
    masks = np.empty((3, *signal.shape), bool)
    variance = np.full(1, np.inf) if frame.noise is None else frame.noise.variance(signal)
    variance = np.broadcast_to(variance, signal.shape).astype(np.float32)
    _alone(
        signal.reshape(-1), frame.valid[rows].reshape(-1), frame.saturated[rows].reshape(-1),
        frame.dark[rows].reshape(-1), variance.reshape(-1), np.float32(frame.k),
        radiance.reshape(-1), sigma.reshape(-1), masks.reshape(3, -1),
    )  # fmt: skip
    return radiance, sigma, masks


@compiled
def _alone(
    signal: Array32,
    valid: Mask,
    saturated: Mask,
    dark: Mask,
    variance: Array32,
    k: np.float32,
    radiance: Array32,
    sigma: Array32,
    masks: Mask,
) -> None:
    """Merge each photosite [N] of a single frame into the last three arguments; masks [3, N]."""
    for place in range(len(signal)):
        value = signal[place]
        number = valid[place] and np.isfinite(value)
        usable = number and not saturated[place] and not dark[place]
        clipped = number and saturated[place]
        masks[0, place], masks[1, place] = usable, clipped
        masks[2, place] = number and not usable and not clipped
        radiance[place] = value / k if number else np.float32(np.nan)
        sigma[place] = np.float32(np.nan)
        if number:
            sigma[place] = np.sqrt(variance[place]) / k if usable else np.float32(np.inf)


def _merge_rows(frames: Sequence[LinearFrame], rows: slice, known: bool) -> tuple[Floats, Floats, Mask]:
    k = np.array([f.k for f in frames]).reshape(-1, *[1] * frames[0].signal.ndim)
    signal = np.stack([f.signal[rows] for f in frames]).astype(np.float64)
    number = np.stack([f.valid[rows] for f in frames]) & np.isfinite(signal)
    saturated = np.stack([f.saturated[rows] for f in frames])
    dark = np.stack([f.dark[rows] for f in frames])
    usable = number & ~saturated & ~dark
    signal = np.where(number, signal, 0.0)

    weight = np.broadcast_to(k, signal.shape)
    radiance = _ratio((signal * usable).sum(0), (weight * usable).sum(0))
    information = np.zeros(radiance.shape)
    if known:
        used = usable
        for iteration in range(ITERATIONS):
            variance = np.stack([_variance(f, radiance * f.k) for f in frames])
            if iteration == 0:
                ceilings = np.array([np.inf if f.ceiling is None else f.ceiling for f in frames])
                used = _clear(usable, radiance * k + MARGIN * np.sqrt(variance) < ceilings.reshape(k.shape))
            precision = np.where(used, k / variance, 0.0)
            information = (precision * k).sum(0)
            radiance = _ratio((precision * signal).sum(0), information)
    with np.errstate(divide="ignore"):
        sigma = 1.0 / np.sqrt(information)

    valid = usable.any(0)
    clipped = ~valid & (saturated & number).any(0)
    too_dark = ~valid & ~clipped & number.any(0)
    # Frames ascend in k: the first saturated frame bounds from below best, the last dark one from above.
    shortest = np.argmax(saturated & number, axis=0)[None]
    longest = len(frames) - 1 - np.argmax((dark & number)[::-1], axis=0)[None]
    rate = signal / k
    radiance = np.where(clipped, np.take_along_axis(rate, shortest, 0)[0], radiance)
    radiance = np.where(too_dark, np.take_along_axis(rate, longest, 0)[0], radiance)
    nothing = ~number.any(0)
    radiance = np.where(nothing, np.nan, radiance)
    sigma = np.where(nothing, np.nan, np.where(valid, sigma, np.inf))
    return radiance, sigma, np.stack([valid, clipped, too_dark])


def _variance(frame: LinearFrame, mean: Array) -> Floats:
    assert frame.noise is not None
    return frame.noise.variance(mean)


def _clear(usable: Mask, clear: Mask) -> Mask:
    """Usable samples that are expected clear of saturation; of each site at least the shortest usable one."""
    shortest = np.zeros(usable.shape, bool)
    np.put_along_axis(shortest, np.argmax(usable, axis=0)[None], True, axis=0)
    return usable & (clear | shortest)


def _ratio(numerator: Array, denominator: Array) -> Array:
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)
