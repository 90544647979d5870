"""Linear light as screens of high dynamic range show it: stills, and the codes of films.

White (1) is the picture's own white on an SDR screen. On an HDR screen it has 203 cd/m2, the reference white
of ITU-R BT.2408-7, and light goes on for `HEADROOM` stops above it. The curve of PQ: SMPTE ST 2084, as in
ITU-R BT.2100-2, table 4; that of HLG, and the gamma of its reference display: table 5.
"""

import imagecodecs
import numpy as np

from imaging.arrays import AnyArray, Array32
from imaging.colour.spaces import PRIMARIES, rec709_from_rgb

WHITE = 203.0
"""Luminance of white on an HDR screen, cd/m2."""
HEADROOM = 4.0
"""Stops above white at which light is clipped: 3248 cd/m2, more than today's screens show."""
BRIGHTEST = WHITE * 2.0**HEADROOM
"""Luminance of the brightest light, cd/m2."""
_QUALITY = 98
"""At which light of the demo is within 0.05 stops in 99 % of its pixels."""
_REC2020_FROM_REC709 = np.linalg.inv(rec709_from_rgb(PRIMARIES["rec2020"]))
_M1, _M2 = 2610 / 16384, 2523 / 32
_C1, _C2, _C3 = 3424 / 4096, 2413 / 128, 2392 / 128
_PQ_WHITE = 10_000.0
HLG_BRIGHTEST = 1000.0
"""Luminance of the brightest light of HLG's reference display, cd/m2, which shows white at WHITE, too."""
_GAMMA = 1.2
"""Exponent of that display: its luminance over that of the signal's light."""
_LUMINANCE = np.array([0.2627, 0.6780, 0.0593])
"""Shares of Rec.2020's primaries in luminance."""
_A = 0.17883277
_B, _C = 1 - 4 * _A, 0.5 - _A * np.log(4 * _A)


def pq_encode(luminance: AnyArray) -> AnyArray:
    """Code values 0..1 of light in cd/m2, which is clipped to 0..10,000, in the floats that it has."""
    power = (np.clip(luminance, 0, _PQ_WHITE) / _PQ_WHITE) ** _M1
    return np.asarray(((_C1 + _C2 * power) / (1 + _C3 * power)) ** _M2)


def hlg_encode(luminance: AnyArray) -> AnyArray:
    """Code values 0..1 with which HLG's reference display shows cd/m2 of Rec.2020's primaries [..., 3].

    Light is clipped to what it shows: 0..1000 cd/m2 of each primary, and less of saturated colours, at worst
    568 cd/m2 of blue alone.
    """
    share = np.clip(luminance, 0, HLG_BRIGHTEST) / HLG_BRIGHTEST
    bright = np.maximum(share @ _LUMINANCE, 1e-12)[..., None]
    signal = np.minimum(share * bright ** (1 / _GAMMA - 1), 1)
    above = _A * np.log(np.maximum(12 * signal - _B, 1e-12)) + _C
    return np.asarray(np.where(signal <= 1 / 12, np.sqrt(3 * signal), above))


def within(light: Array32) -> Array32:
    """Light [H, W, 3] that a screen with this headroom shows: at least 0, and clipped at its brightest."""
    return np.asarray(np.clip(np.nan_to_num(light, posinf=np.inf), 0, 2.0**HEADROOM), np.float32)


def on_screen(light: Array32) -> Array32:
    """Luminance of the primaries of Rec.2020, cd/m2 [H, W, 3], of linear Rec.709 [H, W, 3], 1 as white."""
    return within(light) @ np.float32(WHITE * _REC2020_FROM_REC709.T)


def encode_avif(light: Array32) -> bytes:
    """AVIF of linear Rec.709 [H, W, 3], 1 as white: PQ and Rec.2020 (CICP 9/16/9), 10 bits, 4:4:4."""
    codes = np.round(1023 * pq_encode(on_screen(light))).astype(np.uint16)
    kinds = imagecodecs.AVIF
    return bytes(
        imagecodecs.avif_encode(
            codes,
            _QUALITY,
            speed=8,
            bitspersample=10,
            pixelformat="444",
            primaries=kinds.COLOR_PRIMARIES.BT2020,
            transfer=kinds.TRANSFER_CHARACTERISTICS.PQ,
            matrix=kinds.MATRIX_COEFFICIENTS.BT2020_NCL,
            numthreads=1,
        )
    )
