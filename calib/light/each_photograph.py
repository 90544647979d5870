"""Auto exposure and auto white balance: the development of each photograph, by shared scene points.

A camera that develops its pictures may choose brightness and white balance anew for each. A matte scene
point has one light, so differences between the photographs of its track are theirs, in each channel:
`ln rgb = ln point + ln d_photograph`. Points are eliminated; there remains a robust least-squares problem
with a number for each photograph and channel, after Goldman, "Vignette and exposure calibration and
compensation" (2010).

The sheen of a lamp moves through the views as well, and on one surface looks just so. Two things distinguish
it: between views from nearly the same side it does not change, and no two surfaces of a scene have the same.
So a part is taken only where it removes most of the differences of regions that it was not fitted to, between
views of one side where there are enough.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from calib.light.falloff import DARKEST, light_left
from calib.light.parts import ASKED, LightPart
from calib.light.stated import NOTHING, Stated
from calib.light.tracks import LUMINANCE, sightings
from calib.light.viewing_sides import by_side
from calib.light.vignetting import NOTICED_IN_SHEEN, Falloff
from calib.poses.sfm import SceneModel
from imaging.arrays import Array, Integers, Mask
from imaging.robust import huber_loss, huber_weight, robust_scale
from imaging.session.records import ONE_OF_SEVERAL, Rung
from imaging.session.view_id import ViewId

_Reading = Callable[[Array], Array]

FEWEST_POINTS = 100
FEWEST_SIGHTS = 30
"""Fewest observations of a photograph, below which it stays as its label has it."""
FEWEST_OF_REGION = 5
"""Points of a region in a photograph, whose median counts."""
FEWEST_MEDIANS = 20
"""Fewest medians of regions in photographs, below which a part is not judged."""
MOST_REMAINING = 0.5
"""Most that a part may leave of the differences between photographs in regions that it was not fitted to. Of
real cameras that balanced or exposed by themselves 0.15 to 0.47 are left, of sheen and the like
0.89 to 1.5 (bench/real/light.py)."""
ROUNDS = 10
HUBER = 1.5
FOLDS = 5
EACH = "of its own for each photograph"
UNIT = "robust whitened loss per held-out point"
EXPOSURE, WHITE_BALANCE = "exposure_each_photograph", "white_balance_each_photograph"


@dataclass(frozen=True, eq=False)
class PhotographSights:
    """Colours of scene points in photographs; rows are observations.

    point, view: int [N]; colour: float64 [N, 3], natural log of linear light, falloff and gain divided out;
    direction: float64 [N, 3], unit, from the point to the camera; region: int [N], of the scene.
    """

    point: Integers
    view: Integers
    colour: Array
    direction: Array
    region: Integers

    def part(self, keep: Mask) -> "PhotographSights":
        """The observations that `keep` [N] names."""
        return PhotographSights(
            self.point[keep], self.view[keep], self.colour[keep], self.direction[keep], self.region[keep]
        )


@dataclass(frozen=True)
class Development:
    """Development of photographs, relative to their labels and to all of them.

    exposure: factor on the exposure scale of a view's shots; white_balance: red, green and blue relative to
    green. Views that are not named are as their labels say.
    """

    exposure: Mapping[ViewId, float]
    white_balance: Mapping[ViewId, tuple[float, float, float]]
    rungs: tuple[Rung, ...] = ()

    def brightness(self, of_features: Mapping[ViewId, Array]) -> dict[ViewId, Array]:
        """Natural log of luminance of each view's features, as labels have it, put right."""
        return {
            view: values
            - np.log(self.exposure.get(view, 1.0) * (LUMINANCE @ self.white_balance.get(view, (1,) * 3)))
            for view, values in of_features.items()
        }


def sights_of(
    model: SceneModel, colours: Mapping[ViewId, Array], photographs: Collection[str], falloff: Falloff | None
) -> tuple[PhotographSights, list[ViewId]]:
    """Return the light of shared points in the cameras named as `photographs`, and their views.

    colours: of each feature of each view, as `colour_at` gives it. falloff: taken away; None if still
    unknown.
    """
    usable: dict[ViewId, Mask] = {}
    for view, colour in colours.items():
        usable[view] = np.isfinite(colour).all(axis=1) & np.full(len(colour), view.camera in photographs)
    observations = sightings(model, usable)
    light = observations.values(colours)
    if falloff is not None:
        names = [view.camera for view in observations.views]
        terms = np.array([falloff.vignetting[name] for name in names])[observations.view]
        fall = light_left(terms, observations.radius)
        gain = np.array([falloff.gain[name] for name in names])[observations.view]
        light -= np.log(np.maximum(fall, DARKEST) * gain)[:, None]
    return PhotographSights(
        observations.point, observations.view, light, observations.direction, observations.region
    ), observations.views


