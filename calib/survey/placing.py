"""Placement of a scene by surveyed points: the similarity, and the faults of those that do not fit."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib.poses.sfm import SceneModel, transformed
from calib.survey.marks import Marks
from calib.survey.points import Survey
from calib.survey.sightings import Sighting, Views, mark_error
from calib.survey.similarity import FEWEST, TOO_FAR, Similarity, consensus, fit, is_line, standard_errors
from imaging.arrays import Array, Mask
from imaging.errors import CalibrationError
from imaging.session.coordinates import CoordinateSystem, SurveyedPoint, length_text
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

NAME = "survey"
UPSIDE_DOWN = -0.5
"""Mean height of the upper edges of pictures less that of what they look at: 1 of upright cameras."""
GROSS = 0.01
"""Largest residual, as a share of the spread of the points, whatever their stated errors."""
LEAST_ERROR = 0.05
"""px by which marks err at least."""
OTHER_UNIT = 0.05
"""Tolerance of a factor between units."""
_UNITS = {
    "millimetres": 1e3,
    "centimetres": 1e2,
    "feet": 1 / 0.3048,
    "inches": 1 / 0.0254,
    "kilometres": 1e-3,
}


@dataclass(frozen=True, eq=False)
class _Points:
    """Surveyed points that views place. noise: [K] m, of both, once the scale is known to a factor."""

    names: list[str]
    here: Array
    there: Array
    spread: Array
    """[K], px apart: standard error in the scene where marks err by 1 px, about the mean of the axes."""
    sigma: Array
    """[K], as stated, m; 0 where nothing is."""

    def noise(self, scale: float, error: float) -> Array:
        """Standard error of a coordinate, m; error: of marks, px."""
        return np.asarray(np.hypot(self.sigma, scale * error * self.spread))


@dataclass(frozen=True)
class Expected:
    """Expected metres per unit of the scene from another source, and their error."""

    scale: float
    teller: str
    tolerance: float


def place_by_survey(
    model: SceneModel,
    survey: Survey,
    marks: Marks,
    sizes: Mapping[str, tuple[int, int]],
    expected: Expected | None = None,
) -> tuple[SceneModel, CoordinateSystem]:
    """Place the model in the coordinates of a survey, less its offset, and return the quality of the fit.

    Args:
        model: Scene model.
        survey: Surveyed points, m.
        marks: Places of the points in the views, px of the files.
        sizes: Width and height of the files of each camera, px, by name.
        expected: Scale from another source; None if no source gives one.

    Returns:
        The placed model, with a rung; and its coordinates, with their errors and the residual of each point.

    Raises:
        CalibrationError: Too few points are seen, or they contradict the scene or its scale; the message is
            one sentence, and the model is unchanged.
    """
    shrunk = {name: np.array([lens.width, lens.height]) / sizes[name] for name, lens in model.lenses.items()}
    views = Views(model.reconstruction)
    places = {
        name: {
            view: np.array(mark.at) * shrunk[view.camera] for view, mark in marks_of.items() if view in views
        }
        for name, marks_of in marks.items()
    }
    sightings = {
        name: position for name, marks_of in places.items() if (position := views.place(marks_of)) is not None
    }
    points = _points(survey, sightings)
    if len(points.names) < FEWEST:
        raise CalibrationError(_too_few(survey, marks, places, sightings))
    if is_line(points.there, float(points.sigma.max())):
        raise CalibrationError(
            f"the surveyed points {', '.join(points.names)} lie on a line, about which the scene could turn: "
            "survey one beside it"
        )
    error = max(mark_error(sightings), LEAST_ERROR)
    rough = float(fit(points.here, points.there).scale)
    noise = points.noise(rough, error)
    stated = bool((points.sigma > 0).all())
    similarity, fits, _ = consensus(points.here, points.there, noise, stated=stated)
    if fits.sum() < max(FEWEST, (len(fits) + 1) // 2) or _is_gross(points, similarity, fits, noise):
        raise CalibrationError(_no_fit(points, similarity, fits, noise, stated))
    if expected is not None:
        _require_same_unit(float(similarity.scale) / expected.scale, expected)
    misses = similarity(points.here) - points.there
    scatter = np.sqrt(noise[fits] ** 2 + _excess(misses[fits], noise[fits]))
    scale, turn, place = standard_errors(points.there[fits], misses[fits], scatter)
    offset = np.array(survey.offset)
    shifted = Similarity(similarity.scale, similarity.rotation, similarity.translation - offset)
    over = _upside_down(model, shifted)
    if over and survey.system != "local":
        raise CalibrationError(over)
    located = transformed(model, shifted.sim3d)
    table = _table(
        survey, marks, sightings, points, fits, misses, Views(located.reconstruction), shrunk, offset
    )
    rms = float(np.sqrt((misses[fits] ** 2).sum(1).mean()))
    reason = (
        f"{fits.sum()} surveyed points give scale, rotation and place; they miss by {length_text(rms)} (rms)"
    )
    if not fits.all():
        reason += f"; {_misfits(points, fits)}{_exchanged(points, fits, noise, stated)}"
    if over:
        reason += f"; {over}"
    coordinates = CoordinateSystem(
        source="survey", system=survey.system, offset=survey.offset, origin=survey.origin, rms=rms,
        scale_error=scale, rotation_error=turn, position_error=place, used=int(fits.sum()),
        left_out=int((~fits).sum()), points=table,
    )  # fmt: skip
    rung = Rung(name=NAME, taken=True, reason=reason)
    return replace(located, rungs=(*located.rungs, rung)), coordinates


def _upside_down(model: SceneModel, similarity: Similarity) -> str:
    """Explanation of an upside-down scene, as points of one plane with exchanged axes allow it; else
    empty.

    Upright cameras have their upper edge up, or look down, whatever there is between the two.
    """
    axes = np.stack([pose.matrix()[:3, :3] for pose in model.poses.values()]) @ similarity.rotation.T
    if float(np.mean(-axes[:, 1, 2] - axes[:, 2, 2])) > UPSIDE_DOWN:
        return ""
    return (
        "the cameras would be upside down: check whether two axes of the survey are exchanged, or z "
        "points down"
    )


def _is_gross(points: _Points, similarity: Similarity, fits: Mask, noise: Array) -> bool:
    """Return whether even the best agreeing points miss by more than noise and a share of their distances."""
    there = points.there[fits]
    rms = float(np.sqrt(((similarity(points.here[fits]) - there) ** 2).sum(1).mean()))
    spread = float(np.sqrt(((there - there.mean(0)) ** 2).sum(1).mean()))
    return rms > max(GROSS * spread, TOO_FAR * float(np.sqrt(3 * (noise[fits] ** 2).mean())))


def _excess(misses: Array, noise: Array) -> float:
    """Variance of a coordinate beyond the noise, m2."""
    free = 3 * len(misses) - 7
    return max(float((misses**2).sum()) / free - float((noise**2).mean()), 0.0)


def _points(survey: Survey, sightings: Mapping[str, Sighting]) -> _Points:
    names = [name for name in survey.points if name in sightings]
    return _Points(
        names,
        np.array([sightings[name].place for name in names]).reshape(-1, 3),
        np.array([survey.points[name].position for name in names]).reshape(-1, 3),
        np.array([np.sqrt(np.trace(sightings[name].spread) / 3) for name in names]),
        np.array([survey.points[name].sigma or 0.0 for name in names]),
    )


def _require_same_unit(ratio: float, expected: Expected) -> None:
    """Raise CalibrationError if a survey's lengths contradict the other source."""
    if abs(ratio - 1) <= expected.tolerance:
        return
    near = max(expected.tolerance, OTHER_UNIT)
    units = [unit for unit, factor in _UNITS.items() if abs(ratio / factor - 1) <= near]
    guess = (
        f": they are in {units[0]}, and have to be in metres" if units else ": correct the one that is wrong"
    )
    raise CalibrationError(
        f"the surveyed points lie {ratio:.4g} times as far apart as {expected.teller} say{guess}"
    )


