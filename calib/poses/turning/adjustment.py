"""Turns and lenses of views from one place by all matches at once: bundle adjustment without points.

Two rays of a match, turned into the world, are one direction. Their difference, times the focal length, is
minimised with a Cauchy loss over all turns and the terms of all lenses (Brown and Lowe, "Automatic Panoramic
Image Stitching using Invariant Features", 2007, with lenses that distort).
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from imaging.arrays import Array, Integers
from imaging.optics.lens import Lens, rays

ROUNDS = 60
STILL = 1e-5
"""Share of the loss that a step has to gain for another to follow."""
_LEAST_TYPICAL = 0.02
"""px, of the median miss that scales the loss."""
_STEP = 1e-6
_TERMS = {
    False: {"focal": 1.0, "cx": 0.01, "cy": 0.01, "k1": 0.3, "k2": 0.3},
    True: {"focal": 1.0, "cx": 0.01, "cy": 0.01, "k1": 0.1, "k2": 0.05, "k3": 0.02, "k4": 0.01},
}
"""Terms of a lens, and of a fisheye, and how far each may lie from an ideal lens: ln of the focal length,
widths of the picture for the principal point, and the radial terms as they are."""


@dataclass(frozen=True, eq=False)
class Matches:
    """All matches: view and pixel at either end.

    views: int [M, 2]; places: float64 [M, 2, 2], px.
    """

    views: Integers
    places: Array


@dataclass(frozen=True, eq=False)
class Turned:
    """Turns cam_from_world [V, 3, 3], lenses, and the miss of each match, px."""

    turns: Array
    lenses: dict[str, Lens]
    miss: Array

    @property
    def typical(self) -> float:
        """The median miss."""
        return max(float(np.median(self.miss)), _LEAST_TYPICAL)


@dataclass(frozen=True, eq=False)
class _Problem:
    matches: Matches
    cameras: list[str]
    names: list[str]
    free: dict[str, Lens]

    def size(self, lens: Lens) -> int:
        return len(_TERMS[lens.fisheye])


def adjust_turns(
    matches: Matches, turns: Array, cameras: list[str], lenses: Mapping[str, Lens], held: Collection[str]
) -> Turned:
    """Adjust all turns, and the lenses that are not held, from where they are.

    Args:
        matches: All matches.
        turns: cam_from_world [V, 3, 3].
        cameras: Camera of each view.
        lenses: By camera.
        held: Cameras whose lens stays.

    Returns:
        The turns, the lenses and the misses.
    """
    free = {name: lens for name, lens in lenses.items() if name not in held}
    problem = _Problem(matches, cameras, sorted(free), free)
    now = Turned(turns, dict(lenses), np.zeros(0))
    residual = _residual(problem, now.turns, now.lenses)[0]
    now = replace(now, miss=np.linalg.norm(residual, axis=1))
    damping = 1e-3
    for _ in range(ROUNDS):
        scale = 2 * now.typical
        curvature, slope = _normal_equations(problem, now, scale)
        loss = _loss(problem, now, scale)
        gained = 0.0
        while damping < 1e6:
            damped = curvature + damping * np.diag(np.diag(curvature))
            moved = _moved(problem, now, np.asarray(np.linalg.solve(damped, -slope), np.float64))
            gained = 1 - _loss(problem, moved, scale) / loss
            if gained > 0:
                now, damping = moved, max(damping / 5, 1e-9)
                break
            damping *= 4
        if gained < STILL:
            break
    return now


def _loss(problem: _Problem, turned: Turned, scale: float) -> float:
    data = float(np.log1p((turned.miss / scale) ** 2).sum()) * scale**2
    return data + sum(float((_strays(problem, turned, name) ** 2).sum()) for name in problem.names)


def _strays(problem: _Problem, turned: Turned, name: str) -> Array:
    """Distance of the terms of a lens from where they began, in px of the loss: a weak hold on them."""
    lens, start = turned.lenses[name], problem.free[name]
    far = [
        np.log(lens.fx / start.fx),
        (lens.cx - start.cx) / lens.width,
        (lens.cy - start.cy) / lens.width,
        *(getattr(lens, term) - getattr(start, term) for term in list(_TERMS[lens.fisheye])[3:]),
    ]
    return np.array(far) / list(_TERMS[lens.fisheye].values())


def _residual(problem: _Problem, turns: Array, lenses: Mapping[str, Lens]) -> tuple[Array, Array]:
    """Differences of the rays of each match in the world times the focal length [M, 3], and the rays in
    camera axes [M, 2, 3].
    """
    matches = problem.matches
    camera = np.array(problem.cameras)[matches.views]
    inside, focal = np.empty((*matches.places.shape[:2], 3)), np.empty(camera.shape)
    for name, lens in lenses.items():
        of_it = camera == name
        inside[of_it], focal[of_it] = rays(lens, matches.places[of_it]), lens.fx
    world = np.einsum("mkji,mkj->mki", turns[matches.views], inside)
    return np.sqrt(focal.prod(axis=1))[:, None] * (world[:, 0] - world[:, 1]), inside


def _normal_equations(problem: _Problem, now: Turned, scale: float) -> tuple[Array, Array]:
    """Curvature [P, P] and slope [P] of half the loss: three of each view, then the terms of each lens."""
    matches, count = problem.matches, len(now.turns)
    residual, inside = _residual(problem, now.turns, now.lenses)
    weight = 1 / (1 + (now.miss / scale) ** 2)
    focal = np.array([now.lenses[name].fx for name in problem.cameras])
    strength = np.sqrt(focal[matches.views].prod(axis=1))[:, None, None]
    terms = sum(problem.size(lens) for lens in problem.free.values())
    jacobian = np.zeros((len(residual), 3, 3 * count + terms))
    rows = np.arange(len(residual))
    for end, sign in ((0, 1.0), (1, -1.0)):
        x, y, z = inside[:, end].T
        zero = np.zeros_like(x)
        cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
        turned = sign * strength * np.einsum("mji,mjk->mik", now.turns[matches.views[:, end]], cross)
        for axis in range(3):
            jacobian[rows, :, 3 * matches.views[:, end] + axis] += turned[..., axis]
    column = 3 * count
    curvature_of_lenses, slope_of_lenses = np.zeros(terms), np.zeros(terms)
    for name in problem.names:
        size = problem.size(now.lenses[name])
        for term in range(size):
            step = np.zeros(size)
            step[term] = _STEP
            other = now.lenses | {name: _stepped(now.lenses[name], step)}
            jacobian[..., column + term] = (_residual(problem, now.turns, other)[0] - residual) / _STEP
        place = slice(column - 3 * count, column - 3 * count + size)
        hold = 1 / np.array(list(_TERMS[now.lenses[name].fisheye].values()))
        curvature_of_lenses[place], slope_of_lenses[place] = hold**2, hold * _strays(problem, now, name)
        column += size
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    weighted = flat * np.repeat(weight, 3)[:, None]
    curvature, slope = flat.T @ weighted, weighted.T @ residual.ravel()
    held = 3 * count + np.arange(terms)
    curvature[held, held] += curvature_of_lenses
    slope[3 * count :] += slope_of_lenses
    curvature[[0, 1, 2], [0, 1, 2]] += 1e6 * curvature.diagonal().max()  # the first view is the world
    return curvature, slope


def _moved(problem: _Problem, now: Turned, step: Array) -> Turned:
    count = len(now.turns)
    turns = np.stack([cv2.Rodrigues(step[3 * v : 3 * v + 3])[0] @ turn for v, turn in enumerate(now.turns)])
    lenses, column = dict(now.lenses), 3 * count
    for name in problem.names:
        size = problem.size(lenses[name])
        lenses[name] = _stepped(lenses[name], step[column : column + size])
        column += size
    residual = _residual(problem, turns, lenses)[0]
    return Turned(turns, lenses, np.linalg.norm(residual, axis=1))


def _stepped(lens: Lens, step: Array) -> Lens:
    focal = lens.fx * float(np.exp(np.clip(step[0], -0.3, 0.3)))
    terms = {
        term: getattr(lens, term) + float(change)
        for term, change in zip(list(_TERMS[lens.fisheye])[3:], step[3:], strict=True)
    }
    return lens.model_copy(
        update={
            "fx": focal,
            "fy": focal,
            "cx": lens.cx + float(step[1]) * lens.width,
            "cy": lens.cy + float(step[2]) * lens.width,
            **terms,
        }
    )
