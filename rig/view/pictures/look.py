"""Display of linear light on a screen of 8 bits: an exposure, and a tone map."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Literal, get_args

import cv2
import numpy as np

from imaging.arrays import Array32, Bytes, Mask
from recon.result.first_look import beginning
from rig.view.pictures import tones

ToneMap = Literal["linear", "ACES 2.0", "AgX", "filmic", "false colour", "clipping"]
TONE_MAPS: tuple[ToneMap, ...] = get_args(ToneMap)

MIDDLE_GREY = 0.18
STOPS = 8.0
"""Range of false colour on either side of middle grey, stops."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
"""Luminance weights of linear Rec.709 (ITU-R BT.709)."""
_BRIGHT, _DARK = (255, 0, 80), (40, 90, 255)
CURVES: dict[str, Callable[[Array32], Bytes]] = {
    "linear": tones.linear,
    "ACES 2.0": tones.aces,
    "AgX": tones.agx,
    "filmic": tones.filmic,
}


@dataclass(frozen=True)
class Look:
    """exposure: stops that light is made brighter by, beyond what shows the scene's median as middle grey."""

    exposure: float = 0.0
    tones: ToneMap = "linear"

    def shown(self, light: Array32, scale: float) -> Bytes:
        """Linear Rec.709 [H, W, 3] for a screen, uint8; `scale` shows the scene's median as middle grey."""
        factor = scale * 2.0**self.exposure
        with np.errstate(over="ignore"):  # what is beyond float32 is white all the same
            return self._mapped(np.nan_to_num(light, posinf=3e38), factor)

    def _mapped(self, light: Array32, factor: float) -> Bytes:
        if self.tones == "false colour":
            return bands(stops(light, factor))
        shown = light * np.float32(factor)
        return _clipped(shown) if self.tones == "clipping" else CURVES[self.tones](shown)


def first_look(exposure: float, shot_at: float | None) -> Look:
    """Return the look that a scene begins with; arguments as of `recon.result.first_look.beginning`."""
    return Look(*beginning(exposure, shot_at))


def stops(light: Array32, factor: float) -> Array32:
    """Stops of luminance times a factor above middle grey, [H, W]; minus infinity where there is no light."""
    with np.errstate(divide="ignore", invalid="ignore"):
        result = np.log2(np.maximum(light @ LUMINANCE, 0) * np.float32(factor / MIDDLE_GREY))
    return np.asarray(result, np.float32)


def coloured(values: Array32, most: float = STOPS) -> Bytes:
    """Colours [H, W, 3] of stops [H, W] from -most (dark blue) to most (dark red); black: no light at all."""
    return ramp(np.nan_to_num(values / (2 * most)) + 0.5, np.isfinite(values))


def bands(values: Array32) -> Bytes:
    """Colours [H, W, 3] of stops [H, W], one for each whole stop; black: no light at all."""
    with np.errstate(invalid="ignore"):
        return coloured(np.round(values))


def ramp(place: Array32, there: Mask) -> Bytes:
    """Colours [H, W, 3] of places 0..1 [H, W] from dark blue to dark red; black where nothing is `there`."""
    code = np.uint8(np.round(255 * np.clip(np.nan_to_num(place), 0, 1)))
    return np.where(there[..., None], _turbo()[code], np.uint8(0))


def legend(most: float = STOPS) -> Bytes:
    """The colours of `coloured` from left to right, uint8 [12, 256, 3]."""
    return coloured(np.tile(np.linspace(-most, most, 256, dtype=np.float32), (12, 1)), most)


def band_legend() -> Bytes:
    """The colours of `bands` from left to right with numbers below, uint8 [26, 272, 3]."""
    whole = np.arange(-STOPS, STOPS + 1, dtype=np.float32)
    picture = np.zeros((26, 16 * len(whole), 3), np.uint8)
    picture[:12] = bands(np.tile(whole.repeat(16), (12, 1)))
    for place, value in enumerate(whole):
        if value % 4 == 0:
            text = f"{value:+.0f}" if value else "0"
            (wide, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.35, 1)
            start = min(max(0, 16 * place + 8 - wide // 2), picture.shape[1] - wide)
            cv2.putText(
                picture, text, (start, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.35, (220, 220, 220), 1, cv2.LINE_AA
            )
    return picture


def _clipped(light: Array32) -> Bytes:
    """Grey, but red where a channel is at white or above, and blue where all are below the first code."""
    shown = tones.linear(light)
    grey = np.repeat(shown.mean(axis=2, keepdims=True).astype(np.uint8), 3, axis=2)
    grey[(shown == 255).any(axis=2)] = _BRIGHT
    grey[(shown == 0).all(axis=2)] = _DARK
    return grey


@cache
def _turbo() -> Bytes:
    """Google's turbo, uint8 [256, 3]."""
    ramp = np.arange(256, dtype=np.uint8)[:, None]
    return np.asarray(cv2.applyColorMap(ramp, cv2.COLORMAP_TURBO)[:, 0, ::-1], np.uint8)
