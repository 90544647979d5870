"""Views whose own pictures place nothing, placed by the other cameras of their rig.

Where a rig is tied together, a frame is placed as a whole: a camera that saw black, blur or a bare wall
stands where the best known camera of that frame, and the rig between the two, say. The errors of both are
added as if independent, though they share that of the frame: what is stated is rather too large.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import hypot, inf, radians
from statistics import median

import numpy as np

from calib.poses.sfm import SceneModel, centres, pose_of
from imaging.and_list import and_more
from imaging.files.colmap import pycolmap
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

MOST_NAMES = 6


def place_by_rig(
    model: SceneModel, views: Collection[ViewId], rigs: Mapping[str, str]
) -> tuple[SceneModel, frozenset[ViewId]]:
    """The model with a pose for every view that its rig places, and which views these are.

    views: all there are. rigs: of each camera that is mounted, its rig's name. Such a view sees no scene
    point, and the COLMAP model does not hold it. Its error is stated where the other camera at its frame, and
    its own at another, have one.
    """
    poses, points = dict(model.poses), dict(model.points)
    turns = {} if model.errors is None else dict(model.errors.rotation)
    shifts = {} if model.errors is None else dict(model.errors.translation)
    placed = []
    for view in sorted(set(views) - set(model.poses)):
        name = view.camera
        tied = [other for other in model.cam_from_rig if name in rigs and rigs.get(other) == rigs[name]]
        beside = [place for other in tied if (place := ViewId(view.frame, other)) in model.poses]
        if name not in tied or not beside:
            continue
        best = min(beside, key=lambda place: turns.get(place, inf))
        across = model.cam_from_rig[name].matrix() @ np.linalg.inv(model.cam_from_rig[best.camera].matrix())
        poses[view] = pose_of(pycolmap.Rigid3d((across @ model.poses[best].matrix())[:3]))
        points[view] = 0
        placed.append(view)
        of_camera = [place for place in model.poses if place.camera == name and place in turns]
        if model.errors is not None and best in turns and of_camera:
            one, two = centres([poses[view], poses[best]])
            swing = float(np.linalg.norm(one - two)) * radians(turns[best])
            turn = median(model.errors.rotation[place] for place in of_camera)
            shift = median(model.errors.translation[place] for place in of_camera)
            turns[view] = hypot(turns[best], turn)
            shifts[view] = hypot(shifts[best], shift, swing)
    if not placed:
        return model, frozenset()
    errors = model.errors and replace(model.errors, rotation=turns, translation=shifts)
    rungs = (*model.rungs, _rung([str(view) for view in placed]))
    return replace(model, poses=poses, points=points, errors=errors, rungs=rungs), frozenset(placed)


def _rung(names: list[str]) -> Rung:
    reason = (
        f"no scene point in {and_more(names, MOST_NAMES)} was used: the pose follows from the "
        "other cameras of the rig at that frame, and the picture is not used for reconstruction"
    )
    return Rung(name="rig_placing", taken=True, reason=reason)
