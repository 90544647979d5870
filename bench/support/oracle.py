"""A calibration taken from the simulator's truth, for trials and tests of reconstruction alone.

Nothing of `rig` reads this: it stands in for `rig calibrate` where a trial must not depend on it. Poses,
lenses, colours, vignetting and gains are the true ones; the sparse points lie at the true depths of
well-textured pixels, as many as SfM would leave, each off by a few thousandths of its depth.
"""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from capture.simulated import capture_simulated
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.files import store
from imaging.files.colmap import pycolmap
from imaging.files.exr.reading import read_exr
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.sensor.mosaic import as_matrix
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response, ViewCalibration
from imaging.session.session import Session
from imaging.session.view_id import ViewId
from recon.data.geometry import project, rays
from recon.splat import SplatCamera


def oracle_session(
    folder: Path, name: str = "demo", *, seed: int = 0, frames: int | None = None, points: int = 2500
) -> Path:
    """Capture a simulated rig into `folder`, unless it is there already, and calibrate it from the truth."""
    if not (folder / "truth" / "truth.json").exists():
        capture_simulated(name, folder, seed=seed, frames=frames)
    if not (folder / "calibration" / "calibration.json").exists():
        calibrate_from_truth(folder, points=points, seed=seed)
    return folder


def calibrate_from_truth(folder: Path, *, points: int = 2500, seed: int = 0) -> None:
    """Write calibration/calibration.json and calibration/colmap of a simulated session."""
    session = Session.open(folder)
    truth = store.read_json(folder / "truth" / "truth.json")
    poses = {
        ViewId(entry["frame"], camera): Pose.model_validate(pose)
        for entry in truth["frames"]
        for camera, pose in entry["cam_from_world"].items()
    }
    lenses = {name: Lens.model_validate(camera["lens"]) for name, camera in truth["cameras"].items()}
    rng = np.random.Generator(np.random.PCG64(seed))
    xyz = _points(folder, poses, lenses, points, rng)
    counts = _write_colmap(folder / "calibration" / "colmap", poses, lenses, xyz)
    record = CalibrationRecord(
        created=datetime.now(UTC),
        versions={"oracle": "1"},
        shots_sha256=store.sha256(folder / "shots.jsonl"),
        cameras=tuple(
            _camera(name, camera, lenses[name], truth) for name, camera in truth["cameras"].items()
        ),
        views=tuple(
            ViewCalibration(camera=view.camera, frame=view.frame, cam_from_world=pose, points=counts[view])
            for view, pose in poses.items()
        ),
        points=len(xyz),
        exposure_scale={shot.file: _applied(truth, shot.file) for shot in session.shots("scene")},
    )
    store.write_json(folder / "calibration" / "calibration.json", record.model_dump(mode="json"))


def _camera(name: str, camera: dict[str, Any], lens: Lens, truth: dict[str, Any]) -> CameraCalibration:
    curve, rows = truth["response"], camera["camera_from_rec709"]
    response = Response(kind="linear", evidence="the truth")
    if curve is not None:
        response = Response(
            kind="curve",
            codes=tuple(curve["codes"]),
            log_exposure=tuple(tuple(channel) for channel in curve["log_exposure"]),
            evidence="the truth",
        )
    return CameraCalibration(
        name=name,
        serial=camera["serial"],
        lens=lens,
        cam_from_rig=Pose.model_validate(camera["cam_from_rig"]),
        noise=camera["noise"] if curve is None else None,
        response=response,
        vignetting=tuple(camera["vignetting"]),
        gain=camera["gain"],
        camera_from_rec709=None if curve or len(rows) == 1 else as_matrix(rows),
    )


def _applied(truth: dict[str, Any], file: str) -> float:
    entry = next(entry for entry in truth["exposures"] if entry["file"] == file)
    applied = entry["applied"]
    return float(applied["iso"] / 100 * applied["time"] / applied["f_number"] ** 2 * entry["light"])


def _points(
    folder: Path,
    poses: dict[ViewId, Pose],
    lenses: dict[str, Lens],
    count: int,
    rng: np.random.Generator,
) -> Array:
    """World points under the best-textured tenth of random pixels of every view."""
    # Where surfaces are depends on the rig's name alone, not on its light or its seed.
    scene = simulate(Session.open(folder).record.origin.removeprefix("sim:")).scene
    each, points = -(-count // len(poses)), []
    for view, pose in poses.items():
        image = read_exr(folder / "truth" / f"{view}.exr").rgb().mean(-1)
        log = np.log(image + np.percentile(image, 20))
        texture = np.hypot(*np.gradient(log))
        rows, columns = (rng.integers(2, side - 2, 10 * each) for side in image.shape)
        best = np.argsort(-texture[rows, columns], kind="stable")[:each]
        pixels = np.stack([columns[best], rows[best]], -1) + 0.5
        lens = SplatCamera.of(lenses[view.camera], pose)
        motion = pose.matrix()
        directions = rays(lens, pixels) @ motion[:3, :3]
        origin = -motion[:3, :3].T @ motion[:3, 3]
        lengths = np.linalg.norm(directions, axis=-1, keepdims=True)
        away = scene.depth(np.broadcast_to(origin, directions.shape), directions / lengths)
        away = away * (1 + 0.003 * rng.standard_normal(len(away)))
        points.append(origin + away[:, None] * directions / lengths)
    return np.concatenate(points)[:count]


def _write_colmap(
    folder: Path,
    poses: dict[ViewId, Pose],
    lenses: dict[str, Lens],
    xyz: Array,
) -> dict[ViewId, int]:
    """A COLMAP model of the views and points; how many points each view sees."""
    model = pycolmap.Reconstruction()
    numbers = {name: index + 1 for index, name in enumerate(lenses)}
    for name, lens in lenses.items():
        camera = pycolmap.Camera(
            model="OPENCV_FISHEYE" if lens.fisheye else "OPENCV",
            width=lens.width,
            height=lens.height,
            params=list(lens.terms),
            camera_id=numbers[name],
        )
        model.add_camera_with_trivial_rig(camera)
    tracks: list[list[tuple[int, int]]] = [[] for _ in xyz]
    counts = {}
    for number, (view, pose) in enumerate(poses.items(), start=1):
        lens = lenses[view.camera]
        pixels, depth = project(SplatCamera.of(lens, pose), xyz)
        inside = (depth > 0) & (pixels > 0).all(-1) & (pixels < [lens.width, lens.height]).all(-1)
        for place, point in enumerate(np.flatnonzero(inside)):
            tracks[point].append((number, place))
        counts[view] = int(inside.sum())
        image = pycolmap.Image(
            name=view.image_name,
            points2D=pycolmap.Point2DList([pycolmap.Point2D(pixel) for pixel in pixels[inside]]),
            camera_id=numbers[view.camera],
            image_id=number,
        )
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose.matrix()[:3]))
    for point, track in zip(xyz, tracks, strict=True):
        elements = [pycolmap.TrackElement(image, place) for image, place in track]
        model.add_point3D(point, pycolmap.Track(elements), np.zeros(3, np.uint8))
    with store.replacing(folder) as part:
        part.mkdir()
        model.write(str(part))
    return counts
