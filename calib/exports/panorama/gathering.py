"""Light of several views gathered on a map, each weighted by the inverse of its variance.

A view is looked up between its pixels at several places in each texel. Its variance is averaged around each
pixel first: where it is that of one noisy value, values that are low by chance would count more. Towards its
border a view counts less, so that no step is left where one begins.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np

from calib.exports.panorama.layout import directions, solid_angles
from imaging.arrays import AnyArray, Array, Array32, Integers, Mask
from imaging.merge.picture import CLIPPED, DARK, HIDDEN, NOTHING, Picture
from imaging.optics.lens import Lens, covers, project, rays

BAND = 16
"""Rows of the map that are worked on at a time."""
BORDER = 0.12
"""Width of the border over which a view counts less, in heights of the picture."""
AROUND = 5
"""px, over which the variance is averaged."""
MOST_SAMPLES = 16
"""Along either side of a texel, for the sake of time; more is averaged in the picture first."""
COARSE = 256
"""Rows of the map on which views are compared."""
_STEP = 1e-6
"""Part of a unit vector by which a direction is moved to see how far its pixel moves."""
_COLUMNS = 1 << 14
"""Columns that are looked up at a time: cv2.remap draws fewer than 32767."""


@dataclass(frozen=True, eq=False)
class Strip:
    """One view on some rows of the map: float32 [B, 2 * rows, 3] and [B, 2 * rows].

    light: NaN where the view shows nothing. variance: infinite where the light is a bound, 0 where it is not
    known. weight: of its light, without regard to its noise. clipped: where it is a lower bound.
    """

    light: Array32
    variance: Array32
    weight: Array32
    clipped: Mask


def sampling(lens: Lens, rows: int) -> tuple[int, int]:
    """Places along either side of a texel that a view is looked up at, and px of it that are averaged first.

    They lie no farther apart than px do where the lens draws largest, so that no small lamp is missed,
    however coarse the map is, but for those in a texel that the border of the view crosses.
    """
    wanted = math.ceil(_density(lens) * np.pi / rows)
    return min(max(wanted, 2), MOST_SAMPLES), -(-wanted // MOST_SAMPLES)


def _density(lens: Lens) -> float:
    """Largest number of px to a radian that the lens has in its picture."""
    x, y = np.meshgrid(np.linspace(0, lens.width, 33), np.linspace(0, lens.height, 33))
    places = np.stack([x, y], axis=-1)
    ahead = rays(lens, places[covers(lens, places)])
    # What is projected does not depend on its distance, so that the slopes are those across the ray.
    steps = _STEP * np.eye(3)
    slopes = np.stack([project(lens, ahead + step) - project(lens, ahead - step) for step in steps], axis=-1)
    return float(np.linalg.norm(slopes, ord=2, axis=(-2, -1)).max()) / (2 * _STEP)


class SeenView:
    """A view with its lens and its turn, ready to be looked up in; usual_variance: None if not known.

    shrunk: px along either side of what is averaged to one pixel before.
    """

    def __init__(self, picture: Picture, lens: Lens, cam_from_map: Array, shrunk: int = 1) -> None:
        self.lens, self.turn = lens, cam_from_map
        height, width = picture.light.shape[:2]
        self._shrunk = shrunk = min(shrunk, height, width)
        shown = (picture.mask & (NOTHING | HIDDEN)) == 0
        self._light = np.where(shown[..., None], picture.light, np.float32(np.nan))
        bound = (picture.mask & (CLIPPED | DARK)) != 0
        variance = np.zeros_like(picture.light) if picture.sigma is None else _averaged(picture.sigma**2)
        self._variance = np.where(bound[..., None], np.float32(np.inf), variance).astype(np.float32)
        finite = variance[np.isfinite(variance) & (variance > 0)]
        self.usual_variance = float(np.median(finite)) if len(finite) else None
        inwards = np.minimum(
            *(np.minimum(at + 0.5, size - 0.5 - at) for at, size in (
                (np.arange(height)[:, None] + np.zeros((1, width)), height),
                (np.arange(width)[None] + np.zeros((height, 1)), width),
            ))
        )  # fmt: skip
        share = np.clip(inwards / (BORDER * height), 0.02, 1.0)
        self._extra = np.stack([share * share * (3 - 2 * share), (picture.mask & CLIPPED) != 0], axis=-1)
        self._extra = self._extra.astype(np.float32)
        if shrunk > 1:  # what is left over at the lower and right border is less than a pixel
            whole = np.s_[: height - height % shrunk, : width - width % shrunk]
            self._light, self._variance, self._extra = (
                _mean(each[whole], shrunk) for each in (self._light, self._variance, self._extra)
            )
        self._narrow = _narrowest(lens)

    def look(self, rows: int, first: int, last: int, samples: int) -> Strip | None:
        """Return what the view shows of rows `first` to `last` of a map of `rows` rows; None if nothing.

        samples: looked up along either side of a texel.
        """
        # Only columns that the view comes near are looked up: most views are narrow.
        narrow = np.cos(np.arccos(self._narrow) + np.pi / rows)
        near = (directions(rows, first, last) @ self.turn[2] > narrow).any(axis=0)
        fine = np.repeat(near, samples)
        ahead = directions(rows * samples, first * samples, last * samples)[:, fine] @ self.turn.T
        front = ahead[..., 2] > self._narrow
        if not front.any():
            return None
        place = np.full((*front.shape, 2), -2.0, np.float32)
        place[front] = project(self.lens, ahead[front]) / self._shrunk - 0.5
        x, y = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
        angles = solid_angles(rows * samples)[first * samples : last * samples]
        light = _mean(_looked_up(self._light, x, y, np.nan), samples, angles)
        with np.errstate(invalid="ignore"):
            variance = _mean(_looked_up(self._variance, x, y, np.inf), samples, angles)
        # Infinity times a weight of nothing between two pixels is no number.
        variance = np.where(np.isnan(variance), np.float32(np.inf), variance)
        extra = _mean(_looked_up(self._extra, x, y, 0.0), samples, angles)
        light[~np.isfinite(light).all(axis=-1)] = np.nan
        return Strip(
            _spread(light, near, np.nan), _spread(variance, near, np.inf),
            _spread(extra[..., 0], near, 0.0), _spread(np.asarray(extra[..., 1] > 0), near, False),
        )  # fmt: skip


def _spread(part: AnyArray, columns: Mask, beyond: float) -> AnyArray:
    """Columns of some rows of the map as all of them, with a value beyond."""
    whole = np.full((len(part), len(columns), *part.shape[2:]), beyond, part.dtype)
    whole[:, columns] = part
    return whole


def _looked_up(picture: Array32, x: Array32, y: Array32, beyond: float) -> Array32:
    border = (beyond,) * 4
    parts = [slice(first, first + _COLUMNS) for first in range(0, x.shape[1], _COLUMNS)]
    drawn = [
        cv2.remap(
            picture, x[:, part], y[:, part], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=border,
        )
        for part in parts
    ]  # fmt: skip
    return np.concatenate(drawn, axis=1)


def _mean(fine: Array32, samples: int, weights: Array | None = None) -> Array32:
    """Means over samples x samples places, [B, W, C]; weights: of the rows of places, [B * samples, 1]."""
    height, width, channels = fine.shape
    places = fine.reshape(height // samples, samples, width // samples, samples, channels)
    rows = np.einsum("bswtc->bswc", places) / samples  # as mean(axis=3), in a fifth of the time
    if weights is None:
        return np.asarray(rows.mean(axis=1), np.float32)
    shares = weights.reshape(-1, samples, 1, 1)
    return np.asarray((rows * (shares / shares.sum(axis=1, keepdims=True))).sum(axis=1), np.float32)


def _averaged(variance: Array32) -> Array32:
    """Variance averaged around each pixel over the finite ones; what is not finite stays."""
    finite = np.isfinite(variance)
    known = np.where(finite, variance, 0).astype(np.float32)
    size = (AROUND, AROUND)
    total, share = cv2.blur(known, size), cv2.blur(finite.astype(np.float32), size)
    return np.where(finite, total / np.maximum(share, 1e-6), np.float32(np.inf))


def _narrowest(lens: Lens) -> float:
    """Cosine of the largest angle from the axis at which the picture has a pixel."""
    x, y = np.linspace(0, lens.width, 65), np.linspace(0, lens.height, 65)
    border = [
        np.stack(np.broadcast_arrays(*side), axis=-1) for side in ((x, 0.0), (x, lens.height), (0.0, y),
                                                                   (lens.width, y))
    ]  # fmt: skip
    return float(rays(lens, np.concatenate(border))[:, 2].min())


@dataclass(frozen=True, eq=False)
class Map:
    """All views on one map.

    light, sigma: float32 [rows, 2 * rows, 3]; sigma is infinite where the light is a bound, and None if the
    noise of no view is known. mask: int [rows, 2 * rows], bits of `imaging.merge.picture`.
    """

    light: Array32
    sigma: Array32 | None
    mask: Integers


class Gathering:
    """Views added up on a map of `rows` rows, and kept on a coarser one to be compared.

    Views of unknown noise are added up apart, and count as if they had the usual variance of the others: that
    is known once all are there.
    """

    def __init__(self, rows: int) -> None:
        self.rows, shape = rows, (rows, 2 * rows)
        self.every = -(-rows // COARSE)
        self.compared: list[tuple[Array32, Array32]] = []
        self._usual = list[float]()
        self._unsure: Array32 | None = None
        """Views of unknown noise: light times weight, and weight, [rows, 2 * rows, 4]."""
        self._weight = np.zeros(shape, np.float32)
        self._light, self._variance = (np.zeros((*shape, 3), np.float32) for _ in range(2))
        self._bound = np.full((*shape, 3), -np.inf, np.float32)
        self._clipped = np.zeros(shape, bool)

    def add(self, view: SeenView, samples: int, *, noise: bool) -> None:
        """Add a view; noise: whether its variance is known."""
        if view.usual_variance is not None:
            self._usual.append(view.usual_variance)
        if not noise and self._unsure is None:
            self._unsure = np.zeros((self.rows, 2 * self.rows, 4), np.float32)
        places = len(range(0, self.rows, self.every))
        light = np.full((places, len(range(0, 2 * self.rows, self.every)), 3), np.nan, np.float32)
        variance = np.full(light.shape, np.inf, np.float32)
        for first in range(0, self.rows, BAND):
            last = min(first + BAND, self.rows)
            strip = view.look(self.rows, first, last, samples)
            if strip is None:
                continue
            self._add(slice(first, last), strip, None if noise else self._unsure)
            for row in range(first + -first % self.every, last, self.every):
                light[row // self.every] = strip.light[row - first, :: self.every]
                variance[row // self.every] = strip.variance[row - first, :: self.every]
        self.compared.append((light, variance))

    def _add(self, band: slice, strip: Strip, unsure: Array32 | None) -> None:
        """Add rows of a view; unsure: what they are added to if their noise is unknown."""
        shown: Mask = np.asarray(np.isfinite(strip.light).all(axis=-1))
        noise = strip.variance.sum(axis=-1)
        measured: Mask = shown & np.isfinite(noise) & ~strip.clipped
        light = np.where(shown[..., None], strip.light, 0)
        if unsure is not None:
            weight = np.where(measured, strip.weight, 0)[..., None]
            unsure[band] += np.concatenate([weight * light, weight], axis=-1)
        else:
            unit = self._usual[0] if self._usual else 1.0
            weight = np.where(measured, strip.weight / np.maximum(noise / unit, 1e-12), 0).astype(np.float32)
            self._weight[band] += weight
            self._light[band] += weight[..., None] * light
            self._variance[band] += (weight**2)[..., None] * np.where(measured[..., None], strip.variance, 0)
        bound = shown & ~measured
        self._bound[band] = np.maximum(
            self._bound[band], np.where(bound[..., None], strip.light, np.float32(-np.inf))
        )
        self._clipped[band] |= bound & strip.clipped

    def result(self) -> Map:
        """The map of all views that were added."""
        weight, total = self._weight, self._light
        if self._unsure is not None:
            # Noise is summed over the three colours.
            share = np.float32(self._usual[0] / (3 * np.median(self._usual)) if self._usual else 1.0)
            weight, total = weight + share * self._unsure[..., 3], total + share * self._unsure[..., :3]
        measured: Mask = np.asarray(weight > 0)
        bound: Mask = np.asarray(np.isfinite(self._bound).all(axis=-1))
        divided = np.where(measured, weight, 1)[..., None]
        light = np.where(measured[..., None], total / divided, np.where(bound[..., None], self._bound, 0))
        sigma = np.where(measured[..., None], np.sqrt(self._variance) / divided, np.inf)
        mask = np.select([measured, bound & self._clipped, bound], [0, CLIPPED, DARK], default=NOTHING)
        sigma[mask == NOTHING] = np.nan
        return Map(
            light.astype(np.float32),
            sigma.astype(np.float32) if self._unsure is None else None,
            mask.astype(np.int64),
        )
