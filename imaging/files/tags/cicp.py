"""Colour by four numbers, as videos, HEIF's `nclx` and PNG's chunk `cICP` have it.

ITU-T H.273 (2021), tables 2 to 4. PNG (third edition), 11.3.2.6: the chunk counts before a profile and all
other chunks. HEIF (ISO/IEC 23008-12): a profile counts before the numbers.
"""

import numpy as np

from imaging.arrays import Array
from imaging.colour.spaces import PRIMARIES, rec709_from_rgb, srgb_decode
from imaging.errors import InputError

UNSPECIFIED, SRGB = 2, 13
_C, _D65, _E = (0.310, 0.316), PRIMARIES["rec709"][3], (1 / 3, 1 / 3)
_SMPTE = ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65)
_P3 = (0.680, 0.320), (0.265, 0.690), (0.150, 0.060)
_POINTS: dict[int, tuple[tuple[float, float], ...]] = {
    1: PRIMARIES["rec709"],
    4: ((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), _C),
    5: ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), _D65),
    6: _SMPTE,
    7: _SMPTE,
    8: ((0.681, 0.319), (0.243, 0.692), (0.145, 0.049), _C),
    9: PRIMARIES["rec2020"],
    10: ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), _E),
    11: (*_P3, (0.314, 0.351)),
    12: (*_P3, _D65),
    22: ((0.630, 0.340), (0.295, 0.605), (0.155, 0.077), _D65),
}
"""CIE xy of red, green, blue and white by ColourPrimaries."""
_NAMES = {1: "BT.709", 9: "BT.2020", 11: "DCI-P3", 12: "Display P3"}
_HDR = {16: "PQ", 18: "HLG"}


def refuse_hdr(transfer: int, where: str) -> None:
    """InputError, without the name of the file, for the curves of HDR.

    Their codes are light up to 10,000 cd/m2, or up to what a display can do: neither is a share of white.
    """
    if transfer in _HDR:
        raise InputError(
            f"is HDR coded by {_HDR[transfer]}, as its {where} says: convert it to linear light as EXR"
        )


def name_of(primaries: int) -> str:
    """Name of ColourPrimaries in sentences."""
    return _NAMES.get(primaries, f"primaries {primaries}")


def space_of(body: bytes, bits: int, where: str = "cICP chunk") -> tuple[str, Array, Array] | None:
    """Name, light of each of 65536 codes, 0..1, and matrix [3, 3] to linear Rec.709, or None if unspecified.

    Where only the curve or only the primaries are not specified, those of sRGB count. body: the four numbers.
    bits: of a sample, 8 or 16. where: the part of the file that holds the numbers. InputError, without the
    name of the file, for what is not read.
    """
    if len(body) != 4:
        raise InputError(f"has a {where} of other than four bytes: write it again")
    primaries, transfer, matrix, full = body
    if (primaries, transfer) == (UNSPECIFIED, UNSPECIFIED):
        return None
    if matrix != 0:
        raise InputError(f"has samples that are not RGB, as its {where} says: convert it to RGB")
    refuse_hdr(transfer, where)
    points = _POINTS.get(1 if primaries == UNSPECIFIED else primaries)
    codes = np.linspace(0.0, 1.0, 65536)
    if not full:  # black at 16 and white at 235 of 8 bits
        codes = np.clip((codes * (2**bits - 1) / 2 ** (bits - 8) - 16) / 219, 0, 1)
    light = _light(SRGB if transfer == UNSPECIFIED else transfer, codes)
    if points is None or light is None:
        raise InputError(
            f"says in its {where} primaries {primaries} and curve {transfer}, which rig does not read: "
            "convert it to sRGB"
        )
    return f"{name_of(primaries)} with curve {transfer} of their {where}", light, rec709_from_rgb(points)


def _light(transfer: int, codes: Array) -> Array | None:
    """Light of codes, both 0..1, by TransferCharacteristics; None for one that is not read."""
    if transfer in (1, 6, 14, 15):  # the inverse of the camera's curve, which is what H.273 has
        return _inverse_camera(codes, 1.09929682680944, 0.018053968510807, 4.5)
    if transfer == 7:
        return _inverse_camera(codes, 1.1115, 0.0228, 4.0)
    if transfer in (4, 5):
        return np.asarray(codes ** {4: 2.2, 5: 2.8}[transfer], np.float64)
    if transfer == 8:
        return codes
    return np.asarray(srgb_decode(codes), np.float64) if transfer == SRGB else None


def _inverse_camera(codes: Array, scale: float, knee: float, slope: float) -> Array:
    """The inverse of `scale * light ** 0.45 - (scale - 1)`, which is `slope * light` below the knee."""
    power = ((codes + scale - 1) / scale) ** (1 / 0.45)
    return np.asarray(np.where(codes < slope * knee, codes / slope, power), np.float64)
