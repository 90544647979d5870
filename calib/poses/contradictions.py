"""Views that stand where other pairs of views say they cannot: put right where light tells, else left out.

A scene whose sides look alike is folded: views of one side are placed before another, and the points of both
fit. Where the fold ends, though, two neighbours match that the model sets apart. The matches of such a pair
fit an epipolar geometry of their own and not that of the model (the cycles of Zach, Klopschitz and Pollefeys,
"Disambiguating Visual Relations Using Loop Constraints", 2010). What pair of a cycle is false, geometry
cannot say; light can: a point is as bright from one place as from another nearby, and two sides that only
look alike are lit differently.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.data.features import MatchedPair
from calib.poses.brightness_steps import Array, Pairs, otherwise_lit, warning
from calib.poses.confirmation import seen_by_three, unconfirmed
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

FEWEST_AGAINST = 30
"""Matches of a pair that do not fit the model, below which they may be chance."""
SUPPORTED = 0.5
"""Share of a pair's matches that fit the model, below which the pair contradicts it."""
STRONG = 0.5
"""A pair is strong that has so many times the matches of the best that holds a view in its place."""
DOUBTFUL = 0.3
"""Share of a view's matches in pairs that contradict its pose, above which it is left out."""
LOOPS = 0, 1, 2
"""Loops of three that have to close with a pair, in turn, until no pair contradicts the poses."""
CLOSED = 10.0
"""Degrees by which the turns of three pairs may miss a closed loop."""
TRIALS, TOLD_BY = 2000, 300
"""Of a turn, by five matches each, and the matches that tell it: where three in ten agree, one trial in 400
has only such. The usual 100,000 of all matches take seconds a pair, and where fewer agree the turn is off by
more than `CLOSED` with either."""
MOST_LEFT_OUT = 0.1
"""Share of views that are left out or fit nowhere, though they match well, above which all are in doubt: of a
scene that is folded, the views at the folds are those that contradict the rest, and the rest is wrong."""

_ALIKE = (
    "the views contradict each other about where they stand, as where parts of a scene look alike: put "
    "something unique beside them and take views 15 degrees apart"
)


@dataclass(frozen=True, eq=False)
class ResolvedModel:
    """The model that no pair contradicts, the views that had to be left out of it, what was done, and what
    makes the poses doubtful all the same. pairs: how many views match."""

    reconstruction: Any
    left_out: frozenset[ViewId]
    rungs: tuple[Rung, ...]
    pairs: int

    @property
    def cameras(self) -> set[str]:
        """Those with a placed view."""
        return {view.camera for view in _placed(self.reconstruction)}


def resolve_contradictions(
    database: Any,
    reconstruction: Any,
    pairs: Pairs,
    brightness: Mapping[ViewId, Array],
    max_error: float,
    again: Callable[[], Any | None],
    exact: Collection[str] = (),
) -> ResolvedModel:
    """Find the pairs that contradict a model, and leave out what cannot be reconciled.

    database: of COLMAP, from which pairs are deleted that light says are false. brightness: natural log of
    the luminance at each feature of each view [K], NaN where unknown. max_error: of the epipolar geometry,
    px. again: makes a model of the database as it is now. exact: cameras whose brightness is known so well
    that it differs only where things do. Errors: CalibrationError when the views contradict
    each other so much that none can be told to be right.
    """
    reconstruction, left_out, rung = _reconciled(
        database, reconstruction, pairs, brightness, max_error, again, bool(exact)
    )
    poses = {view: pose for view, (_, pose) in _placed(reconstruction).items()}
    doubts = {
        "pose_lit_differently": warning(poses, pairs, brightness, exact),
        "pose_unconfirmed": unconfirmed(poses, pairs, seen_by_three(reconstruction)),
    }
    rungs = (Rung(name=name, taken=True, reason=why) for name, why in doubts.items() if why is not None)
    return ResolvedModel(reconstruction, frozenset(left_out), (rung, *rungs), len(pairs))


