"""The model of a scene that its matches do not contradict, chosen among rivals.

Geometry alone cannot say which pair of a cycle is false (Zach, Klopschitz and Pollefeys, "Disambiguating
Visual Relations Using Loop Constraints", 2010). Light can, where exposures are steady: a point is as bright
from one place as from another nearby. What light says is tested as well: pairs that it calls false have to
contradict the model made without them, else it is shine, or a camera that exposes by itself, and does not
count.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from calib.poses.checks.brightness_steps import Pairs, lit_apart, mostly_apart, otherwise_lit, warning
from calib.poses.checks.confirmation import seen_by_three, unconfirmed
from calib.poses.checks.contradictions import (
    contradicting,
    fitting,
    most_doubtful,
    placed_views,
    shut_out,
    strong,
)
from calib.poses.checks.loops import open_pairs, turns_of
from imaging.and_list import and_more
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

DOUBTFUL = 0.3
"""Share of a view's matches in pairs that contradict its pose, above which it is left out. Of a telephone's
video before a patterned wallpaper, all of whose 50 views stand where they are published, 0.12 at most."""
LOOPS = 0, 1, 2
"""Loops of three that have to close with a pair, in turn, until no pair contradicts the poses."""
MOST_LEFT_OUT = 0.1
"""Share of views that are left out or fit nowhere, though they match well, above which all are in doubt: of a
scene that is folded, the views at the folds are those that contradict the rest, and the rest is wrong."""
REFUTED = 0.5
"""Share of the pairs which light calls false that fit the model made without them, above which light is
wrong: 0 of 77 where sides of a crate look alike, 424 of 595 in a telephone's video."""
FEWEST_TESTED = 5
"""Such pairs below which their share says nothing."""


class Contradicted(CalibrationError):
    """Views contradict each other so much that none can be said to be right."""


CHECK = "pose_contradictions"
UNCONFIRMED = "pose_unconfirmed"
DOUBTS = "pose_lit_differently", UNCONFIRMED, "pose_undecided"
"""Rungs that make poses doubtful."""
_ALIKE = (
    "the views contradict each other about their poses, as happens where parts of a scene look alike: put "
    "something unique beside them and take views 15 degrees apart, or keep them with a warning by "
    "--keep-doubtful"
)
_Pair = tuple[ViewId, ViewId]


@dataclass(frozen=True, eq=False)
class Matches:
    """Views that match, and how a model is made of them.

    Attributes:
        database: COLMAP's, from which pairs are deleted that are false.
        pairs: Those that match, verified.
        brightness: Natural log of the luminance at each feature of each view [K], NaN where unknown.
        max_error: Of the epipolar geometry, px.
        again: Makes a model of the database as it is now; None where no two views can be placed.
        exact: Cameras whose brightness is known so well that it differs only where things do.
        steady: Cameras whose exposure stays as it is from view to view, those that are exact among them.
    """

    database: Any
    pairs: Pairs
    brightness: Mapping[ViewId, Array]
    max_error: float
    again: Callable[[], Any | None]
    exact: Collection[str] = ()
    steady: Collection[str] = ()


@dataclass(frozen=True, eq=False)
class ResolvedModel:
    """The model that was chosen, the views that had to be left out of it, what was done, and what makes the
    poses doubtful all the same. pairs: how many views match. hanging: views that one pair holds on the
    others."""

    reconstruction: Any
    left_out: frozenset[ViewId]
    rungs: tuple[Rung, ...]
    pairs: int
    hanging: frozenset[ViewId] = frozenset()

    @property
    def cameras(self) -> set[str]:
        """Cameras with a registered view."""
        return {view.camera for view in placed_views(self.reconstruction)}


