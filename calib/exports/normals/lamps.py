"""Light of known lamps as it falls in at each pixel, and whether lamps determine normals at all."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.exports.normals.fit import FEWEST
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.optics.lens import Lens, rays
from imaging.session.lamps import LampsRecord

LEAST_MATT = 0.6
"""Share of the lit pixels that fit as a matt surface, below which the lamps are not those stated."""
BEYOND, QUIET = 4.0, 0.03
"""Stated standard errors beyond which a lamp differs, and a relative difference that raises no warning."""
PLAIN = 0.05
"""Smallest singular value of the lamps' mean directions, of the largest: below it they lie in one plane."""


def check_lamps(record: LampsRecord, frames: Sequence[int], where: Path) -> None:
    """InputError unless the lamps of the frames determine a normal.

    frames: those that have been shot; where: path of the record, for the message.
    """
    missing = [frame for frame in frames if frame not in record.places]
    if missing:
        names = ", ".join(map(str, missing[:6])) + (" and more" if len(missing) > 6 else "")
        raise InputError(
            f"{where} states no lamp for frame {names}: add its place, or null where no lamp is lit."
        )
    places = np.array([place for frame in frames if (place := record.places[frame]) is not None])
    if len(places) < FEWEST:
        raise InputError(
            f"{where} has {len(places)} lamps of frames that have been shot, and a normal needs {FEWEST} or "
            "more: shoot the others."
        )
    directions = places / np.linalg.norm(places, axis=1, keepdims=True)
    sizes = np.linalg.svd(directions, compute_uv=False)
    if sizes[-1] < PLAIN * sizes[0]:
        raise InputError(
            f"{where}: all lamps lie in one plane with the things, which determines no normal: add a lamp "
            "beside that plane."
        )


def on_plane(record: LampsRecord, lens: Lens | None, width: int, height: int) -> Array | None:
    """Places of the pixels on the plane of the things.

    Args:
        record: Lamps, with the width of the plane that the picture shows, m, or None for lamps far away.
        lens: Lens of the picture; None for one without distortion.
        width: Width of the picture, px.
        height: Its height, px.

    Returns:
        Places, m, float64 [H, W, 3], x to the right and y upwards from the middle; None where lamps are far.
    """
    if record.across is None:
        return None
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.stack([x, y], axis=-1)
    middle = np.array([[0.0, height / 2], [width / 2, height / 2], [width, height / 2]])

    def tangents(points: Array) -> Array:
        if lens is None:
            return points
        ahead = rays(lens, points)
        return np.asarray(ahead[..., :2] / ahead[..., 2:])

    left_end, centre, right_end = tangents(middle)
    flat = (tangents(pixels) - centre) * (record.across / (right_end[0] - left_end[0]))
    return np.stack([flat[..., 0], -flat[..., 1], np.zeros_like(flat[..., 0])], axis=-1)


def incoming(record: LampsRecord, frames: Sequence[int], places: Array | None, pixels: int) -> Array:
    """Light that falls in from the lamp of each frame, float64 [L, P, 3]: towards it, as long as strong.

    Of a lamp of intensity 1 at the mean distance it has the length 1 at the middle of the picture.

    Args:
        record: Lamps.
        frames: Those with a lamp.
        places: Of the pixels [P, 3], m; None where lamps are far.
        pixels: P.
    """
    lamps = np.array([record.places[frame] for frame in frames], np.float64)[:, None]
    strength = np.array([record.brightness.get(frame, 1.0) for frame in frames])[:, None, None]
    distance = np.linalg.norm(lamps, axis=-1, keepdims=True)
    if places is None:
        return np.broadcast_to(strength * lamps / distance, (len(frames), pixels, 3))
    towards = lamps - places
    return np.asarray(
        strength * np.mean(distance) ** 2 * towards / np.linalg.norm(towards, axis=-1, keepdims=True) ** 3
    )


def differences(
    ratios: Array, matt: float, record: LampsRecord, frames: Sequence[int], where: Path
) -> tuple[float, tuple[str, ...]]:
    """Relative difference of the lamps' light from that of the fit, and a warning for each lamp that differs.

    InputError if the light is that of other lamps altogether.

    Args:
        ratios: Light of each lamp over what the fit expects [L, S]; NaN where nothing can be said.
        matt: Share of the pixels that three lamps light which fit as a matt surface, 0..1.
        record: Lamps.
        frames: Those with a lamp.
        where: Path of the record, for the message.
    """
    if matt < LEAST_MATT:
        raise InputError(
            f"{where}: only {100 * matt:.0f} % of the lit pixels fit a Lambertian surface: check the order, "
            "places (x right, y up, z towards the camera) and brightness of the lamps, and the width across, "
            "unless the object is mostly specular."
        )
    shown = [row[np.isfinite(row)] for row in ratios]
    every = np.concatenate(shown)
    misfit = 1.4826 * float(np.median(np.abs(every - 1.0))) if len(every) else 0.0
    warnings = []
    for frame, row in zip(frames, shown, strict=True):
        off = float(np.median(row)) - 1.0 if len(row) else 0.0
        if abs(off) > max(BEYOND * record.spread, QUIET):
            warnings.append(
                f"The lamp of frame {frame} has {100 * abs(off):.0f} % {'more' if off > 0 else 'less'} light "
                f"than {where.name} and the other lamps say: it is left out where it differs."
            )
    return misfit, tuple(warnings)