def _reconciled(
    database: Any,
    reconstruction: Any,
    pairs: Pairs,
    brightness: Mapping[ViewId, Array],
    max_error: float,
    again: Callable[[], Any | None],
    exact: bool,
) -> tuple[Any, set[ViewId], Rung]:
    """A model without contradictions, the views that were left out, and what was done."""
    against = contradicting(reconstruction, pairs, max_error)
    out = shut_out(reconstruction, pairs)
    # Without exact light, views that fit nowhere show no more than that views are missing between them.
    if not against and not (out and exact):
        reason = f"none of {len(pairs)} pairs of views that match contradicts the poses"
        return reconstruction, set(), Rung(name="pose_contradictions", taken=False, reason=reason)
    reason = f"{len(against)} of {len(pairs)} pairs of views that match contradicted the poses"
    if out:
        reason += f", and {len(out)} views that match others well fitted nowhere"
    false = otherwise_lit(pairs, brightness)
    if false:
        reason += f"; {len(false)} pairs are lit differently and show things that only look alike"
    pairs = {pair: own for pair, own in pairs.items() if pair not in false}
    turns = _turns(reconstruction, pairs, max_error)
    images = {ViewId.of_image(image.name): image.image_id for image in database.read_all_images()}
    for loops in LOOPS:
        open_ = _open(turns, loops)
        pairs = {pair: own for pair, own in pairs.items() if pair not in open_}
        for one, other in false | open_:
            if database.exists_two_view_geometry(images[one], images[other]):
                database.delete_two_view_geometry(images[one], images[other])
        reconstruction = again()
        if reconstruction is None:
            raise CalibrationError(f"{reason}; {_ALIKE}.")
        if not contradicting(reconstruction, pairs, max_error):
            break
    left_out = set()
    while against := contradicting(reconstruction, pairs, max_error):
        view, share = _most_doubtful(reconstruction, pairs, against)
        if share < DOUBTFUL:
            break
        left_out.add(view)
        image = reconstruction.find_image_with_name(view.image_name)
        reconstruction.deregister_frame(image.frame_id)
    out = shut_out(reconstruction, pairs) - left_out
    views = {view for pair in pairs for view in pair}
    if _strong(reconstruction, pairs, against) or len(out | left_out) > MOST_LEFT_OUT * len(views):
        raise CalibrationError(f"{reason}; {_ALIKE}.")
    if left_out:
        reason += f"; {len(left_out)} views are left out that most contradicted"
    return reconstruction, left_out | out, Rung(name="pose_contradictions", taken=True, reason=reason)


def _turns(reconstruction: Any, pairs: Pairs, max_error: float) -> dict[tuple[ViewId, ViewId], Array]:
    """Of each pair that has one, the turn [3, 3] from its first view to its second, by its matches alone."""
    cameras = {
        ViewId.of_image(image.name).camera: image.camera_id for image in reconstruction.images.values()
    }
    options = pycolmap.RANSACOptions(max_error=max_error, random_seed=0, max_num_trials=TRIALS)
    turns = {}
    for (one, other), pair in pairs.items():
        lenses = [reconstruction.cameras[cameras[view.camera]] for view in (one, other)]
        some = slice(None, None, math.ceil(len(pair.one) / TOLD_BY))
        found = pycolmap.estimate_relative_pose(
            lenses[0], pair.one[some], lenses[1], pair.other[some], options
        )
        if found is not None:
            turns[one, other] = found["cam2_from_cam1"].rotation.matrix()
    return turns


def _open(turns: Mapping[tuple[ViewId, ViewId], Array], least: int) -> set[tuple[ViewId, ViewId]]:
    """The pairs with which fewer loops of three close than do not, or fewer than `least`."""
    beside: dict[ViewId, dict[ViewId, Array]] = {}
    for (one, other), turn in turns.items():
        beside.setdefault(one, {})[other] = turn
        beside.setdefault(other, {})[one] = turn.T
    found = set()
    for one, other in turns:
        loops = [
            np.trace(beside[third][one] @ beside[other][third] @ beside[one][other])
            for third in beside[one].keys() & beside[other].keys()
        ]
        closed = sum(loop > 1 + 2 * np.cos(np.radians(CLOSED)) for loop in loops)
        if closed < max(len(loops) - closed, least):
            found.add((one, other))
    return found


