"""Maps of tones: linear light, 1 as white, to the codes of an sRGB screen.

ACES 2.0 is the Academy's output transform as OpenColorIO computes it. AgX is Troy Sobotka's, by the fit of
its curve that three.js and Filament draw with (B. Wrensch, Minimal AgX Implementation, 2023). Filmic is John
Hable's curve (Uncharted 2: HDR Lighting, GDC 2010), with the constants of his article, as colour-hdri has it.
"""

from functools import cache

import numpy as np
import PyOpenColorIO as ocio

from imaging.arrays import Array32, Bytes
from imaging.colour.spaces import srgb_encode

_CONFIG, _SOURCE, _DISPLAY = "cg-config-v4.0.0_aces-v2.0_ocio-v2.5", "Linear Rec.709 (sRGB)", "sRGB - Display"
_VIEW = "ACES 2.0 - SDR 100 nits (Rec.709)"
_BRIGHTEST = 65504.0
"""Largest input of the output transform: float16."""
_CODES = 1 << 16

_AGX_INTO = np.array(
    [
        [0.856627153315983, 0.0951212405381588, 0.0482516061458583],
        [0.137318972929847, 0.761241990602591, 0.101439036467562],
        [0.11189821299995, 0.0767994186031903, 0.811302368396859],
    ]
)
_AGX_OUT_OF = np.array(
    [
        [1.1271005818144368, -0.11060664309660323, -0.016493938717834573],
        [-0.1413297634984383, 1.157823702216272, -0.016493938717834257],
        [-0.14132976349843826, -0.11060664309660294, 1.2519364065950405],
    ]
)
_AGX_STOPS = -12.47393, 4.026069
"""log2 of the light at the ends of its curve."""
_AGX_CURVE = (15.5, -40.14, 31.96, -6.868, 0.4298, 0.1191, -0.00232)
"""Coefficients from its sixth to its zeroth power."""
_REC2020_FROM_REC709 = np.array(
    [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]]
)
"""ITU-R BT.2087."""
_FILMIC = 0.22, 0.30, 0.10, 0.20, 0.01, 0.30
_FILMIC_BIAS, _FILMIC_WHITE = 2.0, 11.2


def linear(light: Array32) -> Bytes:
    """Clipped at white, and encoded: no tone is moved."""
    return _encoded(light)


def aces(light: Array32) -> Bytes:
    """Tone map by the output transform of ACES 2.0 for an SDR screen of 100 nits."""
    values = np.ascontiguousarray(np.minimum(light, _BRIGHTEST), np.float32)
    _output_transform().applyRGB(values)
    return np.asarray(np.round(255 * np.clip(np.nan_to_num(values), 0, 1)), np.uint8)


def agx(light: Array32) -> Bytes:
    """AgX, without a look."""
    into = (_AGX_INTO @ _REC2020_FROM_REC709).astype(np.float32)
    out_of = (np.linalg.inv(_REC2020_FROM_REC709)).astype(np.float32)
    low, high = _AGX_STOPS
    most = np.float32(2.0 ** (high + 8))
    inside = np.clip(light, -most, most) @ into.T
    place = np.clip((np.log2(np.maximum(inside, 2.0**-24)) - low) / (high - low), 0, 1)
    curve = np.zeros_like(place)
    for factor in _AGX_CURVE:
        curve *= place
        curve += np.float32(factor)
    back = np.maximum(curve @ _AGX_OUT_OF.T.astype(np.float32), 0) ** np.float32(2.2)
    return _encoded(back @ out_of.T)


def filmic(light: Array32) -> Bytes:
    """Hable's curve of each channel."""
    shown = _filmic_curve(_FILMIC_BIAS * np.clip(light, 0, np.float32(1e4)))
    return _encoded(shown / np.float32(_filmic_curve(np.float32(_FILMIC_WHITE))))


def _filmic_curve(x: Array32 | np.float32) -> Array32:
    a, b, c, d, e, f = (np.float32(value) for value in _FILMIC)
    return np.asarray((x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f, np.float32)


def _encoded(light: Array32) -> Bytes:
    """sRGB of clipped light, to a fortieth of a code: a table is a dozen times as fast as its power."""
    place = np.clip(light, 0, 1) * np.float32(_CODES - 1) + np.float32(0.5)
    return _srgb()[place.astype(np.uint16)]


@cache
def _srgb() -> Bytes:
    return np.asarray(np.round(255 * srgb_encode(np.arange(_CODES) / (_CODES - 1))), np.uint8)


@cache
def _output_transform() -> ocio.CPUProcessor:
    config = ocio.Config.CreateFromBuiltinConfig(_CONFIG)
    transform = config.getProcessor(_SOURCE, _DISPLAY, _VIEW, ocio.TRANSFORM_DIR_FORWARD)
    return transform.getDefaultCPUProcessor()
