"""Known lenses and rig poses, put into a model of the scene."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import set_model
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.records import Rung
from imaging.session.view_id import ViewId


@dataclass(frozen=True)
class KnownRig:
    """lenses, at picture size, and cam_from_rig, metres, stay; by camera.

    places: of cameras in their rig, metres, in axes that all of the rig share: they give the scale.
    """

    lenses: Mapping[str, Lens] = field(default_factory=dict)
    cam_from_rig: Mapping[str, Pose] = field(default_factory=dict)
    places: Mapping[str, Sequence[float]] = field(default_factory=dict)


NOTHING = KnownRig()
FEWEST_FRAMES = 2
"""Frames that have to show two cameras of a rig before one place of each in the rig is better than two."""


def camera_of(lens: Lens) -> Any:
    """A pycolmap camera with exactly this lens."""
    camera = pycolmap.Camera(
        model="OPENCV_FISHEYE" if lens.fisheye else "OPENCV",
        width=lens.width,
        height=lens.height,
        params=list(lens.terms),
    )
    set_model(camera, lens.model)
    camera.has_prior_focal_length = True
    return camera


def to_metres(reconstruction: Any, known: KnownRig, rig: Sequence[str]) -> float | None:
    """Scale a model by the distances between the cameras of a rig; returns the factor, or None without
    any.

    By the median over all pairs of cameras of all frames: each is a distance that was measured.
    """
    frames: dict[int, dict[str, Array]] = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        view = ViewId.of_image(image.name)
        if view.camera in known.places and view.camera in rig:
            motion = image.cam_from_world().matrix()
            frames.setdefault(view.frame, {})[view.camera] = -motion[:, :3].T @ motion[:, 3]
    places = {name: np.array(known.places[name]) for name in rig if name in known.places}
    factors = []
    for positions in frames.values():
        names = sorted(positions)
        for number, one in enumerate(names):
            for other in names[number + 1 :]:
                there = float(np.linalg.norm(places[one] - places[other]))
                here = float(np.linalg.norm(positions[one] - positions[other]))
                if there > 0 and here > 0:
                    factors.append(there / here)
    if not factors:
        return None
    factor = float(np.median(factors))
    reconstruction.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(), np.zeros(3)))
    return factor


def tie_rigs(database: Any, reconstruction: Any, rigs: Sequence[Sequence[str]], known: KnownRig) -> Rung:
    """Tie the cameras of each rig together.

    Those whose places are known; else those that several frames show with a common reference camera.

    Args:
        database: pycolmap's, of the model; its rigs and frames are changed.
        reconstruction: pycolmap's, whose rigs and frames are changed.
        rigs: Names of the cameras of each rig.
        known: Poses of cameras in their rig that a board gave.

    Returns:
        Rung that says whether cameras were tied, and why.
    """
    frames: dict[str, set[int]] = {}
    for index in reconstruction.reg_image_ids():
        view = ViewId.of_image(reconstruction.image(index).name)
        frames.setdefault(view.camera, set()).add(view.frame)
    configs = []
    for names in rigs:
        placed = [name for name in names if name in frames]
        mounted = [name for name in placed if name in known.cam_from_rig]
        tied = {
            name: [other for other in placed if len(frames[other] & frames[name]) >= FEWEST_FRAMES]
            for name in placed
        }
        if len(mounted) > 1:
            tied = dict.fromkeys(mounted, mounted)
        reference = max(tied, key=lambda name: len(tied[name]), default=None)
        if reference is None or len(tied[reference]) < 2:
            continue
        members = []
        for name in tied[reference]:
            member = pycolmap.RigConfigCamera()
            member.image_prefix = f"{name}/"
            member.ref_sensor = name == reference
            if len(mounted) > 1 and name != reference:
                here, there = (known.cam_from_rig[camera].matrix() for camera in (name, reference))
                member.cam_from_rig = pycolmap.Rigid3d((here @ np.linalg.inv(there))[:3])
            members.append(member)
        config = pycolmap.RigConfig()
        config.cameras = members
        configs.append(config)
    if not configs:
        reason = f"no {FEWEST_FRAMES} frames show two cameras of one rig together"
        return Rung(name="rig_constraint", taken=False, reason=reason)
    pycolmap.apply_rig_config(configs, database, reconstruction)
    reason = "the session says that the cameras are mounted to each other, and several frames show them so"
    if known.cam_from_rig:
        reason = "a board gave the places of the cameras"
    return Rung(name="rig_constraint", taken=True, reason=reason)
