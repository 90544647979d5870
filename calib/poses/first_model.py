"""Views matched and placed for the first time, without what contradicts itself."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from calib.data.features import FEWEST_MATCHES, MatchedPair, fill_database
from calib.poses.checks.brightness_steps import Pairs
from calib.poses.checks.contradictions import placed_views
from calib.poses.checks.rival import agreement, hanging_on, joined_groups
from calib.poses.mapping import map_at_once, map_views
from calib.poses.pose_inputs import PoseInputs
from calib.poses.refusals import require_depth
from calib.poses.resolution import (
    UNCONFIRMED,
    Contradicted,
    Matches,
    ResolvedModel,
    resolve_contradictions,
)
from calib.poses.rigs.non_overlapping import cameras_apart, unjoined
from calib.poses.rigs.rig_twins import twins
from calib.poses.steps import Steps
from imaging.errors import CalibrationError
from imaging.optics.lens import Lens
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

PLACED = 0.5
"""Share of the views that match; a model that holds fewer is given up for one begun by going ahead."""
MOST = 0.8
"""The same; where one holds fewer, COLMAP's global mapper is asked as well."""
AGREED = 0.9
"""Share of the turns between two views that have to be the same by both mappers: 1.0 where poses are right,
0.38 before a wall whose parts look alike."""
_AT_ONCE = (
    "only {} of {} views that match could be placed one after another; {} were placed at once, which agrees "
    "with the turns of those"
)
_DISAGREE = (
    "placed all at once, only {:.0f} % of the turns between views are the same. Keep the poses with a "
    "warning by --keep-doubtful"
)
_AHEAD = (
    "only {} of {} views that match could be placed from views taken side by side, so pairs taken while "
    "moving forwards count too; these do not determine the focal length, and lenses stay as the files "
    "state"
)
NO_START = (
    "{} pairs of views match, but no two of them give a start from which the others can be placed: take "
    "more views, at most 30 degrees apart, that overlap by two thirds."
)


@dataclass(frozen=True, eq=False)
class FirstModels:
    """Model of most views, and those of cameras that no match joins to it though their rig may.

    held: cameras whose lenses are from the files. unplaced: reasons why other cameras that are apart have no
    model.
    """

    main: ResolvedModel
    apart: tuple[ResolvedModel, ...]
    held: frozenset[str]
    unplaced: tuple[Rung, ...]


def matched(inputs: PoseInputs, database: Any, models: Mapping[str, Any], max_error: float) -> Pairs:
    """The pairs of views that match, at least one; models: pycolmap cameras by name."""
    pairs = fill_database(
        database, models, inputs.features, max_error, inputs.rigs, inputs.unfinished, inputs.progress
    )
    if not pairs:
        raise CalibrationError(
            "No two views share enough of the scene to be placed: take views that overlap by two thirds."
        )
    return pairs


def first_models(
    inputs: PoseInputs,
    steps: Steps,
    database: Any,
    models: Mapping[str, Any],
    pairs: Pairs,
    cameras: Mapping[str, Lens],
    max_error: float,
) -> FirstModels:
    """Views mapped by their matches, without what contradicts itself.

    Args:
        inputs: Inputs of the poses.
        steps: Steps of this attempt, of which those of a stopped run are not done again.
        database: pycolmap's, with features and matches.
        models: pycolmap cameras by name.
        pairs: Pairs of views that match.
        cameras: Lenses at picture size, by name.
        max_error: Largest miss of a match or a point, px.

    Returns:
        The model of most views, and those of cameras that no match joins to it.

    Raises:
        OnePlace: All views were taken from one place.
        Contradicted: Views contradict each other so much that none can be said to be right.
        CalibrationError: No two views give a start from which the others can be placed.
        StorageError: The disk refuses to keep a step.
    """
    require_depth(pairs, cameras, max_error)
    placing = _Placing(inputs, steps, database, models, pairs, max_error)
    main, held, rest = placing.placed(frozenset(models))
    apart: list[ResolvedModel] = []
    unplaced: tuple[Rung, ...] = ()
    while rest:
        try:
            model, lenses, _ = placing.placed(rest)
        except CalibrationError as error:
            cause = f"{str(error)[0].lower()}{str(error)[1:].removesuffix('.')}"
            unplaced = (unjoined(rest, f"they cannot be placed by themselves: {cause}"),)
            break
        apart.append(model)
        held |= lenses
        rest -= model.cameras
    return FirstModels(main, tuple(apart), held, unplaced)


