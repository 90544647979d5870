"""Robust alignment of poses with the truth, though some views are wrong."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array

DEGREES, SHARE = 2.0, 0.02
"""A view is wrong that is turned by more, or shifted by more than this share of the size of the rig."""


@dataclass(frozen=True)
class Errors:
    """Errors of each view: rotation in degrees, and place in sizes of the rig (root mean square of the
    distances of its views from their middle).
    """

    turn: dict[int, float]
    shift: dict[int, float]

    @property
    def wrong(self) -> list[int]:
        """The views that do not stand where most do."""
        return [view for view in self.turn if self.turn[view] > DEGREES or self.shift[view] > SHARE]


def errors(estimated: Mapping[int, Array], true: Array) -> Errors:
    """cam_from_world [4, 4] of the views that were found, against those of all [V, 4, 4].

    The similarity between the two worlds is the one of a pair of views that most others agree with, then
    fitted to those that agree: views that are wrong have no part in it.
    """
    views = sorted(estimated)
    if not views:
        return Errors({}, {})
    ours, goal = np.stack([estimated[view] for view in views]), true[views]
    here, there = _centres(ours), _centres(goal)
    size = float(np.sqrt(((_centres(true) - _centres(true).mean(0)) ** 2).sum(1).mean()))
    best: tuple[int, float, Array, Array] | None = None
    for one in range(len(views)):
        turn = goal[one, :3, :3].T @ ours[one, :3, :3]
        for other in range(len(views)):
            apart = float(np.linalg.norm(here[one] - here[other]))
            if apart < 1e-9:
                continue
            scale = float(np.linalg.norm(there[one] - there[other])) / apart
            turns, shifts = _apart(ours, goal, turn, scale, there[one] - scale * turn @ here[one])
            agree = (turns < DEGREES) & (shifts < SHARE * size)
            rank = int(agree.sum()), -float(np.minimum(shifts / size, 1).sum())
            if best is None or rank > best[:2]:
                best = (*rank, agree, np.array([turns, shifts]))
    if best is None:
        return Errors({}, {})
    agree, rough = best[2], best[3]
    if agree.sum() >= 3:
        u, _, vt = np.linalg.svd(np.einsum("nji,njk->ik", goal[agree, :3, :3], ours[agree, :3, :3]))
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
        a, b = (here[agree] - here[agree].mean(0)) @ turn.T, there[agree] - there[agree].mean(0)
        scale = float((a * b).sum() / (a**2).sum())
        rough = np.array(
            _apart(ours, goal, turn, scale, there[agree].mean(0) - scale * turn @ here[agree].mean(0))
        )
    turns, shifts = rough[0].tolist(), (rough[1] / size).tolist()
    return Errors(dict(zip(views, turns, strict=True)), dict(zip(views, shifts, strict=True)))


def _apart(ours: Array, goal: Array, turn: Array, scale: float, shift: Array) -> tuple[Array, Array]:
    apart = ours[:, :3, :3] @ turn.T @ goal[:, :3, :3].transpose(0, 2, 1)
    sine = np.linalg.norm(apart - apart.transpose(0, 2, 1), axis=(1, 2)) / np.sqrt(8)
    turns = np.degrees(np.arctan2(sine, (np.trace(apart, axis1=1, axis2=2) - 1) / 2))
    return turns, np.linalg.norm(scale * _centres(ours) @ turn.T + shift - _centres(goal), axis=1)


def _centres(poses: Array) -> Array:
    return np.asarray(-np.einsum("nji,nj->ni", poses[:, :3, :3], poses[:, :3, 3]))
