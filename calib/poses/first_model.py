"""Views matched and placed for the first time, without what contradicts itself."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from calib.data.features import FEWEST_MATCHES, Features, fill_database
from calib.data.unfinished import Unfinished
from calib.poses.contradictions import ResolvedModel, resolve_contradictions
from calib.poses.known_rig import KnownRig
from calib.poses.mapping import map_views
from calib.poses.refusals import require_depth
from imaging.errors import CalibrationError
from imaging.lens import Lens
from imaging.progress import Progress
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

PLACED = 0.5
"""Share of the views that match; a model that holds fewer is given up for one begun by going ahead."""
_AHEAD = (
    "only {} of {} views that match could be placed from views taken side by side, so that pairs taken by "
    "going ahead count too; these tell no focal length, and lenses stay as the files say"
)
NO_START = (
    "{} pairs of views match, but no two of them give a start from which the others can be placed: take "
    "more views, at most 30 degrees apart, that overlap by two thirds."
)


@dataclass(frozen=True, eq=False)
class Scene:
    """What poses are found from, but for the lenses, which may be begun with twice."""

    features: Mapping[ViewId, Features]
    rigs: Sequence[Sequence[str]]
    threads: int
    progress: Progress
    focal_known: Collection[str]
    known: KnownRig
    pictures: Mapping[ViewId, bytes]
    brightness: Mapping[ViewId, npt.NDArray[np.float64]]
    exact: Collection[str]
    kept: Unfinished


def first_model(
    scene: Scene, database: Any, models: Mapping[str, Any], cameras: Mapping[str, Lens], max_error: float
) -> tuple[ResolvedModel, frozenset[str]]:
    """Views matched and mapped, without what contradicts itself; and the cameras whose lenses the files tell.

    models: pycolmap cameras by name.
    """
    pairs = fill_database(database, models, scene.features, max_error, scene.rigs, scene.kept, scene.progress)
    if not pairs:
        raise CalibrationError(
            "No two views share enough of the scene to be placed: take views that overlap by two thirds."
        )
    require_depth(pairs, cameras, max_error)
    held: frozenset[str] = frozenset()

    def mapped() -> Any | None:
        fixed = camera_numbers(models, {*scene.known.lenses, *held})
        return map_views(
            database, len(scene.features), max_error, fixed, scene.threads, scene.progress, ahead=bool(held)
        )

    def placed(model: Any | None) -> int:
        return 0 if model is None else int(model.num_reg_images())

    reconstruction = mapped()
    views = {view for pair in pairs for view in pair}
    told = frozenset(scene.focal_known)
    rungs: tuple[Rung, ...] = ()
    if placed(reconstruction) < PLACED * len(views) and told.issuperset(cameras):
        held = told
        another = mapped()
        if placed(another) > max(placed(reconstruction), PLACED * len(views)):
            reason = _AHEAD.format(placed(reconstruction), len(views))
            rungs = (Rung(name="walk_ahead", taken=True, reason=reason),)
            reconstruction = another
        else:
            held = frozenset()
    if reconstruction is None or reconstruction.num_points3D() < FEWEST_MATCHES:
        raise CalibrationError(NO_START.format(len(pairs)))
    settled = resolve_contradictions(
        database, reconstruction, pairs, scene.brightness, max_error, mapped, scene.exact
    )
    return replace(settled, rungs=(*rungs, *settled.rungs)), held


def camera_numbers(models: Mapping[str, Any], names: Collection[str]) -> frozenset[int]:
    """The numbers of those cameras among the pycolmap cameras that have these names."""
    return frozenset(models[name].camera_id for name in names if name in models)