def _no_fit(points: _Points, similarity: Similarity, fits: Mask, noise: Array, stated: bool) -> str:
    missed = np.linalg.norm(similarity(points.here) - points.there, axis=1)
    worst = ", ".join(
        f"{points.names[place]} by {length_text(float(missed[place]))}" for place in np.argsort(-missed)[:3]
    )
    hint = _exchanged(points, fits, noise, stated)
    agree = f", {int(fits.sum())} of {len(fits)} agree" if fits.sum() < (len(fits) + 1) // 2 else ""
    return f"the surveyed points do not fit the scene{agree} ({worst} off)" + (
        hint or ": look for exchanged names or axes, a coordinate in another unit, and wrong marks"
    )


def _misfits(points: _Points, fits: Mask) -> str:
    out = [name for name, good in zip(points.names, fits, strict=True) if not good]
    return f"{', '.join(out)} {'does' if len(out) == 1 else 'do'} not fit and {_is(out)} left out"


def _exchanged(points: _Points, fits: Mask, noise: Array, stated: bool) -> str:
    """Return what makes all of them fit: two names or two axes exchanged; empty if nothing does."""
    if len(points.names) <= FEWEST:
        return ""
    for one, other in combinations(range(len(points.names)), 2):
        if fits[one] and fits[other]:
            continue
        order = list(range(len(points.names)))
        order[one], order[other] = other, one
        if consensus(points.here, points.there[order], noise, stated=stated)[1].all():
            return f": {points.names[one]} and {points.names[other]} fit if their names are exchanged"
    for axes, words in (((1, 0, 2), "x and y"), ((2, 1, 0), "x and z"), ((0, 2, 1), "y and z")):
        if consensus(points.here, points.there[:, axes], noise, stated=stated)[1].all():
            return f": all fit if {words} are exchanged, since the survey is mirrored"
    return ""


