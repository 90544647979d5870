"""The few colour matrices and curves that `rig` needs; matrices act on column vectors.

Rec.709: ITU-R BT.709-6, white D65; Rec.2020: ITU-R BT.2020-2; AP0 and AP1: SMPTE ST 2065-1 and
AMPAS S-2014-004; the sRGB curve: IEC 61966-2-1. Whites are adapted as the ACES transforms do it, by
Bradford's matrix (Lam 1985).
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Array, Array32
from imaging.choices import SPACE_PRIMARIES, Space

PRIMARIES: dict[str, tuple[tuple[float, float], ...]] = {
    "rec709": ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)),
    "rec2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), (0.3127, 0.3290)),
    "ap0": ((0.7347, 0.2653), (0.0, 1.0), (0.0001, -0.077), (0.32168, 0.33767)),
    "ap1": ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767)),
}
"""CIE 1931 xy of red, green, blue and white."""


def xyz_from_rgb(primaries: Sequence[tuple[float, float]]) -> Array:
    """float64 [3, 3] from linear RGB to CIE XYZ, Y = 1 for RGB (1, 1, 1); SMPTE RP 177."""
    red, green, blue, white = (np.array((x, y, 1.0 - x - y)) for x, y in primaries)
    columns = np.stack([red, green, blue], axis=1)
    return np.asarray(columns * np.linalg.solve(columns, white / white[1]), np.float64)


XYZ_FROM_REC709 = xyz_from_rgb(PRIMARIES["rec709"])
REC709_FROM_XYZ = np.linalg.inv(XYZ_FROM_REC709)

_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def adaptation(white: tuple[float, float], to: tuple[float, float]) -> Array:
    """float64 [3, 3], XYZ under one white (CIE xy) to XYZ of what looks alike under another."""
    before, after = (_BRADFORD @ (np.array((x, y, 1.0 - x - y)) / y) for x, y in (white, to))
    return np.asarray(np.linalg.inv(_BRADFORD) @ np.diag(after / before) @ _BRADFORD, np.float64)


def rec709_from_rgb(primaries: Sequence[tuple[float, float]]) -> Array:
    """float64 [3, 3], linear RGB of these primaries and white to linear Rec.709; white stays (1, 1, 1).

    ValueError when these are no primaries of a space: all on one line, or without a white.
    """
    with np.errstate(all="ignore"):
        try:
            adapted = adaptation(primaries[3], PRIMARIES["rec709"][3]) @ xyz_from_rgb(primaries)
        except (np.linalg.LinAlgError, ZeroDivisionError):
            adapted = np.full((3, 3), np.nan)
    if not np.all(np.isfinite(adapted)) or abs(np.linalg.det(adapted)) < 1e-9:
        raise ValueError("the primaries span no space")
    return np.asarray(REC709_FROM_XYZ @ adapted, np.float64)


def space_from_rec709(space: Space) -> Array:
    """float64 [3, 3], linear Rec.709 to the linear RGB of a space; white stays (1, 1, 1)."""
    if space == "rec709":
        return np.eye(3)  # exactly: no rounding where nothing is to be done
    return np.asarray(np.linalg.inv(rec709_from_rgb(PRIMARIES[SPACE_PRIMARIES[space]])), np.float64)


def camera_from_rec709(camera_from_xyz: npt.ArrayLike) -> Array:
    """Linear Rec.709 to camera RGB (RGBW), float64 [channels, 3], its green row summing to 1.

    `camera_from_xyz` [channels, 3] is a DNG ColorMatrix for D65, of any scale. ValueError if it is not
    finite, not invertible or blind to white in green.
    """
    matrix = np.asarray(camera_from_xyz, np.float64) @ XYZ_FROM_REC709
    green = matrix[1].sum()
    if not np.all(np.isfinite(matrix)) or not green > 0 or abs(np.linalg.det(matrix[:3] / green)) < 1e-9:
        raise ValueError("the matrix from XYZ to camera RGB is singular or has no green")
    return np.asarray(matrix / green, np.float64)


def unmeasured(channels: int) -> Array:
    """Matrix from linear Rec.709 to a camera of unknown colour response, float64 [channels, 3].

    R, G and B are taken for Rec.709's; what has no filter (W) for their sum; mono for the mean, so that a
    scene that it alone sees is grey.
    """
    if channels == 1:
        return np.full((1, 3), 1.0 / 3.0)
    return np.concatenate([np.eye(3), np.ones((channels - 3, 3))])


def of_channels(matrix: Sequence[Sequence[float]] | None, channels: int) -> Array:
    """camera_from_rec709 with a row for each channel, float64 [channels, 3]; None as `unmeasured` has it.

    Where only R, G and B were measured, what has no filter is taken for their sum.
    """
    if matrix is None:
        return unmeasured(channels)
    rows = np.asarray(matrix, np.float64)
    return rows if len(rows) == channels else np.concatenate([rows, rows.sum(0, keepdims=True)])


def with_rgb(matrix: npt.ArrayLike, rgb: npt.ArrayLike) -> Array:
    """camera_from_rec709 [channels, 3] with other R, G and B; W stays the mixture of them that it was."""
    before, after = np.asarray(matrix, np.float64), np.asarray(rgb, np.float64)
    return (
        np.concatenate([after, before[3:] @ np.linalg.inv(before[:3]) @ after]) if len(before) > 3 else after
    )


def rec709_from_camera(matrix: npt.ArrayLike) -> Array:
    """The inverse [3, channels] of camera_from_rec709 [channels, 3]: by least squares of more than three
    channels, grey of one."""
    rows = np.asarray(matrix, np.float64)
    return np.asarray(np.linalg.inv(rows) if len(rows) == 3 else np.linalg.pinv(rows))


def balanced(light: Array32, neutral: Sequence[float] | None) -> Array32:
    """Camera light [..., channels] as RGB in which a neutral surface is grey: W left out, mono repeated.

    neutral: what the camera sees of such a surface; default: the same in all channels.
    """
    if light.shape[-1] == 1:
        return np.repeat(light, 3, axis=-1)
    rgb = light[..., :3]
    if neutral is None:
        return rgb
    return np.asarray(rgb / np.maximum(np.asarray(neutral[:3], np.float32), np.float32(1e-3)), np.float32)


def srgb_encode(linear: npt.ArrayLike, *, end: float = 1.0) -> AnyArray:
    """Linear light to sRGB code values (0..1 to 0..1); codes outside 0..end are clipped, above 1 the formula
    goes on.
    """
    light = np.clip(_floating(linear), 0.0, 1.0 if end == 1 else ((end + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055))


def srgb_decode(code: npt.ArrayLike, *, end: float = 1.0) -> AnyArray:
    """sRGB code values (0..end) to linear light; the inverse of `srgb_encode`."""
    value = np.clip(_floating(code), 0.0, end)
    return np.asarray(np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4))


def _floating(values: npt.ArrayLike) -> AnyArray:
    array = np.asarray(values)
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)