def resolve_contradictions(
    reconstruction: Any, matches: Matches, *, keep_doubtful: bool = False
) -> ResolvedModel:
    """Choose the model that matches and light do not contradict, and leave out what cannot be reconciled.

    Args:
        reconstruction: The first model, of all pairs.
        matches: What it was made from.
        keep_doubtful: Keep what stays undecided, with a warning that names it, instead of leaving it out.

    Raises:
        Contradicted: None of the views can be said to be right.
    """
    chosen = _Choice(reconstruction, matches, keep_doubtful).made()
    pairs, placed = matches.pairs, placed_views(chosen.reconstruction)
    poses = {view: pose for view, (_, pose) in placed.items()}
    doubts = (
        warning(poses, pairs, matches.brightness, matches.exact),
        unconfirmed(poses, pairs, seen_by_three(chosen.reconstruction)),
        chosen.undecided,
    )
    rungs = [Rung(name=n, taken=True, reason=w) for n, w in zip(DOUBTS, doubts, strict=True) if w is not None]
    return ResolvedModel(chosen.reconstruction, frozenset(chosen.left_out), (chosen.rung, *rungs), len(pairs))


@dataclass(frozen=True, eq=False)
class _Chosen:
    """A model, the views left out of it, why it was chosen, and what stays undecided."""

    reconstruction: Any
    left_out: set[ViewId]
    rung: Rung
    undecided: str | None = None


