"""A toy session, calibrated from the simulator's truth: SfM needs more than 64x48 pixels."""

import math
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from imaging.files import store
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.sensor.noise import SensorNoise
from imaging.session.calibration import CalibrationRecord, CameraCalibration, Response, ViewCalibration
from imaging.session.records import Rung
from tests.conftest import MadeOnce


def calibrated_from_truth(session: Path) -> CalibrationRecord:
    """Write SESSION/calibration as a perfect `rig calibrate` would have, from truth/."""
    from drivers.sim.camera.lens import unproject
    from drivers.sim.rigs import simulate

    truth = store.read_json(session / "truth" / "truth.json")
    rig = simulate(truth["rig"], truth["seed"])
    cameras, views, points = [], [], []
    raw = truth["response"] is None
    for name, camera in truth["cameras"].items():
        cameras.append(
            CameraCalibration(
                name=name,
                serial=camera["serial"],
                lens=Lens.model_validate(camera["lens"]),
                cam_from_rig=Pose.model_validate(camera["cam_from_rig"]),
                noise=SensorNoise.model_validate(camera["noise"]) if raw else None,
                response=_response(truth),
                vignetting=tuple(camera["vignetting"]),
                gain=camera["gain"],
                camera_from_rec709=camera["camera_from_rec709"] if raw else None,
            )
        )
    for entry in truth["frames"]:
        for camera in cameras:
            pose = Pose.model_validate(entry["cam_from_world"][camera.name])
            x, y = np.meshgrid(
                np.linspace(3, camera.lens.width - 3, 8), np.linspace(3, camera.lens.height - 3, 6)
            )
            rays = unproject(camera.lens, np.stack([x.ravel(), y.ravel()], -1))
            rays = np.concatenate([rays, np.ones((len(rays), 1))], -1) if rays.shape[-1] == 2 else rays
            motion = pose.matrix()
            centre = -motion[:3, :3].T @ motion[:3, 3]
            rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
            directions = rays @ motion[:3, :3]
            distance = rig.scene.depth(np.broadcast_to(centre, directions.shape), directions)
            hit = np.isfinite(distance)
            points.append((centre + distance[:, None] * directions)[hit])
            views.append(
                ViewCalibration(
                    camera=camera.name, frame=entry["frame"], cam_from_world=pose, points=int(hit.sum())
                )
            )
    cloud = np.concatenate(points)
    record = CalibrationRecord(
        created=datetime(2026, 1, 1, tzinfo=UTC),
        versions={"hdr-rig": "test"},
        shots_sha256=store.sha256(session / "shots.jsonl"),
        cameras=tuple(cameras),
        views=tuple(views),
        points=len(cloud),
        reprojection_px=0.21,
        exposure_scale={
            one["file"]: Exposure.model_validate(one["applied"]).scale for one in truth["exposures"]
        },
        rungs=(
            Rung.judged("vignetting", 0.031, 0.004, "stops", "held-out brackets agree better with it"),
            Rung.judged("tangential_distortion", 0.001, 0.003, "px", "held-out points do not gain from it"),
            Rung(name="response", taken=False, reason="overlapping exposures are linear within 0.4 %"),
        ),
    )
    store.write_json(session / "calibration" / "calibration.json", record.model_dump(mode="json"))
    _write_colmap(session / "calibration" / "colmap", cloud, record)
    return record


def _response(truth: dict) -> Response:
    if truth["response"] is None:
        return Response(kind="linear", evidence="RAW is linear: brackets agree within 0.4 %.", residual=0.004)
    return Response(
        kind="curve",
        codes=tuple(truth["response"]["codes"]),
        log_exposure=tuple(tuple(row) for row in truth["response"]["log_exposure"]),
        valid=(0.03, 0.97),
        evidence="Measured on overlapping exposures of 6 brackets.",
        residual=0.01,
    )


MISS = np.array([0.15, -0.2])
"""px by which every other observation of the toy's COLMAP model is off, seen less projected; the rest are off
by as much the other way, but those in the right half of the image, which are all off by MISS."""


