"""Turns between pairs of views, robustly, and the lens with which most matches are nothing but turns."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.data.features import MatchedPair
from imaging.arrays import Array, Mask
from imaging.optics.lens import Lens, rays
from imaging.session.view_id import ViewId

HYPOTHESES = 40
"""Turns that two matches each propose for a pair."""
TOLERANCE = 0.01
"""Largest miss of a match, in widths of the picture: of a lens whose distortion is not known yet."""
SHARE = 0.85
"""Share of the matches of a pair, in the median, that a turn has to explain."""
LEAST_TURN = np.radians(5.0)
"""Views that turn by less than this, all of them, determine no lens."""
_ASKED, _MATCHES = 10, 80
_KNOWN, _UNKNOWN = np.geomspace(0.85, 1.18, 7), np.geomspace(0.3, 2.5, 24)
"""Factors on the focal length that files state, and focal lengths of others in widths of the picture."""


@dataclass(frozen=True, eq=False)
class Turn:
    """R of `ray_other = R ray_one`, float64 [3, 3], the matches that fit, bool [M], and their share."""

    rotation: Array
    fits: Mask

    @property
    def share(self) -> float:
        """Share of the matches that fit."""
        return float(self.fits.mean())

    @property
    def angle(self) -> float:
        """Angle of the turn, radians."""
        return float(np.arccos(np.clip((np.trace(self.rotation) - 1) / 2, -1, 1)))


def turning_lenses(
    pairs: Mapping[tuple[ViewId, ViewId], MatchedPair],
    lenses: Mapping[str, Lens],
    held: Collection[str],
    focal_known: Collection[str],
) -> dict[str, Lens] | None:
    """The lenses with which most matches are those of a camera that only turned; None if none are.

    Args:
        pairs: Matches by pair of views.
        lenses: First guess of each camera's lens.
        held: Cameras whose lenses are known.
        focal_known: Cameras whose focal length is known roughly.

    Returns:
        Lenses without distortion, or equidistant ones; those of `held` as they are.
    """
    asked = [(views, _thinned(pair)) for views, pair in list(pairs.items())[:: -(-len(pairs) // _ASKED)]]
    best: tuple[float, dict[str, Lens]] = (0.0, {})
    rough = set(lenses) - set(held) - set(focal_known)
    for factor in _UNKNOWN if rough else _KNOWN if set(lenses) - set(held) else (1.0,):
        for fisheye in (False, True):
            tried = {
                name: lens
                if name in held
                else _ideal(lens, factor * (lens.width if rough else lens.fx), fisheye or lens.fisheye)
                for name, lens in lenses.items()
            }
            turns = _turns(asked, tried)
            if max(turn.angle for turn in turns) > LEAST_TURN:
                best = max(best, (float(np.median([turn.share for turn in turns])), tried), key=_score)
    return best[1] if best[0] >= SHARE else None


def _turns(
    asked: Sequence[tuple[tuple[ViewId, ViewId], MatchedPair]], lenses: Mapping[str, Lens]
) -> list[Turn]:
    """Turns of pairs, until the median of all is sure to fail."""
    turns: list[Turn] = []
    for (one, other), pair in asked:
        turns.append(turn_of(pair, lenses[one.camera], lenses[other.camera]))
        if 2 * sum(turn.share < SHARE for turn in turns) > len(asked):
            break
    return turns


def _thinned(pair: MatchedPair) -> MatchedPair:
    step = -(-len(pair.one) // _MATCHES)
    return MatchedPair(pair.one[::step], pair.other[::step], pair.index[::step])


def _score(tried: tuple[float, Any]) -> float:
    return tried[0]


def _ideal(lens: Lens, focal: float, fisheye: bool) -> Lens:
    return Lens(
        model="OPENCV_FISHEYE" if fisheye else "OPENCV",
        width=lens.width,
        height=lens.height,
        fx=focal,
        fy=focal,
        cx=lens.cx,
        cy=lens.cy,
    )


def turn_of(pair: MatchedPair, one: Lens, other: Lens) -> Turn:
    """The turn that explains most matches of a pair, by random sampling and then by all that fit."""
    every = rays(one, pair.one), rays(other, pair.other)
    step = -(-len(pair.one) // _MATCHES)
    here, there = every[0][::step], every[1][::step]
    reach = TOLERANCE * one.width / one.fx
    chosen = _samples(len(here))
    proposed = _axes(there[chosen]) @ np.swapaxes(_axes(here[chosen]), 1, 2)
    miss = np.linalg.norm(here @ np.swapaxes(proposed, 1, 2) - there, axis=-1)
    rotation = proposed[int(np.argmax((miss < reach).sum(axis=1)))]
    fits = np.zeros(len(pair.one), bool)
    for _ in range(3):
        fits = np.linalg.norm(every[0] @ rotation.T - every[1], axis=-1) < reach
        if fits.sum() < 2:
            break
        u, _, vt = np.linalg.svd(every[1][fits].T @ every[0][fits])
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return Turn(rotation, fits)


@cache
def _samples(matches: int) -> npt.NDArray[np.int64]:
    """Pairs [HYPOTHESES, 2] of that number of matches, the same for every lens that is tried."""
    rng = np.random.default_rng(0)
    return np.array([rng.choice(matches, 2, replace=False) for _ in range(HYPOTHESES)])


def _axes(two: Array) -> Array:
    """Right-handed axes [T, 3, 3], as columns, of two directions [T, 2, 3] each."""
    first = two[:, 0]
    normal = np.cross(first, two[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    return np.stack([first, normal, np.cross(first, normal)], axis=-1)
