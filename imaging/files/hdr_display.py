"""Linear light as screens of high dynamic range show it: stills, and the codes of films.

White (1) is the picture's own white on an SDR screen. On an HDR screen it has 203 cd/m2, the reference white
of ITU-R BT.2408-7, and light goes on for `HEADROOM` stops above it. The curve of PQ: SMPTE ST 2084, as in
ITU-R BT.2100-2, table 4.
"""

import imagecodecs
import numpy as np

from imaging.arrays import AnyArray, Array32
from imaging.colour import PRIMARIES, rec709_from_rgb

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


def pq_encode(luminance: AnyArray) -> AnyArray:
    """Code values 0..1 of light in cd/m2, which is clipped to 0..10,000, in the floats that it has."""
    power = (np.clip(luminance, 0, _PQ_WHITE) / _PQ_WHITE) ** _M1
    return np.asarray(((_C1 + _C2 * power) / (1 + _C3 * power)) ** _M2)


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