class _Choice:
    """Rivals in the order in which they are asked: by light, the first model without its worst views, by
    loops."""

    def __init__(self, reconstruction: Any, matches: Matches, keep_doubtful: bool) -> None:
        self.first, self.matches, self.keep_doubtful = reconstruction, matches, keep_doubtful
        self.reason = ""

    def made(self) -> _Chosen:
        """The first rival that can be reconciled.

        Raises:
            Contradicted: None can.
        """
        first, matches = self.first, self.matches
        against = contradicting(first, matches.pairs, matches.max_error)
        out = shut_out(first, matches.pairs)
        # Without exact light, views that fit nowhere show no more than that views are missing between them.
        if not against and not (out and matches.exact) and not self._mostly_apart():
            self.reason = f"none of {len(matches.pairs)} pairs of views that match contradicts the poses"
            return _Chosen(first, set(), self._rung(taken=False))
        self.reason = (
            f"{len(against)} of {len(matches.pairs)} pairs of views that match contradicted the poses"
        )
        if out:
            self.reason += f", and {len(out)} views that match others well fitted nowhere"
        if self.keep_doubtful:
            return self._undropped(against)
        if self._folded():
            lit = self._by_light()
            if lit is not None:
                return self._without_worst(*lit) or self._refused()
        return self._without_worst(first, matches.pairs) or self._by_loops() or self._refused()

    def _rung(self, *, taken: bool) -> Rung:
        return Rung(name=CHECK, taken=taken, reason=self.reason)

    def _folded(self) -> bool:
        """Return whether the light shows the model to be folded: it is exact, or neighbouring views differ in
        brightness.
        """
        if self.matches.exact:
            return True
        poses = {view: pose for view, (_, pose) in placed_views(self.first).items()}
        return lit_apart(poses, self.matches.pairs, self.matches.brightness, self.matches.steady)

    def _mostly_apart(self) -> bool:
        """Tell if the light would have had to change with every photograph, were the first model right."""
        poses = {view: pose for view, (_, pose) in placed_views(self.first).items()}
        matches = self.matches
        return mostly_apart(poses, matches.pairs, matches.brightness, matches.exact)

    def _differs_beside(self) -> bool:
        """Return whether views that look from the same side in the first model differ in brightness."""
        poses = {view: pose for view, (_, pose) in placed_views(self.first).items()}
        matches = self.matches
        return warning(poses, matches.pairs, matches.brightness, matches.steady) is not None

    def _by_light(self) -> tuple[Any, Pairs] | None:
        """A model without pairs that are lit differently, and its pairs; None where it shows that light is
        wrong."""
        matches = self.matches
        steady = {view: one for view, one in matches.brightness.items() if view.camera in matches.steady}
        false = otherwise_lit(matches.pairs, steady)
        if not false:
            return None
        rest = {pair: one for pair, one in matches.pairs.items() if pair not in false}
        deleted = self._delete(false)
        model, pairs = self._closed(rest, deleted)
        if model is None:
            # Nothing is left that could refute light: it is believed where the first model bears it out.
            if self._differs_beside():
                self.reason += (
                    f"; {len(false)} pairs are lit differently, and no views can be placed without them"
                )
                self._refused()
        else:
            fit, tested = fitting(model, {pair: matches.pairs[pair] for pair in false}, matches.max_error)
            if tested < FEWEST_TESTED or fit <= REFUTED * tested:
                self.reason += (
                    f"; {len(false)} pairs are lit differently and show things that only look alike"
                )
                return model, pairs
        self._restore(deleted)
        return None

    def _by_loops(self) -> _Chosen | None:
        """The model without pairs whose loops stay open, if that reconciles it."""
        model, pairs = self._closed(self.matches.pairs, {})
        return None if model is None else self._without_worst(model, pairs)

    def _closed(self, pairs: Pairs, deleted: dict[_Pair, Any]) -> tuple[Any | None, Pairs]:
        """A model without pairs whose loops stay open, as many as it takes; deleted: gets what is deleted."""
        matches, model = self.matches, None
        turns = turns_of(self.first, pairs, matches.max_error)
        for loops in LOOPS:
            false = open_pairs(turns, loops)
            pairs = {pair: one for pair, one in pairs.items() if pair not in false}
            deleted |= self._delete(false)
            model = matches.again()
            if model is None or not contradicting(model, pairs, matches.max_error):
                break
        return model, pairs

    def _without_worst(self, model: Any, pairs: Pairs) -> _Chosen | None:
        """The model without the views that are most contradicted; None where too many are, or too
        strongly."""
        matches, left_out = self.matches, set()
        model = type(model)(model)
        while against := contradicting(model, pairs, matches.max_error):
            view, share = most_doubtful(model, pairs, against)
            if share < DOUBTFUL:
                break
            left_out.add(view)
            model.deregister_frame(model.find_image_with_name(view.image_name).frame_id)
        out = shut_out(model, pairs) - left_out
        views = {view for pair in pairs for view in pair}
        if strong(model, pairs, against) or len(out | left_out) > MOST_LEFT_OUT * len(views):
            return None
        if against:
            self.reason += f"; {len(against)} are outvoted by the others"
        if left_out:
            self.reason += f"; {len(left_out)} views are left out that most contradicted"
        return _Chosen(model, left_out | out, self._rung(taken=True))

    def _undropped(self, against: Mapping[_Pair, int]) -> _Chosen:
        """The first model as it is, with a warning that names the views which are contradicted."""
        views = sorted({str(view) for pair in against for view in pair})
        undecided = None
        if views:
            undecided = (
                f"{self.reason}, and all are kept by --keep-doubtful: poses of {and_more(views, 8)} may be "
                "wrong"
            )
        return _Chosen(self.first, set(), self._rung(taken=True), undecided)

    def _refused(self) -> _Chosen:
        raise Contradicted(f"{self.reason}; {_ALIKE}.")

    def _delete(self, pairs: Collection[_Pair]) -> dict[_Pair, Any]:
        """Delete pairs from the database; returns their geometries."""
        database, images = self.matches.database, self._images()
        deleted = {}
        for one, other in pairs:
            if database.exists_two_view_geometry(images[one], images[other]):
                deleted[one, other] = database.read_two_view_geometry(images[one], images[other])
                database.delete_two_view_geometry(images[one], images[other])
        return deleted

    def _restore(self, deleted: Mapping[_Pair, Any]) -> None:
        images = self._images()
        for (one, other), geometry in deleted.items():
            self.matches.database.write_two_view_geometry(images[one], images[other], geometry)

    def _images(self) -> dict[ViewId, int]:
        return {
            ViewId.of_image(image.name): image.image_id for image in self.matches.database.read_all_images()
        }
