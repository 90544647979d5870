"""A session's calibration, from its own pictures: exposures, response, poses, lens, falloff."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from calib import exposures, features, previews, response, sfm, tracks, vignetting
from calib.codes import Samples, sample
from calib.lens_guess import guess_lens
from calib.views import Progress, View, read_view, scene_views
from imaging import store
from imaging.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Lens,
    Response,
    ViewCalibration,
    read_calibration,
)
from imaging.colour import camera_from_rec709
from imaging.errors import CalibrationError
from imaging.merge import merge_bracket
from imaging.noise import SensorNoise
from imaging.photo import read_photo
from imaging.raw import read_raw
from imaging.records import CameraRecord, Rung
from imaging.session import Session

Part = Literal["response", "poses"]
SITES = 20_000
"""Photosites that the response of one camera model is measured from."""


@dataclass(frozen=True)
class _Light:
    """What is known about exposure and response before any pose is."""

    scale: dict[str, float]
    responses: dict[str, Response]
    rungs: tuple[Rung, ...]


def calibrate(
    session: Path,
    *,
    only: Part | None = None,
    progress: Progress = lambda message, done, total: None,
) -> CalibrationRecord:
    """Calibrate a session and write its `calibration/` folder; returns what was written.

    only: redo this part and keep the rest of the calibration that is there; 'response' needs no poses.
    The folder is replaced as a whole or not at all. Errors: CalibrationError when no view can be placed,
    InputError for a damaged session, StorageError.
    """
    opened = Session.open(session)
    views = scene_views(opened)
    earlier = read_calibration(session) if only and (session / "calibration").is_dir() else None
    if only == "poses" and earlier is not None:
        responses = {camera.name: camera.response for camera in earlier.cameras}
        own = tuple(rung for rung in earlier.rungs if rung.name == "response_curve")
        light = _Light(dict(earlier.exposure_scale), responses, own)
    else:
        light = _light(opened, views, progress)
    if only == "response":
        return _write_response(opened, light, earlier)
    return _with_poses(opened, views, light, progress)


def _light(session: Session, views: Sequence[View], progress: Progress) -> _Light:
    scale = exposures.labelled(views)
    responses: dict[str, Response] = {}
    rungs: list[Rung] = []
    raw = [view for view in views if view.camera.kind == "raw"]
    if raw:
        found = exposures.estimate(session, raw, progress)
        scale |= found.scale
        rungs += found.rungs
        for name in {view.camera.name for view in raw}:
            line = found.linearity.get(name)
            said = "no two exposures overlap, so it was not checked" if line is None else (
                f"overlapping exposures agree with a straight line to {100 * line.deviation:.2f} %"
            )  # fmt: skip
            responses[name] = Response(kind="linear", evidence=f"RAW: {said}")
    for view in views:
        if view.camera.kind == "hdr":
            responses[view.camera.name] = Response(kind="linear", evidence="linear EXR")
    for members in _models(views, "ldr"):
        estimate = response.estimate(_samples(session, members, scale, progress))
        rungs += estimate.rungs
        for view in members:
            responses[view.camera.name] = estimate.response
            for shot in view.shots:
                label = round(float(np.log(scale[shot.file])), 6)
                nearest = min(estimate.shift, key=lambda key: abs(key - label), default=None)
                if nearest is not None and abs(nearest - label) < 1e-3:
                    scale[shot.file] *= float(np.exp(estimate.shift[nearest]))
    return _Light(scale, responses, tuple(rungs))


def _models(views: Sequence[View], kind: str) -> list[list[View]]:
    """Views of a kind, by make and model of their camera: such cameras share a response."""
    groups: dict[tuple[str, str], list[View]] = {}
    for view in views:
        if view.camera.kind == kind:
            groups.setdefault((view.camera.make, view.camera.model), []).append(view)
    return list(groups.values())


def _samples(
    session: Session, views: Sequence[View], scale: dict[str, float], progress: Progress
) -> Samples | None:
    usable = [view for view in views if len({scale[shot.file] for shot in view.shots}) >= 2]
    parts = []
    for done, view in enumerate(usable):
        progress("sampling the response", done, len(usable))
        codes = np.stack([255.0 * read_photo(session.file(shot)).pixels for shot in view.shots])
        logs = np.log([scale[shot.file] for shot in view.shots])
        parts.append(sample(codes.astype(np.float64), logs, max(SITES // len(usable), 500)))
    return Samples.joined(parts) if parts else None


def _with_poses(
    session: Session, views: Sequence[View], light: _Light, progress: Progress
) -> CalibrationRecord:
    threads = len(os.sched_getaffinity(0))
    pictures, lights = {}, {}
    static = {camera.name: _static(session, camera, views) for camera in session.record.cameras}
    guesses: dict[str, Lens] = {}
    for done, view in enumerate(views):
        progress("making previews", done, len(views))
        merged = merge_bracket(read_view(session, view, light.scale, light.responses[view.camera.name]))
        key = (view.camera.name, view.frame)
        pictures[key] = previews.preview(merged).image
        matrix = static[view.camera.name].camera_from_rec709
        lights[key] = tracks.light(merged, None if matrix is None else np.array(matrix))
        if view.camera.name not in guesses:
            height, width = pictures[key].shape
            guesses[view.camera.name] = guess_lens(session.file(view.shots[0]), width, height)
    found = features.extract(pictures, threads, progress)
    rigs: dict[str, list[str]] = {}
    for camera in session.record.cameras:
        if camera.rig is not None and camera.name in guesses:
            rigs.setdefault(camera.rig, []).append(camera.name)
    try:
        model = sfm.solve(found, guesses, list(rigs.values()), threads, progress)
    except CalibrationError as error:
        raise CalibrationError(f"{session.folder}: {str(error)[0].lower()}{str(error)[1:]}") from error

    names = [camera.name for camera in session.record.cameras if camera.name in model.lenses]
    falloff = vignetting.estimate(
        tracks.brightness(model, lights, names),
        names,
        {camera.name: f"{camera.make} {camera.model}" for camera in session.record.cameras},
    )
    sizes = {view.camera.name: (view.shots[0].width, view.shots[0].height) for view in views}
    cameras = []
    for camera in session.record.cameras:
        name = camera.name
        update: dict[str, object] = {"response": light.responses.get(name, static[name].response)}
        if name in model.lenses:
            update |= {
                "lens": model.lenses[name].resized(*sizes[name]),
                "cam_from_rig": model.cam_from_rig.get(name),
                "vignetting": falloff.vignetting[name],
                "gain": falloff.gain[name],
            }
        cameras.append(static[name].model_copy(update=update))
    record = _record(
        session, cameras, light,
        views=[
            ViewCalibration(camera=name, frame=frame, cam_from_world=pose, points=model.points[name, frame])
            for (name, frame), pose in sorted(model.poses.items())
        ],
        unregistered=[view.name for view in views if (view.camera.name, view.frame) not in model.poses],
        points=int(model.reconstruction.num_points3D()),
        reprojection_px=model.reprojection_px,
        rungs=(
            *light.rungs, *falloff.rungs,
            Rung(
                name="rig_constraint", taken=model.rigged,
                reason="several frames show the cameras together" if model.rigged
                else "no frames show two cameras of one rig together",
            ),
        ),
    )  # fmt: skip
    progress("writing the calibration", 0, 1)
    with store.replacing(session.folder / "calibration") as part:
        for (name, frame), picture in pictures.items():
            file = part / "previews" / name / f"{frame:04d}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(cv2.imencode(".png", np.rint(255 * picture).astype(np.uint8))[1].tobytes())
        (part / "colmap").mkdir(parents=True)
        model.reconstruction.write(str(part / "colmap"))
        (part / "calibration.json").write_text(record.model_dump_json(indent=1) + "\n")
    progress("writing the calibration", 1, 1)
    return record


def _write_response(session: Session, light: _Light, earlier: CalibrationRecord | None) -> CalibrationRecord:
    """The response and the exposures alone; poses of an earlier calibration stay."""
    known = {} if earlier is None else {camera.name: camera for camera in earlier.cameras}
    views = scene_views(session)
    cameras = [
        known.get(camera.name, _static(session, camera, views)).model_copy(
            update={"response": light.responses[camera.name]} if camera.name in light.responses else {}
        )
        for camera in session.record.cameras
    ]
    if earlier is None:
        record = _record(
            session, cameras, light, [], [view.name for view in views], 0, None, light.rungs
        )  # fmt: skip
    else:
        fresh = {rung.name for rung in light.rungs}
        rungs = (*light.rungs, *(rung for rung in earlier.rungs if rung.name not in fresh))
        record = _record(
            session, cameras, light, earlier.views, earlier.unregistered,
            earlier.points, earlier.reprojection_px, rungs,
        )  # fmt: skip
    store.write_json(session.folder / "calibration" / "calibration.json", record.model_dump(mode="json"))
    return record


def _static(session: Session, camera: CameraRecord, views: Sequence[View]) -> CameraCalibration:
    """What a camera's files say about it."""
    base = CameraCalibration(
        name=camera.name, serial=camera.serial, response=Response(kind="srgb", evidence="no images")
    )
    own = [view for view in views if view.camera.name == camera.name]
    if camera.kind != "raw" or not own:
        return base
    raw = read_raw(session.file(own[0].shots[0]))
    update: dict[str, object] = {}
    if raw.noise_profile is not None:
        update["noise"] = SensorNoise.from_profile(raw.noise_profile, float(np.mean(raw.black)), raw.white)
    if raw.camera_from_xyz is not None:
        matrix = camera_from_rec709(raw.camera_from_xyz)
        update["camera_from_rec709"] = tuple(tuple(float(value) for value in row) for row in matrix)
    return base.model_copy(update=update)


def _record(
    session: Session,
    cameras: Sequence[CameraCalibration],
    light: _Light,
    views: Sequence[ViewCalibration],
    unregistered: Sequence[str],
    points: int,
    reprojection_px: float | None,
    rungs: Sequence[Rung],
) -> CalibrationRecord:
    return CalibrationRecord(
        created=datetime.now(UTC),
        versions={name: version(name) for name in ("hdr-rig", "pycolmap", "opencv-contrib-python-headless")},
        shots_sha256=store.sha256(session.folder / "shots.jsonl"),
        cameras=tuple(cameras),
        views=tuple(views),
        unregistered=tuple(unregistered),
        points=points,
        reprojection_px=reprojection_px,
        exposure_scale=light.scale,
        rungs=tuple(rungs),
    )