@dataclass(frozen=True, eq=False)
class _Placing:
    """Inputs of the placing of views after matching."""

    inputs: PoseInputs
    steps: Steps
    database: Any
    models: Mapping[str, Any]
    pairs: Mapping[tuple[ViewId, ViewId], MatchedPair]
    max_error: float

    def placed(self, names: frozenset[str]) -> tuple[ResolvedModel, frozenset[str], frozenset[str]]:
        """Model of most views of these cameras, those with lenses from the files, and those apart."""
        inputs = self.inputs
        pairs, views = self._of(names)
        first = self._mapped(views)
        apart: frozenset[str] = frozenset()
        if first is not None:
            apart = cameras_apart(inputs.rigs, pairs, views_of(first))
        # Cameras that no match joins are placed by themselves later, and joined by their rig.
        if apart:
            names -= apart
            pairs, views = self._of(names)
        matched = len({view for pair in pairs for view in pair})
        grown, held, ahead = self._walked_ahead(first, names, views, matched)
        model, rival, hanging, at_once = self._at_once(grown, held, views, matched)
        if model is None or model.num_points3D() < FEWEST_MATCHES:
            raise CalibrationError(NO_START.format(len(pairs)))
        # Only now is what contradicts itself left out: any mapper places look-alikes somewhere.
        settled = resolve_contradictions(
            model,
            Matches(
                self.database,
                pairs,
                inputs.brightness,
                self.max_error,
                lambda: self._mapped(views, held),
                inputs.exact,
                inputs.steady_or_exact,
            ),
            keep_doubtful=inputs.keep_doubtful,
        )
        if not inputs.keep_doubtful:
            settled = self._without_twins(settled, pairs)
            self._require_confirmed(settled, rival)
        hanging &= views_of(settled.reconstruction)
        rungs = (*ahead, *at_once, *settled.rungs)
        return replace(settled, rungs=rungs, hanging=frozenset(hanging)), held, apart

    def _mapped(self, views: Sequence[ViewId], held: frozenset[str] = frozenset()) -> Any | None:
        """Model of these views one after another; held: cameras whose lenses stay as the files state."""
        inputs = self.inputs
        fixed = camera_numbers(self.models, {*inputs.known.lenses, *held})
        images = [view.image_name for view in views]
        return self.steps.grown(
            lambda growth: map_views(
                self.database,
                images,
                self.max_error,
                fixed,
                inputs.threads,
                inputs.progress,
                growth,
                bool(held),
            )
        )

    def _walked_ahead(
        self, first: Any | None, names: frozenset[str], views: Sequence[ViewId], matched: int
    ) -> tuple[Any | None, frozenset[str], tuple[Rung, ...]]:
        """The first model, or one begun by going ahead where that places more; and cameras that it held.

        A walk ahead has no views side by side: it may begin without, as far as the files give the lens.
        """
        count = _placed(first)
        if count >= PLACED * matched or not names.issubset(self.inputs.focal_known):
            return first, frozenset(), ()
        another = self._mapped(views, names)
        if _placed(another) <= max(count, PLACED * matched):
            return first, frozenset(), ()
        return another, names, (Rung(name="walk_ahead", taken=True, reason=_AHEAD.format(count, matched)),)

    def _at_once(
        self, first: Any | None, held: frozenset[str], views: Sequence[ViewId], matched: int
    ) -> tuple[Any | None, Any | None, set[ViewId], tuple[Rung, ...]]:
        """The first model, or the rival where it places more; the rival; and its views that one pair holds.

        Views that match may still have no place: the other mapper is believed where both agree on turns.
        """
        count = _placed(first)
        if count >= MOST * matched:
            return first, None, set(), ()
        images = [view.image_name for view in views] if len(views) < len(self.inputs.features) else []
        self.inputs.progress("placing views at once", 0, 1)
        fixed = camera_numbers(self.models, {*self.inputs.known.lenses, *held})
        rival = self.steps.model(lambda: map_at_once(self.database, fixed, images))
        share = agreement(first, rival)
        if share is None or share < AGREED:
            return first, rival, set(), ()
        rival, hanging = self._joined(rival, first)
        if _placed(rival) <= count:
            return first, rival, set(), ()
        reason = _AT_ONCE.format(count, matched, _placed(rival))
        return rival, rival, hanging, (Rung(name="at_once", taken=True, reason=reason),)

    def _joined(self, rival: Any, first: Any) -> tuple[Any, set[ViewId]]:
        """The rival without many views that only one pair, and few points, join to those of the first model,
        and the few that it keeps though they hang on one."""
        views, confirmed = views_of(rival), views_of(first)
        names = {index: ViewId.of_image(rival.image(index).name) for index in rival.reg_image_ids()}
        tracks = [
            {names[element.image_id] for element in point.track.elements} for point in rival.points3D.values()
        ]
        groups = joined_groups(self.pairs, views, tracks)
        group = max(groups, key=lambda group: len(group & confirmed))
        hanging = views - group
        if not self.inputs.keep_doubtful:
            hanging = hanging_on(self.pairs, hanging, tracks)
        rival = type(rival)(rival)
        for view in views - group - hanging:
            rival.deregister_frame(rival.find_image_with_name(view.image_name).frame_id)
        return rival, hanging

    def _require_confirmed(self, settled: ResolvedModel, rival: Any | None) -> None:
        """Refuse poses that nothing confirms and another mapper contradicts.

        Raises:
            Contradicted: the turns between the registered views are others in the rival.
        """
        doubts = {rung.name: rung.reason for rung in settled.rungs if rung.taken}
        if UNCONFIRMED not in doubts:
            return
        share = agreement(settled.reconstruction, rival)
        if share is not None and share < AGREED:
            raise Contradicted(f"{doubts[UNCONFIRMED]}; {_DISAGREE.format(100 * share)}")

    def _without_twins(self, settled: ResolvedModel, pairs: Pairs) -> ResolvedModel:
        """The model without views at a look-alike of their place, as the mounting of the cameras shows."""
        rigs = self.inputs.rigs
        if not any(len(rig) > 1 for rig in rigs):
            return settled
        poses = {view: pose for view, (_, pose) in placed_views(settled.reconstruction).items()}
        wrong, frames = twins(poses, pairs, rigs)
        if not wrong:
            return settled
        model = type(settled.reconstruction)(settled.reconstruction)
        for view in wrong:
            model.deregister_frame(model.find_image_with_name(view.image_name).frame_id)
        reason = (
            f"{', '.join(sorted(map(str, wrong)))} had poses that contradict the mounting of the cameras, "
            f"which is the same in {frames} frames"
        )
        rung = Rung(name="rig_twins", taken=True, reason=reason)
        return replace(
            settled, reconstruction=model, left_out=settled.left_out | wrong, rungs=(*settled.rungs, rung)
        )

    def _of(self, names: Collection[str]) -> tuple[dict[tuple[ViewId, ViewId], MatchedPair], list[ViewId]]:
        """The pairs between views of these cameras, and all their views."""
        pairs = {
            (one, other): pair
            for (one, other), pair in self.pairs.items()
            if one.camera in names and other.camera in names
        }
        return pairs, [view for view in self.inputs.features if view.camera in names]


def _placed(model: Any | None) -> int:
    return 0 if model is None else int(model.num_reg_images())


def views_of(model: Any) -> set[ViewId]:
    """The views that a COLMAP model places."""
    return {ViewId.of_image(model.image(index).name) for index in model.reg_image_ids()}


def camera_numbers(models: Mapping[str, Any], names: Collection[str]) -> frozenset[int]:
    """The numbers of those cameras among the pycolmap cameras that have these names."""
    return frozenset(models[name].camera_id for name in names if name in models)