def contradicting(reconstruction: Any, pairs: Pairs, max_error: float) -> dict[tuple[ViewId, ViewId], int]:
    """Of every pair of placed views that contradicts their poses, how many matches do."""
    placed = _placed(reconstruction)
    found = {}
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            fits = _fits(placed[one], placed[other], pair, max_error)
            if len(fits) - fits.sum() >= FEWEST_AGAINST and fits.mean() < SUPPORTED:
                found[one, other] = int(len(fits) - fits.sum())
    return found


def well_matched(pairs: Pairs, placed: Collection[ViewId]) -> float:
    """The matches from which on a pair is as good as those that placed views have with each other."""
    best = _best(pairs, placed)
    usual = median(best.values()) if best else 0
    return max(STRONG * usual, 2 * FEWEST_AGAINST)


def shut_out(reconstruction: Any, pairs: Pairs) -> set[ViewId]:
    """The views without a pose that match placed ones as well as these match each other."""
    placed = _placed(reconstruction)
    least = well_matched(pairs, placed)
    return {
        view
        for (one, other), pair in pairs.items()
        for view, beside in ((one, other), (other, one))
        if view not in placed and beside in placed and len(pair.one) >= least
    }


def _best(pairs: Pairs, placed: Collection[ViewId]) -> dict[ViewId, int]:
    """Of each placed view, the most matches that it shares with another."""
    best: dict[ViewId, int] = {}
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            best[one] = max(best.get(one, 0), len(pair.one))
            best[other] = max(best.get(other, 0), len(pair.one))
    return best


def _strong(reconstruction: Any, pairs: Pairs, against: Mapping[tuple[ViewId, ViewId], int]) -> bool:
    """Whether a pair contradicts the poses that has as many matches as those that hold its views there."""
    holding = {pair: own for pair, own in pairs.items() if pair not in against}
    best = _best(holding, _placed(reconstruction))
    return any(
        count >= STRONG * min(best.get(one, 0), best.get(other, 0)) for (one, other), count in against.items()
    )


def _placed(reconstruction: Any) -> dict[ViewId, tuple[Any, Array]]:
    """Camera and cam_from_world [4, 4] of every view that has a pose."""
    placed = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        pose = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
        placed[ViewId.of_image(image.name)] = reconstruction.cameras[image.camera_id], pose
    return placed


def _fits(
    one: tuple[Any, Array], other: tuple[Any, Array], pair: MatchedPair, max_error: float
) -> npt.NDArray[np.bool_]:
    """Which matches lie within `max_error` px of their epipolar lines (Sampson's distance)."""
    pose = other[1] @ np.linalg.inv(one[1])
    x, y, z = pose[:3, 3]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ pose[:3, :3]
    here, there = (
        np.column_stack([camera.cam_from_img(points), np.ones(len(points))])
        for (camera, _), points in ((one, pair.one), (other, pair.other))
    )
    line, back = here @ essential.T, there @ essential
    slope = np.sqrt((line[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1))
    focal = 0.5 * (one[0].mean_focal_length() + other[0].mean_focal_length())
    return np.asarray(np.abs((there * line).sum(1)) * focal <= max_error * np.maximum(slope, 1e-12))


def _most_doubtful(
    reconstruction: Any, pairs: Pairs, against: Mapping[tuple[ViewId, ViewId], int]
) -> tuple[ViewId, float]:
    """The view with the largest share of its matches in pairs that contradict the model, and the share."""
    placed = _placed(reconstruction)
    doubted, every = dict.fromkeys(placed, 0), dict.fromkeys(placed, 0)
    for (one, other), pair in pairs.items():
        if one in placed and other in placed:
            for view in (one, other):
                every[view] += len(pair.one)
                doubted[view] += len(pair.one) * ((one, other) in against)
    shares = {view: doubted[view] / max(every[view], 1) for view in placed}
    worst = max(shares, key=shares.__getitem__)
    return worst, shares[worst]