def _write_colmap(folder: Path, points: np.ndarray, record: CalibrationRecord) -> None:
    """A COLMAP model of the cameras, views and points; every view sees what falls into its image."""
    from imaging.files.colmap import pycolmap

    model = pycolmap.Reconstruction()
    tracks: list[list[tuple[int, int]]] = [[] for _ in points]
    names = [camera.name for camera in record.cameras]
    for number, camera in enumerate(record.cameras, 1):
        lens = camera.lens
        model.add_camera_with_trivial_rig(
            pycolmap.Camera(
                model="OPENCV",
                width=lens.width,
                height=lens.height,
                params=[lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, lens.p1, lens.p2],
                camera_id=number,
            )
        )
    for number, view in enumerate(record.views, 1):
        lens, pose = record.camera(view.camera).lens, view.cam_from_world.matrix()
        rays = points @ pose[:3, :3].T + pose[:3, 3]
        front = rays[:, 2] > 0.1
        places = np.full((len(points), 2), -1.0)
        camera = model.cameras[1 + names.index(view.camera)]
        places[front] = camera.img_from_cam(rays[front])
        inside = np.flatnonzero(((places > 0) & (places < (lens.width, lens.height))).all(1))
        image = pycolmap.Image(name=view.id.image_name, camera_id=camera.camera_id, image_id=number)
        in_left_half = (places[inside, 0] < lens.width / 2) & (np.arange(len(inside)) % 2 == 1)
        observed = places[inside] + np.where(in_left_half[:, None], -MISS, MISS)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(place) for place in observed])
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(pose[:3]))
        for place, index in enumerate(inside):
            tracks[index].append((number, place))
    for xyz, seen_by in zip(points, tracks, strict=True):
        elements = [pycolmap.TrackElement(number, place) for number, place in seen_by]
        if elements:
            model.add_point3D(xyz, pycolmap.Track(elements))
    folder.mkdir(parents=True, exist_ok=True)
    model.write(str(folder))


@pytest.fixture(scope="session")
def toy_template(made_once: MadeOnce) -> Path:
    """A captured and calibrated toy session; copy it before changing it."""
    from capture.simulated import capture_simulated

    def make(folder: Path) -> None:
        capture_simulated("toy", folder / "toy", seed=3)
        calibrated_from_truth(folder / "toy")

    return made_once("rig-toy", make) / "toy"


@contextmanager
def small_scenes() -> Iterator[None]:
    """A draft of a few Gaussians and iterations: these tests look at commands and pages, not at quality."""
    from recon.decide.presets import QUALITIES, Quality

    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(QUALITIES, "draft", Quality(iterations=20, gaussians=400, width=320))
        yield


@pytest.fixture(scope="module", autouse=True)
def _small_scenes() -> Iterator[None]:
    with small_scenes():  # a module at a time: tests of other folders in the same process want the real draft
        yield


@pytest.fixture(scope="session")
def scene_template(toy_template: Path, made_once: MadeOnce) -> Path:
    """The same with a scene, trained for a moment, evaluated and reported; copy it before changing it."""
    from recon.decide.request import TrainingRequest
    from rig.commands.reconstruct import run_reconstruct

    def make(folder: Path) -> None:
        shutil.copytree(toy_template, folder, dirs_exist_ok=True)
        with small_scenes():
            run_reconstruct(folder, Silence(), TrainingRequest(quality="draft"))

    return made_once("rig-scene", make)


class Silence:
    """A meter that shows nothing."""

    def begin(self, stage: str) -> None:
        """Ignore the stage."""

    def __call__(self, message: str, done: int, total: int) -> None:
        """Ignore the progress."""

    def say(self, line: str) -> None:
        """Ignore the line."""


@pytest.fixture
def toy(toy_template: Path, tmp_path: Path) -> Path:
    """A captured and calibrated toy session of one's own."""
    return Path(shutil.copytree(toy_template, tmp_path / "toy"))


@pytest.fixture
def scene(scene_template: Path, tmp_path: Path) -> Path:
    """A reconstructed toy session of one's own."""
    return Path(shutil.copytree(scene_template, tmp_path / "toy"))


Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def rig(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `rig ARGUMENTS` in this process: exit code, standard output, standard error without progress."""
    from rig.__main__ import main

    monkeypatch.setattr("rig.terminal.progress.GRACE", math.inf)

    def run(*arguments: str) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(arguments)
        streams = capsys.readouterr()
        return code, streams.out, streams.err

    return run
