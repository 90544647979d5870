"""FLIP, where it is installed (`pip install -e '.[metrics]'`), of as many views as there is time for.

Of pictures (Andersson et al., HPG 2020) and of light (HDR-FLIP, EGSR 2021).
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from imaging.arrays import Array32, Bytes, Mask
from recon.measure.pace import Clock, Pace

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
ACES_TOP = 2.1188723239873153
"""Light that the tone curve of HDR-FLIP, Narkowicz's fit of ACES at 0.6 times the light, takes to 0.85."""


@dataclass(frozen=True, eq=False)
class Pair:
    """A render and its reference as a display shows them, sRGB [H, W, 3]; valid [H, W]: not masked."""

    name: str
    ours: Bytes
    reference: Bytes
    valid: Mask


@dataclass(frozen=True, eq=False)
class LightPair:
    """Rendered and true light of a view, linear Rec.709 [H, W, 3]; valid [H, W]: not masked; nits: cd/m2 at
    which a unit of light is shown.
    """

    ours: Array32
    truth: Array32
    valid: Mask
    nits: float


class Flips:
    """FLIP and HDR-FLIP of `count` views, one after the other, until `until`, a reading of `clock`.

    HDR-FLIP takes as long as FLIP of as many pictures as it has exposures.
    """

    def __init__(self, count: int, until: float, clock: Clock = time.monotonic) -> None:
        self.pictures, self.light = Pace(count, until, clock), Pace(count, until, clock)
        self._clock = clock
        self._installed = find_spec("flip_evaluator") is not None
        self._pixel_seconds = 0.0

    def of(self, pairs: Sequence[Pair], light: LightPair | None) -> dict[str, list[Array32]]:
        """Errors [N] of the pixels that are seen, by kind; of the kinds that there is time for."""
        if not self._installed:
            return {}
        errors: dict[str, list[Array32]] = {}
        pixels = sum(pair.valid.size for pair in pairs)
        if pairs and self.pictures.takes(pixels * self._pixel_seconds):
            began = self._clock()
            errors["flip"] = [error for pair in pairs if (error := _flip(pair)) is not None]
            self._pixel_seconds = (self._clock() - began) / pixels
        exposures = None if light is None else _exposures(light.truth)
        if light is not None and exposures is not None:
            expected = light.valid.size * exposures["numExposures"] * self._pixel_seconds
            if self.light.takes(expected):
                error = hdr_flip(light.ours, light.truth, light.valid)
                errors["hdr_flip"] = [] if error is None else [error]
        return errors

    def left_out(self) -> list[str]:
        """The kinds that there was not time for of all views, in words."""
        return [
            f"{name} of {pace.taken or 'none'}"
            for name, pace in (("FLIP", self.pictures), ("HDR-FLIP", self.light))
            if pace.taken < pace.turns
        ]


def _flip(pair: Pair) -> Array32 | None:
    ours, reference = (np.asarray(side / np.float32(255), np.float32) for side in (pair.ours, pair.reference))
    return _compared(ours, reference, pair.valid, "LDR", {})


def hdr_flip(light: Array32, truth: Array32, visible: Mask) -> Array32 | None:
    """HDR-FLIP of the pixels that are seen, of linear Rec.709 [H, W, 3]; None where it has no exposures."""
    exposures = _exposures(truth)
    if exposures is None:
        return None
    middle = _middle_and_top(truth)[0]
    ours, reference = (np.maximum(side / np.float32(middle), 0) for side in (light, truth))
    return _compared(ours, reference, visible, "HDR", exposures)


def _exposures(truth: Array32) -> dict[str, Any] | None:
    """Exposures of HDR-FLIP, of light over its median; None for light without contrast.

    They are those that FLIP finds by itself, from the one at which the median of the truth is bright to the
    one at which its maximum is. They are given to it since it ends the process where they coincide.
    """
    middle, top = _middle_and_top(truth)
    if not 0 < middle < top or not math.isfinite(top / middle):
        return None
    start, stop = math.log2(ACES_TOP * middle / top), math.log2(ACES_TOP)
    return {
        "startExposure": start,
        "stopExposure": stop,
        "numExposures": max(2, math.ceil(stop - start)),
    }


def _middle_and_top(truth: Array32) -> tuple[float, float]:
    luminance = np.maximum(truth, 0) @ LUMINANCE
    return float(np.median(luminance)), float(luminance.max())


def _compared(
    ours: Array32, reference: Array32, visible: Mask, kind: str, parameters: dict[str, Any]
) -> Array32 | None:
    if not visible.any():
        return None
    import flip_evaluator

    # What is masked is alike, so that it does not shine into its neighbours.
    ours = np.where(visible[..., None], ours, reference)
    errors = flip_evaluator.evaluate(
        np.ascontiguousarray(reference), np.ascontiguousarray(ours), kind, True, False, True, parameters
    )
    return np.asarray(errors[0][..., 0][visible], np.float32)
