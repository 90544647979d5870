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
from dataclasses import dataclass, field, replace

import numpy as np

from calib.light.constant_settings import NOTHING, Stated
from calib.light.photograph_observations import HUBER, PhotographObservations, residual_of, shared, solved
from calib.light.tracks import LUMINANCE
from calib.light.vignetting import NOTICED_IN_SHEEN, by_side
from calib.request import ASKED, LightPart
from imaging.arrays import Array
from imaging.robust import huber_loss, robust_scale
from imaging.session.records import ONE_OF_SEVERAL, Rung
from imaging.session.view_id import ViewId

_Reading = Callable[[Array], Array]

FEWEST_POINTS = 100
FEWEST_OBSERVATIONS = 30
"""Fewest observations of a photograph, below which it stays as its label has it."""
FEWEST_OF_REGION = 5
"""Points of a region in a photograph, whose median counts."""
FEWEST_MEDIANS = 20
"""Fewest medians of regions in photographs, below which a part is not judged."""
MOST_REMAINING = 0.5
"""Most that a part may leave of the differences between photographs in regions that it was not fitted to. Of
real cameras that balanced or exposed by themselves 0.15 to 0.47 are left, of sheen and the like
0.89 to 1.5 (bench/real/light.py)."""
FOLDS = 5
EACH = "of its own for each photograph"
UNIT = "robust whitened loss per held-out point"
EXPOSURE, WHITE_BALANCE = "exposure_each_photograph", "white_balance_each_photograph"


@dataclass(frozen=True)
class Development:
    """Development of photographs, relative to their labels and to all of them.

    exposure: factor on the exposure scale of a view's shots; white_balance: red, green and blue relative to
    green. Views that are not named are as their labels say. exposure_asked, white_balance_asked: factors that
    regions ask for where the files state one setting for all, which are not applied; those of the white
    balance have a geometric mean of 1.
    """

    exposure: Mapping[ViewId, float]
    white_balance: Mapping[ViewId, tuple[float, float, float]]
    rungs: tuple[Rung, ...] = ()
    exposure_asked: Mapping[ViewId, float] = field(default_factory=dict)
    white_balance_asked: Mapping[ViewId, tuple[float, float, float]] = field(default_factory=dict)

    @property
    def differs(self) -> bool:
        """True if any photograph differs from its label, be it applied or not."""
        return bool(self.exposure or self.exposure_asked or self.white_balance_asked)

    def brightness(self, of_features: Mapping[ViewId, Array]) -> dict[ViewId, Array]:
        """Natural log of luminance of each view's features, as labels have it, put right."""
        return {
            view: values
            - np.log(self.exposure.get(view, 1.0) * (LUMINANCE @ self.white_balance.get(view, (1,) * 3)))
            for view, values in of_features.items()
        }


def estimate(
    observations: PhotographObservations,
    views: list[ViewId],
    stated: Stated = NOTHING,
    without: Collection[LightPart] = (),
) -> Development:
    """Estimate exposure and white balance of each photograph, each as far as held-out regions ask for it.

    Args:
        observations: Colours of scene points in the photographs.
        views: Views, in the order of `PhotographObservations.view`.
        stated: Settings that the files state as constant for a camera, which stay, with the factors that
            regions ask for beside them.
        without: Parts to leave out.

    Returns:
        The development of the photographs, with a rung for each of the two parts.
    """
    observations = shared(observations)
    points = np.unique(observations.point)
    if len(points) < FEWEST_POINTS:
        reason = f"fewer than {FEWEST_POINTS} points are seen well, in every channel, by several photographs"
        return Development({}, {}, (_not_taken(EXPOSURE, reason), _not_taken(WHITE_BALANCE, reason)))
    count = len(views)
    known = np.bincount(observations.view, minlength=count) >= FEWEST_OBSERVATIONS
    logs = np.where(known[:, None], solved(observations, count), 0.0)
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
    trial = _Trial.of(observations, count)
    rungs = [
        trial.judged(EXPOSURE, f"an exposure {EACH}", np.zeros_like, _one_exposure),
        trial.judged(WHITE_BALANCE, f"a white balance {EACH}", _one_exposure, _as_is),
    ]
    parts = (common, logs - common)
    asked: list[dict[ViewId, Array]] = [{}, {}]
    for index, (part, what) in enumerate(zip(parts, ("brightness", "colour"), strict=True)):
        constant = np.array([view.camera in (stated.exposure, stated.white_balance)[index] for view in views])
        free, rung = part[constant & known].copy(), rungs[index]
        part[constant] = 0.0
        size = _size(part[known])
        reason = f"{rung.reason}; the photographs differ in {what} by {100 * size:.2g} %"
        taken = rung.taken and size > NOTICED_IN_SHEEN
        if said[rung.name]:
            taken, reason = False, said[rung.name]
        if rung.taken and _size(free) > NOTICED_IN_SHEEN and said[rung.name] != ASKED:
            asked[index] = {
                views[i]: row for i, row in zip(np.flatnonzero(constant & known), free, strict=True)
            }
            against = f"by scene points they differ in {what} by {100 * _size(free):.2g} % all the same"
            reason = f"{reason}; {against}, which rig reconstruct tries"
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
        {view: float(np.exp(row[0])) for view, row in asked[0].items()},
        {view: _factors(row) for view, row in asked[1].items()},
    )


