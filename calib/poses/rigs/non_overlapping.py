"""Cameras of a rig that see nothing of what the others see: models of their own, tied together by motion.

That cameras are mounted to each other, the session says (`rig` of its cameras), and a frame is one instant.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.adjustment.observations import observations
from calib.poses.checks.brightness_steps import Pairs
from calib.poses.checks.contradictions import well_matched
from calib.poses.rigs.hand_eye import Tie, tie
from imaging.arrays import Array
from imaging.errors import CalibrationError
from imaging.files.colmap import pycolmap
from imaging.session.calibration import MOTION
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

_ALONE = "the other cameras have no view in common with {}"


@dataclass(frozen=True, eq=False)
class Joined:
    """Models that were tied together by motion, as one.

    cameras: those that motion ties to the others. rungs: what was tied or not, and why.
    """

    reconstruction: Any
    cameras: frozenset[str]
    rungs: tuple[Rung, ...]


def cameras_apart(rigs: Sequence[Sequence[str]], pairs: Pairs, placed: Collection[ViewId]) -> frozenset[str]:
    """The cameras that no match joins to those with placed views, while their rig may.

    Another camera of their rig is placed, they are not, and they match each other, but none of the others
    well.
    """
    here = {view.camera for view in placed}
    lost = {name for rig in rigs if here.intersection(rig) for name in rig} - here
    if not lost:
        return frozenset()
    least = well_matched(pairs, placed)
    links = {
        (one.camera, other.camera): len(pair.one) >= least
        for (one, other), pair in sorted(pairs.items(), key=lambda item: len(item[1].one))
    }
    reached: set[str] = set()
    while more := {
        name
        for link, strong in links.items()
        for name in lost.intersection(link)
        if strong and not lost.issuperset(link)
    }:
        lost -= more
        reached |= more
    return frozenset(name for name in lost if any(name in link and lost.issuperset(link) for link in links))


def join(model: Any, others: Sequence[Any], rigs: Sequence[Sequence[str]]) -> Joined:
    """A COLMAP model with those of other cameras of its rigs that motion ties to it.

    Where there are others it is a copy, and theirs are moved into its world.
    """
    if not others:
        return Joined(model, frozenset(), ())
    whole = pycolmap.Reconstruction(model)
    tied: set[str] = set()
    rungs = []
    for other in others:
        names = sorted(_poses(other))
        try:
            one, name, link, frames = _tied(whole, other, rigs)
        except CalibrationError as error:
            rungs.append(unjoined(names, str(error)))
            continue
        reason = (
            f"{_ALONE.format(', '.join(names))}; how {name} and {one} moved in {frames} frames shows how "
            "they are mounted to each other"
        )
        rungs.append(Rung(name=MOTION, taken=True, reason=reason))
        _merge(whole, other, link)
        tied.update(names)
    return Joined(whole, frozenset(tied), tuple(rungs))


def unjoined(names: Collection[str], why: str) -> Rung:
    """Return why cameras that are apart have no pose."""
    return Rung(name=MOTION, taken=False, reason=f"{_ALONE.format(', '.join(sorted(names)))}, and {why}")


def _tied(model: Any, other: Any, rigs: Sequence[Sequence[str]]) -> tuple[str, str, Tie, int]:
    """The cameras, one of each model, that share most frames, their mounting, and the number of those
    frames.
    """
    here, there = _poses(model), _poses(other)
    shared = {
        (one, name): sorted(here[one].keys() & there[name].keys())
        for rig in rigs
        for one in sorted(here.keys() & set(rig))
        for name in sorted(there.keys() & set(rig))
    }
    if not shared:
        raise CalibrationError("no rig ties them to a camera that has poses")
    one, name = max(shared, key=lambda pair: len(shared[pair]))
    frames = shared[one, name]
    a, b = (
        np.array([poses[frame] for frame in frames]).reshape(-1, 4, 4) for poses in (here[one], there[name])
    )
    link = tie(a, b, (_distance(model, one), _distance(other, name)))
    return one, name, link, len(frames)


def _poses(model: Any) -> dict[str, dict[int, Array]]:
    """cam_from_world [4, 4] by camera and frame."""
    poses: dict[str, dict[int, Array]] = {}
    for index in sorted(model.reg_image_ids()):
        image = model.image(index)
        view = ViewId.of_image(image.name)
        pose = np.vstack([image.cam_from_world().matrix(), [0.0, 0.0, 0.0, 1.0]])
        poses.setdefault(view.camera, {})[view.frame] = pose
    return poses


def _distance(model: Any, name: str) -> float:
    """Median distance of what a camera sees."""
    observed = observations(model)
    distances = []
    for index, rows in observed.of_images():
        image = model.image(index)
        if ViewId.of_image(image.name).camera == name:
            local = image.cam_from_world() * observed.world[observed.point[rows]]
            distances.append(np.linalg.norm(local, axis=1))
    return float(np.median(np.concatenate(distances)))


def _merge(model: Any, other: Any, link: Tie) -> None:
    """Add another model of the same database, whose images the model does not have; the other is moved."""
    other.transform(pycolmap.Sim3d(link.a_world_from_b_world))
    for number in sorted(other.cameras):
        if not model.exists_camera(number):
            model.add_camera(other.cameras[number])
    for number in sorted(other.rigs):
        if not model.exists_rig(number):
            model.add_rig(other.rigs[number])
    for index in sorted(other.reg_image_ids()):
        image = other.image(index)
        frame = pycolmap.Frame(frame_id=image.frame_id, rig_id=image.frame.rig_id)
        frame.rig_from_world = image.frame.rig_from_world
        frame.add_data_id(image.data_id)
        model.add_frame(frame)
        places = np.array([point.xy for point in image.points2D], np.float64).reshape(-1, 2)
        added = pycolmap.Image(image.name, places, image.camera_id, index)
        added.frame_id = image.frame_id
        model.add_image(added)
        model.register_frame(image.frame_id)
    for number in sorted(other.points3D):
        point = other.points3D[number]
        model.add_point3D(point.xyz, point.track)
