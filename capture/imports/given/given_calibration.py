"""The lenses, poses and points that a layout brings, written as the calibration of the session."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from capture.imports.copying import Place
from capture.imports.layouts.colmap import MODELS, lens_of_camera
from capture.imports.layouts.colmap_files import read_model
from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.layouts.named_files import file_named
from capture.imports.originals import Original, shown
from imaging.errors import InputError
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.files.exr.reading import read_exr
from imaging.files.raw import read_raw
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.sensor.mosaic import RawMosaic
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Response,
    ViewCalibration,
    colour_rung,
)
from imaging.session.records import CameraRecord, Rung, ShotRecord
from imaging.session.session import Session
from imaging.session.view_id import ViewId

FILE = "calibration/calibration.json"

SAME_SHAPE = 0.01
"""Tolerance of the aspect ratio of a picture against that of its lens: sizes are rounded."""


def has_poses(given: Given | None) -> bool:
    """Return whether a layout has the pose of any photograph."""
    return given is not None and any(photo.cam_from_world is not None for photo in given.photos)


def check_sizes(given: Given, originals: Sequence[Original]) -> None:
    """InputError for the first photograph whose shape is not that of its lens."""
    photo_of = {photo.path: photo for photo in given.photos}
    for original in originals:
        lens = photo_of[original.path].lens
        if original.picture is None or lens is None:
            continue
        width, height = original.picture.width, original.picture.height
        if abs(math.log(width / height * lens.height / lens.width)) > SAME_SHAPE:
            raise InputError(
                f"{shown(original.path)} has {width}x{height} pixels but {given.source} says "
                f"{lens.width}x{lens.height}: correct one of them, or use --layout photos."
            )


def write_given(session: Session, given: Given, places: Sequence[Place]) -> CalibrationRecord:
    """Write `calibration/` from the layout; `rig calibrate --only response` adds the rest.

    One pose a view: that of the first of its photographs that has one. The COLMAP model that is
    written has the layout's points, where it has some, and each view as one image.
    """
    photo_of = {photo.path: photo for photo in given.photos}
    shots = {shot.identity: shot for shot in session.shots()}
    taken = [
        (place, shots[place.plan, *place.shot_id])
        for place in places
        if (place.plan, *place.shot_id) in shots
    ]
    posed = _posed(taken, photo_of)
    lenses = _lenses(taken, photo_of)
    # The layout's own points are kept, where it has some; else the model has the poses alone.
    names = {place.original.path: shot.view.image_name for place, shot in taken if shot.view in posed}
    model = _with_points(given, names) or _model_of(posed, lenses, given)
    points_of = {image.name: image.num_points3D for image in model.images.values()}
    views = tuple(
        ViewCalibration(
            camera=view.camera,
            frame=view.frame,
            cam_from_world=photo.cam_from_world,
            points=points_of.get(view.image_name, 0),
        )
        for view, photo in sorted(posed.items())
        if photo.cam_from_world is not None
    )
    # What no layout states, noise and colour, is as the files say until it is measured.
    every = {shot.view for _, shot in taken}
    stated = _stated(session, [shot for _, shot in taken])
    record = CalibrationRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "pycolmap", "numpy")},
        shots_sha256=store.sha256(session.folder / "shots.jsonl"),
        cameras=tuple(
            CameraCalibration(
                name=camera.name,
                serial=camera.serial,
                lens=lenses.get(camera.name),
                cam_from_rig=_in_rig(camera, given, posed),
                response=_response(camera),
                noise=raw.noise if raw is not None else None,
                camera_from_rec709=raw.camera_from_rec709 if raw is not None else None,
            )
            for camera, raw in ((one, stated.get(one.name)) for one in session.record.cameras)
        ),
        views=views,
        unregistered=tuple(sorted(every - posed.keys())),
        points=int(model.num_points3D()),
        reprojection_px=float(model.compute_mean_reprojection_error()) if any(points_of.values()) else None,
        exposure_scale={shot.file: _scale(session, shot) for _, shot in taken},
        rungs=(
            Rung(name="poses", taken=True, reason=f"given by {given.teller}, not measured"),
            *([colour_rung([raw.camera_from_rec709 for raw in stated.values()])] if stated else []),
        ),
    )
    _write(session.folder / "calibration", model, record)
    return record


def _write(folder: Path, model: Any, record: CalibrationRecord) -> None:
    """Write model and record together: the record is what makes a session calibrated."""
    with store.replacing(folder) as part:
        part.mkdir()
        (part / "colmap").mkdir()
        try:
            model.write(str(part / "colmap"))
        except RuntimeError as error:  # which is how pycolmap reports a full disk
            raise OSError(str(error)) from error
        store.write_json(part / "calibration.json", record.model_dump(mode="json"))


def write_truth(session: Session, given: Given, places: Sequence[Place]) -> list[str]:
    """Copy the true light of the layout to `truth/`, if every view that has a pose has some; else a note.

    Any view may be held out later, and then its true light is asked for.
    """
    photo_of = {photo.path: photo for photo in given.photos}
    views: dict[ViewId, tuple[int, int]] = {}
    for place in places:
        picture = place.original.picture
        if picture is not None and photo_of[place.original.path].cam_from_world is not None:
            views[place.shot_id.view] = (picture.width, picture.height)
    lit = [view for view in views if view.frame in given.truth]
    if not given.truth:
        return []
    if len(lit) < len(views):
        return [
            f"The true light of {len(lit)} of {len(views)} views is left aside, since rig evaluate may ask "
            "for that of any view."
        ]
    for view, (width, height) in views.items():
        light = read_exr(given.truth[view.frame]).rgb()
        if light.shape[1] < width or light.shape[0] < height:
            return [
                f"The true light is left aside: {given.truth[view.frame]} is smaller than its photographs."
            ]
    for view in views:
        store.write_bytes(session.folder / "truth" / f"{view}.exr", given.truth[view.frame].read_bytes())
    # Of lenses, exposures and noise this truth knows nothing: lists that an evaluation finds empty.
    truth = {"schema_version": 1, "frames": [], "cameras": {}, "exposures": [], "response": None}
    store.write_json(session.folder / "truth" / "truth.json", truth)
    return [f"The true light of {len(views)} views is kept in truth/, for rig evaluate alone."]


def _posed(
    taken: Sequence[tuple[Place, ShotRecord]], photo_of: Mapping[Path, GivenPhoto]
) -> dict[ViewId, GivenPhoto]:
    """The first photograph with a pose of each view: of a bracket, a layout may list each with its own."""
    posed: dict[ViewId, GivenPhoto] = {}
    for place, _ in taken:
        photo = photo_of[place.original.path]
        if photo.cam_from_world is not None:
            posed.setdefault(place.shot_id.view, photo)
    return posed


def _lenses(
    taken: Sequence[tuple[Place, ShotRecord]], photo_of: Mapping[Path, GivenPhoto]
) -> dict[str, Lens]:
    """The lens of each camera at the size of its photographs."""
    lenses: dict[str, Lens] = {}
    for place, shot in taken:
        lens = photo_of[place.original.path].lens
        if lens is not None and shot.camera not in lenses:
            same = (lens.width, lens.height) == (shot.width, shot.height)
            lenses[shot.camera] = lens if same else lens.resized(shot.width, shot.height)
    return lenses


def _in_rig(camera: CameraRecord, given: Given, posed: Mapping[ViewId, GivenPhoto]) -> Pose | None:
    for view, photo in posed.items():
        if view.camera == camera.name and camera.rig is not None:
            # Cameras that --together joins have a rig of which the layout says nothing.
            rig = given.rigs.get(photo.camera)
            return None if rig is None else rig[1]
    return None


def _response(camera: CameraRecord) -> Response:
    if camera.kind == "ldr":
        return Response(kind="srgb", evidence="taken as sRGB; rig calibrate --only response measures it")
    what = "RAW" if camera.kind == "raw" else "EXR"
    return Response(kind="linear", evidence=f"{what}, taken as linear and not checked")


def _stated(session: Session, shots: Sequence[ShotRecord]) -> dict[str, RawMosaic]:
    """First shot of each camera that gave RAW, whose file states noise and colours."""
    first: dict[str, ShotRecord] = {}
    for shot in shots:
        if session.camera(shot.camera).kind == "raw":
            first.setdefault(shot.camera, shot)
    return {name: read_raw(session.file(shot)) for name, shot in first.items()}


def _scale(session: Session, shot: ShotRecord) -> float:
    """Scale as in a calibration: linear EXR is radiance, and an unknown exposure counts as 1 s."""
    is_exposed = shot.exposure is not None and session.camera(shot.camera).kind != "hdr"
    return shot.exposure.scale if is_exposed and shot.exposure is not None else 1.0


def _with_points(given: Given, names: Mapping[Path, str]) -> Any | None:
    """The layout's own COLMAP model, its images named as views; None if it has no model.

    names: of the view that each photograph belongs to. One image a view stays.
    """
    if given.model is None or given.images is None:
        return None
    model = read_model(given.model)
    for camera in model.cameras.values():
        lens = None if camera.model_name in MODELS else lens_of_camera(camera, given.model)
        if lens is not None:
            kind = "OPENCV_FISHEYE" if lens.fisheye else "OPENCV"
            camera.model, camera.params = getattr(pycolmap.CameraModelId, kind), list(lens.terms)
    free = set(names.values())
    for _, image in sorted(model.images.items()):
        name = names.get(given.developed.get(image.name) or file_named(given.images, image.name))
        if name in free:
            free.remove(name)
            image.name = name
        elif image.has_pose:  # with what other cameras of a rig saw at that moment
            model.deregister_frame(image.frame_id)
    return model


def _model_of(posed: Mapping[ViewId, GivenPhoto], lenses: Mapping[str, Lens], given: Given) -> Any:
    """A COLMAP model of the poses; its points, if the layout has any, are seen by no image."""
    model = pycolmap.Reconstruction()
    ids = {name: index for index, name in enumerate(sorted({view.camera for view in posed}), start=1)}
    for name, index in ids.items():
        lens = lenses[name]
        model_name = "OPENCV_FISHEYE" if lens.fisheye else "OPENCV"
        camera = pycolmap.Camera.create_from_model_name(index, model_name, lens.fx, lens.width, lens.height)
        camera.params = list(lens.terms)
        model.add_camera_with_trivial_rig(camera)
    for index, (view, photo) in enumerate(sorted(posed.items()), start=1):
        assert photo.cam_from_world is not None
        w, x, y, z = photo.cam_from_world.quaternion
        image = pycolmap.Image()
        image.name, image.image_id, image.camera_id = view.image_name, index, ids[view.camera]
        motion = pycolmap.Rigid3d(pycolmap.Rotation3d([x, y, z, w]), list(photo.cam_from_world.translation))
        model.add_image_with_trivial_frame(image, motion)
    for point in [] if given.points is None else given.points:
        model.add_point3D(point, pycolmap.Track())
    return model
