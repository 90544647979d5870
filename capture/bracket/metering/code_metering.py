"""The meter's view of a camera that develops its own photographs: see capture.bracket.metering.meter."""

import math
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from capture.bracket.code_noise import BRIGHTEST, DARKEST, CodeNoise
from capture.bracket.metering.percentile import (
    BRIGHT_PERCENTILE,
    BRIGHT_SHARE,
    DARK_PERCENTILE,
    DARK_SHARE,
    TAKES,
    percentile,
    subsampled,
    without_hot_pixels,
)
from capture.bracket.planner import Target
from imaging.arrays import Array, Array32
from imaging.optics.exposure import Exposure

PAIRS = 20_000
"""Codes that are compared from one probe to the next."""
_LARGEST = np.float32(65_535)
"""Largest of the whole numbers that hold codes of 8 and 16 bits exactly."""


class CodeLook:
    """Photographs of one camera so far, by exposure."""

    spacing = 2.0
    """Stops between the probes: most pixels are well exposed in two of them, which determines the tone
    curve.
    """

    def __init__(self) -> None:
        self._probes: dict[Exposure, dict[tuple[int, int], npt.NDArray[np.uint16]]] = {}

    def add(self, exposure: Exposure, position: int, take: int, codes: Array32) -> None:
        """Keep a photograph, its codes [H, W, 3] in 0..1, or a sufficient sample of a large one."""
        stored = np.rint(subsampled(codes) * _LARGEST).astype(np.uint16)
        self._probes.setdefault(exposure, {})[position, take] = stored

    def clips(self, exposure: Exposure) -> bool:
        """Return whether the bright percentile of any channel is beyond the trusted codes."""
        return bool((self._all(exposure) > BRIGHTEST).mean(axis=0).max() > BRIGHT_SHARE)

    def lit(self, exposure: Exposure) -> bool:
        """Return whether the dark percentile of every channel is among the trusted codes."""
        return bool((self._all(exposure) < DARKEST).mean(axis=0).max() <= DARK_SHARE)

    def glare(self, exposure: Exposure) -> float:
        """The share of the photographs that is beyond the trusted codes."""
        return float((self._all(exposure) > BRIGHTEST).mean())

    def targets(self, name: str) -> list[Target]:
        """The range of each channel."""
        ascending = sorted(self._probes, key=lambda exposure: exposure.stops)
        shortest, longest = ascending[0], ascending[-1]
        noise = self._noise(ascending)
        first, other = (self._radiance(ascending, take, noise) for take in range(TAKES))
        targets = []
        for channel, letter in enumerate("RGB"):
            dark = percentile(first[:, channel], other[:, channel], DARK_PERCENTILE)
            bright = percentile(first[:, channel], other[:, channel], BRIGHT_PERCENTILE)
            below = (self._all(longest)[:, channel] < DARKEST).mean()
            above = (self._all(shortest)[:, channel] > BRIGHTEST).mean()
            targets.append(
                Target(
                    camera=name,
                    channel=letter,
                    noise=noise,
                    dark=dark,
                    bright=max(bright, dark),
                    no_darker=bool(below <= DARK_SHARE),
                    no_brighter=bool(above <= BRIGHT_SHARE),
                )
            )
        return targets

    def _all(self, exposure: Exposure) -> Array32:
        """Every pixel of an exposure, [N, 3]."""
        stored = np.concatenate([codes.reshape(-1, 3) for codes in self._probes[exposure].values()])
        return stored.astype(np.float32) / _LARGEST

    def _take(self, exposure: Exposure, take: int) -> Array32:
        """Photographs of one take at all positions, one below the other, [H, W, 3]."""
        photos = self._probes[exposure]
        stored = np.concatenate([photos[key] for key in sorted(photos) if key[1] == take])
        return stored.astype(np.float32) / _LARGEST

    def _noise(self, ascending: list[Exposure]) -> CodeNoise:
        """The tone curve, from what becomes of a pixel's code from one probe to the next."""
        lower, upper, stops = ([np.zeros(0)] for _ in range(3))
        for shorter, longer in pairwise(ascending):
            short, other = self._take(shorter, 0).ravel(), self._take(longer, 0).ravel()
            tight = np.flatnonzero((short >= DARKEST) & (other <= BRIGHTEST) & (other > short))
            tight = tight[:: max(1, math.ceil(len(tight) / PAIRS))]
            lower.append(short[tight].astype(np.float64))
            upper.append(other[tight].astype(np.float64))
            stops.append(np.full(len(tight), longer.stops - shorter.stops))
        return CodeNoise.of(np.concatenate(lower), np.concatenate(upper), np.concatenate(stops))

    def _radiance(self, ascending: list[Exposure], take: int, noise: CodeNoise) -> Array:
        """Radiance [N, 3] by the brightest trusted code; a bound at either end of what was probed."""
        radiance = np.full(self._take(ascending[0], take).shape, noise.brightest(ascending[0]))
        for exposure in ascending:
            codes = self._take(exposure, take)
            np.copyto(radiance, noise.light_of(codes) / exposure.scale, where=codes <= BRIGHTEST)
        return np.stack([without_hot_pixels(radiance[..., channel]).ravel() for channel in range(3)], axis=-1)