def _too_few(
    survey: Survey,
    marks: Marks,
    places: Mapping[str, Mapping[ViewId, Array]],
    sightings: Mapping[str, Sighting],
) -> str:
    placed = [name for name in survey.points if name in sightings]
    lost = [
        f"{name} ({_why_unplaced(marks.get(name, {}), places.get(name, {}))})"
        for name in survey.points
        if name not in sightings
    ]
    return (
        f"{FEWEST} surveyed points have to be marked in two views with a pose, better in three, and "
        f"{', '.join(placed) or 'none'} {_is(placed)}: mark {', '.join(lost)} in more views"
    )


def _why_unplaced(marks: Mapping[ViewId, object], placed: Mapping[ViewId, Array]) -> str:
    if not marks:
        return "without a mark"
    if len(placed) < 2:
        return f"marked in {len(marks)}, with a pose {len(placed)}"
    return f"the marks in {', '.join(map(str, placed))} are not of one place"


def _table(
    survey: Survey,
    marks: Marks,
    sightings: Mapping[str, Sighting],
    points: _Points,
    fits: Mask,
    misses: Array,
    views: Views,
    shrunk: Mapping[str, Array],
    offset: Array,
) -> tuple[SurveyedPoint, ...]:
    rows = []
    for name, point in survey.points.items():
        point_marks = []
        for view, mark in sorted(marks.get(name, {}).items()):
            if view in views:
                projected = views.project(view, (np.array(point.position) - offset)[None])[0]
                off = projected / shrunk[view.camera] - mark.at
                if np.isfinite(off).all():
                    mark = mark.model_copy(update={"miss": (float(off[0]), float(off[1]))})
            point_marks.append(mark)
        row = SurveyedPoint(name=name, position=point.position, sigma=point.sigma, marks=tuple(point_marks))
        if name in sightings:
            place = points.names.index(name)
            x, y, z = misses[place].tolist()
            odd = sightings[name].odd
            reason = "" if fits[place] else "the others place it elsewhere"
            if odd:
                reason = "; ".join(
                    filter(None, (reason, f"its marks in {', '.join(map(str, odd))} are not used"))
                )
            row = row.model_copy(update={"miss": (x, y, z), "used": bool(fits[place]), "reason": reason})
        else:
            placed = {view: np.zeros(2) for view in marks.get(name, {}) if view in views}
            row = row.model_copy(update={"reason": _why_unplaced(marks.get(name, {}), placed)})
        rows.append(row)
    return tuple(rows)


def _is(names: list[str]) -> str:
    return "is" if len(names) <= 1 else "are"