def _not_taken(name: str, reason: str) -> Rung:
    return Rung(name=name, taken=False, reason=reason)


def _size(part: Array) -> float:
    return float(np.sqrt(np.mean(np.square(part)))) if len(part) else 0.0


def _relative(logs: Array) -> tuple[float, float, float]:
    return _factors(logs - logs[1])


def _factors(logs: Array) -> tuple[float, float, float]:
    red, green, blue = (float(value) for value in np.exp(logs))
    return red, green, blue


def _one_exposure(logs: Array) -> Array:
    return np.repeat(logs.mean(axis=1, keepdims=True), 3, axis=1)


def _as_is(logs: Array) -> Array:
    return logs


@dataclass(frozen=True, eq=False)
class _Trial:
    """Regions held out in turn: their points, and the numbers that the others give.

    folds: for each the observations of held-out regions, those of them that nearly the same side shows, and
    ln d [count, 3] of the rest.
    """

    folds: Sequence[tuple[PhotographObservations, PhotographObservations, Array]]
    count: int

    @classmethod
    def of(cls, observations: PhotographObservations, count: int) -> "_Trial":
        """Hold out one fold of the regions after the other."""
        fold = np.unique(observations.region, return_inverse=True)[1] % FOLDS
        near = replace(observations, point=by_side(observations.point, observations.direction))
        folds = []
        for held in range(FOLDS):
            rest = shared(observations.part(fold != held))
            if (fold == held).any() and len(rest.point):
                test = (observations.part(fold == held), shared(near.part(fold == held)))
                folds.append((*test, solved(rest, count)))
        return cls(folds, count)

    def judged(self, name: str, reason: str, simple: _Reading, freer: _Reading) -> Rung:
        """A part is taken where the freer of two readings of the same numbers predicts held-out points better
        and does away with most of what held-out regions differ by.
        """
        differences = []
        for test, _, logs in self.folds:
            residuals = [residual_of(test, each(logs)) for each in (simple, freer)]
            scale = max(robust_scale(residuals[1]), 1e-6)
            _, point = np.unique(test.point, return_inverse=True)
            low, high = (huber_loss(each / scale, HUBER).mean(axis=1) for each in residuals)
            differences.append(np.bincount(point, low - high) / np.bincount(point))
        gains = np.concatenate(differences) if differences else np.zeros(2)
        error = float(gains.std(ddof=1) / np.sqrt(len(gains)))
        rung = Rung.judged(name, float(gains.mean()), error, UNIT, reason, 3 * self.count, ONE_OF_SEVERAL)
        remaining, where = self._left_over(simple, freer)
        if remaining is None:
            few = (
                f"{reason}; too few points of each region are in two photographs to distinguish it from sheen"
            )
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
                before += _medians(chosen, residual_of(chosen, simple(logs)), self.count)
                after += _medians(chosen, residual_of(chosen, freer(logs)), self.count)
            if len(before) >= FEWEST_MEDIANS:
                # Only what the freer reading is freer by.
                sizes = [np.median(np.abs(freer(m) - simple(m))) for m in map(np.array, (before, after))]
                return float(sizes[1] / max(sizes[0], 1e-9)), where
        return None, ""


def _medians(observations: PhotographObservations, residual: Array, count: int) -> list[Array]:
    """The median residual [3] of every region in every photograph that shows enough points of it."""
    cell = observations.region * count + observations.view
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order])) + 1
    return [
        np.median(residual[rows], axis=0) for rows in np.split(order, starts) if len(rows) >= FEWEST_OF_REGION
    ]
