"""ColorVideoVDP, where it is installed (`pip install cvvdp`), of as many views as there is time for.

How different two pictures look to people on a stated screen (Mantiuk et al., SIGGRAPH 2024), in JOD: 10
where no difference is visible, 9 where three of four people see it.
"""

import logging
import math
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch

from imaging.arrays import Array32
from recon.measure.flip import LightPair, Pair
from recon.measure.pace import Clock, Pace

SCREEN = "standard_4k"
"""Screen of pictures: 30 inches of 3840 px, 200 cd/m2, in an office, seen from twice its height."""
LIGHT_SCREEN, PEAK = "standard_hdr_linear", 1500.0
"""Screen of light and its peak, cd/m2: the same size and distance, in dim light."""
WHITE = 203.0
"""Luminance that white is shown at where the scale of light is not known, cd/m2: that of HDR video (ITU-R
BT.2408)."""
LEAST_SIDE = 8
"""px; a narrower picture has no contrast at any scale of the metric."""


class Vdp:
    """JOD of the pictures and of the light of `count` views, until `until`, a reading of `clock`."""

    def __init__(self, count: int, until: float, clock: Clock = time.monotonic) -> None:
        self.pictures, self.light = Pace(count, until, clock), Pace(count, until, clock)
        self._clock = clock
        self._pixel_seconds = 0.0

    def of(self, pairs: Sequence[Pair], light: LightPair | None) -> dict[str, float]:
        """JOD by kind, the mean over the pictures of a view; of the kinds that there is time for."""
        metric, light_metric = _metric(SCREEN), _metric(LIGHT_SCREEN)
        if metric is None or light_metric is None:
            return {}
        pairs = [pair for pair in pairs if min(pair.valid.shape) >= LEAST_SIDE]
        light = None if light is None or min(light.valid.shape) < LEAST_SIDE else light
        values: dict[str, float] = {}
        pixels = sum(pair.valid.size for pair in pairs)
        if pairs and self.pictures.takes(pixels * self._pixel_seconds):
            began = self._clock()
            values["vdp_jod"] = float(np.mean([metric(*_masked(pair)) for pair in pairs]))
            self._pixel_seconds = (self._clock() - began) / pixels
        if light is not None and self.light.takes(light.valid.size * self._pixel_seconds):
            ours, truth = (np.clip(side * np.float32(light.nits), 0, PEAK) for side in _masked(light))
            values["hdr_vdp_jod"] = light_metric(ours, truth)
        return {name: value for name, value in values.items() if math.isfinite(value)}

    def left_out(self) -> list[str]:
        """The kinds that there was not time for of all views, in words."""
        return [
            f"{name} of {pace.taken or 'none'}"
            for name, pace in (("ColorVideoVDP", self.pictures), ("ColorVideoVDP of light", self.light))
            if pace.taken < pace.turns
        ]


def trouble() -> str | None:
    """Return why the package, although it is installed, gives no figures, as a sentence; None if it does."""
    package = _package()
    if not isinstance(package, Exception):
        return None
    return (
        f"ColorVideoVDP is installed but does not start ({package}): install a torchvision that fits torch."
    )


def nits(exposure: float, luminance: tuple[float, float] | None) -> float:
    """Return what a unit of light is shown at, cd/m2.

    Args:
        exposure: Factor that takes the middle of the scene to middle grey.
        luminance: Of a unit of light, cd/m2, and its standard error; None if it is not known.
    """
    return exposure * WHITE if luminance is None else luminance[0]


def _masked(pair: Pair | LightPair) -> tuple[Any, Any]:
    """Both sides, alike where they are masked, so that it does not shine into its neighbours."""
    reference = pair.reference if isinstance(pair, Pair) else pair.truth
    return np.where(pair.valid[..., None], pair.ours, reference), reference


@cache
def _package() -> Any:
    """The package; None if it is not installed, the exception if it does not start."""
    if find_spec("pycvvdp") is None:
        return None
    try:
        import pycvvdp
    except (ImportError, RuntimeError) as error:  # RuntimeError: torchvision is of another build than torch
        return error
    return pycvvdp


@cache
def _metric(screen: str) -> Callable[[Array32, Array32], float] | None:
    """The metric on a screen, of a picture and its reference [H, W, 3]; None if it cannot be had."""
    package = _package()
    if package is None or isinstance(package, Exception):
        return None
    metric = package.cvvdp(display_name=screen, device=torch.device("cpu"), quiet=True)

    def compare(ours: Array32, reference: Array32) -> float:
        before = logging.root.manager.disable
        logging.disable(logging.WARNING)  # it warns of dark pictures, whatever their unit
        try:
            return float(metric.predict(ours, reference, dim_order="HWC")[0])
        finally:
            logging.disable(before)

    return compare