def estimate(
    sights: PhotographSights,
    views: list[ViewId],
    stated: Stated = NOTHING,
    without: Collection[LightPart] = (),
) -> Development:
    """Estimate exposure and white balance of each photograph, each as far as held-out regions ask for it.

    views: in the order of `PhotographSights.view`; stated: settings that the files state as constant for a
    camera, which stay; without: parts to leave out.
    """
    sights = _shared(sights)
    points = np.unique(sights.point)
    if len(points) < FEWEST_POINTS:
        reason = f"fewer than {FEWEST_POINTS} points are seen well, in every channel, by several photographs"
        return Development({}, {}, (_left(EXPOSURE, reason), _left(WHITE_BALANCE, reason)))
    count = len(views)
    known = np.bincount(sights.view, minlength=count) >= FEWEST_SIGHTS
    logs = np.where(known[:, None], _solved(sights, count), 0.0)
    for camera in {view.camera for view in views}:
        # What all photographs of a camera have in common is its gain, which the falloff comes with.
        taken_by = known & np.array([view.camera == camera for view in views])
        if taken_by.any():
            logs[taken_by] -= logs[taken_by].mean()
    common = logs.mean(axis=1, keepdims=True)
    said = {
        EXPOSURE: ASKED if "exposure" in without else stated.of_all("exposure", views),
        WHITE_BALANCE: ASKED if "white_balance" in without else stated.of_all("white_balance", views),
    }
    trial = _Trial.of(sights, count)
    rungs = [
        trial.judged(EXPOSURE, f"an exposure {EACH}", _no_exposure, _one_exposure),
        trial.judged(WHITE_BALANCE, f"a white balance {EACH}", _one_exposure, _as_is),
    ]
    parts = (common, logs - common)
    for index, (part, what) in enumerate(zip(parts, ("brightness", "colour"), strict=True)):
        for place, view in enumerate(views):
            if view.camera in (stated.exposure, stated.white_balance)[index]:
                part[place] = 0.0
        size = float(np.sqrt(np.mean(np.square(part[known])))) if known.any() else 0.0
        rung = rungs[index]
        reason = f"{rung.reason}; the photographs differ in {what} by {100 * size:.2g} %"
        taken = rung.taken and size > NOTICED_IN_SHEEN
        if said[rung.name]:
            taken, reason = False, said[rung.name]
        rungs[index] = rung.model_copy(update={"taken": taken, "reason": reason})
    exposure, white = rungs[0].taken, rungs[1].taken
    logs = parts[0] + parts[1]
    # Green carries the exposure where colours are separate, the mean of the channels where they are not.
    scale = logs[:, 1] - (0.0 if exposure else common[:, 0]) if white else common[:, 0]
    determined = [index for index in range(count) if known[index]]
    return Development(
        {views[i]: float(np.exp(scale[i])) for i in determined} if exposure or white else {},
        {views[i]: _relative(logs[i]) for i in determined} if white else {},
        tuple(rungs),
    )


def _left(name: str, reason: str) -> Rung:
    return Rung(name=name, taken=False, reason=reason)


def _relative(logs: Array) -> tuple[float, float, float]:
    red, green, blue = (float(value) for value in np.exp(logs - logs[1]))
    return red, green, blue


def _no_exposure(logs: Array) -> Array:
    return np.zeros_like(logs)


def _one_exposure(logs: Array) -> Array:
    return np.repeat(logs.mean(axis=1, keepdims=True), 3, axis=1)


def _as_is(logs: Array) -> Array:
    return logs


@dataclass(frozen=True, eq=False)
class _Trial:
    """Regions held out in turn: their points, and the numbers that the others give.

    folds: for each the sights of held-out regions, those of them that nearly the same side shows, and ln d
    [count, 3] of the rest.
    """

    folds: Sequence[tuple[PhotographSights, PhotographSights, Array]]
    count: int

    @classmethod
    def of(cls, sights: PhotographSights, count: int) -> "_Trial":
        """Hold out one fold of the regions after the other."""
        fold = np.unique(sights.region, return_inverse=True)[1] % FOLDS
        near = replace(sights, point=by_side(sights.point, sights.direction))
        folds = []
        for held in range(FOLDS):
            rest = _shared(sights.part(fold != held))
            if (fold == held).any() and len(rest.point):
                test = (sights.part(fold == held), _shared(near.part(fold == held)))
                folds.append((*test, _solved(rest, count)))
        return cls(folds, count)

    def judged(self, name: str, reason: str, simple: _Reading, freer: _Reading) -> Rung:
        """A part is taken where the freer of two readings of the same numbers predicts held-out points better
        and does away with most of what held-out regions differ by.
        """
        differences = []
        for test, _, logs in self.folds:
            residuals = [_residual(test, each(logs)) for each in (simple, freer)]
            scale = max(robust_scale(residuals[1]), 1e-6)
            _, point = np.unique(test.point, return_inverse=True)
            low, high = (huber_loss(each / scale, HUBER).mean(axis=1) for each in residuals)
            differences.append(np.bincount(point, low - high) / np.bincount(point))
        gains = np.concatenate(differences) if differences else np.zeros(2)
        error = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        rung = Rung.judged(name, float(gains.mean()), error, UNIT, reason, 3 * self.count, ONE_OF_SEVERAL)
        remaining, where = self._left_over(simple, freer)
        if remaining is None:
            few = f"{reason}; too few points of each region are in two photographs to tell it from sheen"
            return rung.model_copy(update={"taken": False, "reason": few})
        explained = (
            f"{reason}, with which held-out parts of the scene differ between {where} "
            f"{100 * remaining:.0f} % as much as without it"
        )
        return rung.model_copy(
            update={"taken": rung.taken and remaining <= MOST_REMAINING, "reason": explained}
        )

    def _left_over(self, simple: _Reading, freer: _Reading) -> tuple[float | None, str]:
        """Return what is left of the differences of held-out regions between photographs, and between which.

        None where neither those of one side nor all are enough.
        """
        for one_side, where in ((True, "photographs from one side"), (False, "all photographs")):
            before, after = list[Array](), list[Array]()
            for test, near, logs in self.folds:
                chosen = near if one_side else test
                before += _medians(chosen, _residual(chosen, simple(logs)), self.count)
                after += _medians(chosen, _residual(chosen, freer(logs)), self.count)
            if len(before) >= FEWEST_MEDIANS:
                # Only what the freer reading is freer by.
                sizes = [np.median(np.abs(freer(m) - simple(m))) for m in map(np.array, (before, after))]
                return float(sizes[1] / max(sizes[0], 1e-9)), where
        return None, ""


def _medians(sights: PhotographSights, residual: Array, count: int) -> list[Array]:
    """The median residual [3] of every region in every photograph that shows enough points of it."""
    cell = sights.region * count + sights.view
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order])) + 1
    return [
        np.median(residual[rows], axis=0) for rows in np.split(order, starts) if len(rows) >= FEWEST_OF_REGION
    ]


def _shared(sights: PhotographSights) -> PhotographSights:
    """The points that two photographs see or more."""
    _, point, counts = np.unique(sights.point, return_inverse=True, return_counts=True)
    return sights.part(counts[point] >= 2)


def _solved(sights: PhotographSights, count: int) -> Array:
    """ln d [count, 3], zero in the mean over the photographs of every channel."""
    _, point = np.unique(sights.point, return_inverse=True)
    points = int(point.max()) + 1
    logs = np.zeros((count, 3))
    for channel in range(3):
        value = sights.colour[:, channel]
        weight = np.ones(len(value))
        for _ in range(ROUNDS):
            cross = sparse.coo_matrix((weight, (point, sights.view)), (points, count)).tocsr()
            total = np.bincount(point, weight, points)
            share = sparse.diags(1 / np.maximum(total, 1e-12)) @ cross
            diagonal = np.bincount(sights.view, weight, count)
            normal = np.diag(diagonal) - (cross.T @ share).toarray()
            right = np.bincount(sights.view, weight * value, count)
            right -= share.T @ np.bincount(point, weight * value, points)
            # A photograph that shares no point, and the gauge of all, are left at zero.
            logs[:, channel] = np.linalg.pinv(normal, rcond=1e-9, hermitian=True) @ right
            left = value - logs[sights.view, channel]
            left -= (np.bincount(point, weight * left, points) / np.maximum(total, 1e-12))[point]
            weight = huber_weight(left, HUBER * max(robust_scale(left), 1e-6))
    observed = np.bincount(sights.view, minlength=count) > 0
    logs[observed] -= logs[observed].mean(axis=0)
    return logs


def _residual(sights: PhotographSights, logs: Array) -> Array:
    """Return what is left between the photographs of each point, [N, 3]."""
    _, point = np.unique(sights.point, return_inverse=True)
    residual = sights.colour - logs[sights.view]
    middle = (
        np.stack([np.bincount(point, column) for column in residual.T], axis=1) / np.bincount(point)[:, None]
    )
    return np.asarray(residual - middle[point])
