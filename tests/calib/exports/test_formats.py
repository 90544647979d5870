"""Exports are read back by the programs' own readers and project points where COLMAP's model does."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.exports import formats
from capture.imports.layouts.ply_points import read_ply_points
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.files.opencv_lens import write_opencv_lens
from imaging.optics import lens as optics
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.session.calibration import (
    CalibrationRecord,
    CameraCalibration,
    Response,
    ViewCalibration,
    read_calibration,
)
from imaging.session.records import CameraRecord


@pytest.fixture(scope="module")
def record(arm: Path) -> CalibrationRecord:
    return read_calibration(arm)


@pytest.fixture(scope="module")
def points(arm: Path) -> Array:
    model = pycolmap.Reconstruction(str(arm / "calibration" / "colmap"))
    return np.array([model.points3D[key].xyz for key in sorted(model.points3D)])[:500]


def projected(arm: Path, name: str, points: Array) -> Array:
    """Points in the picture `name` by COLMAP's own reader; origin at its corner."""
    model = pycolmap.Reconstruction(str(arm / "calibration" / "colmap"))
    image = next(image for image in model.images.values() if image.name == name)
    motion = image.cam_from_world().matrix()
    return np.asarray(model.cameras[image.camera_id].img_from_cam(points @ motion[:, :3].T + motion[:, 3]))


def test_transforms_hold_rays_through_the_centres_of_pixels(arm: Path, points: Array) -> None:
    """nerfstudio's Cameras.generate_rays: (column + 0.5 - cx) / fl_x, and y and z turned round."""
    transforms = json.loads((arm / "calibration" / "transforms.json").read_text())
    assert transforms["camera_model"] == "OPENCV"
    assert len(transforms["frames"]) == 12
    for frame in transforms["frames"]:
        picture = cv2.imread(str(arm / "calibration" / frame["file_path"]))
        assert picture.shape[:2] == (frame["h"], frame["w"])
        world_from_cam = np.array(frame["transform_matrix"])
        assert np.linalg.det(world_from_cam[:3, :3]) == pytest.approx(1.0)
        local = (points - world_from_cam[:3, 3]) @ world_from_cam[:3, :3]
        x, y = local[:, 0] / -local[:, 2], -local[:, 1] / -local[:, 2]
        square = x * x + y * y
        stretch = 1 + frame["k1"] * square + frame["k2"] * square**2
        along = x * stretch + 2 * frame["p1"] * x * y + frame["p2"] * (square + 2 * x * x)
        down = y * stretch + frame["p1"] * (square + 2 * y * y) + 2 * frame["p2"] * x * y
        pixels = np.stack([frame["fl_x"] * along + frame["cx"], frame["fl_y"] * down + frame["cy"]], 1)
        name = frame["file_path"].removeprefix("previews/")
        np.testing.assert_allclose(pixels, projected(arm, name, points), atol=1e-6)


def test_the_pictures_that_exports_name_are_photographs_in_colour(arm: Path) -> None:
    """Display-referred and all of one exposure: a point looks alike in all of them, and as it truly is."""
    transforms = json.loads((arm / "calibration" / "transforms.json").read_text())
    model = pycolmap.Reconstruction(str(arm / "calibration" / "colmap"))
    shown = {
        frame["file_path"].removeprefix("previews/"): cv2.imread(
            str(arm / "calibration" / frame["file_path"])
        )[..., ::-1]
        for frame in transforms["frames"]
    }
    for picture in shown.values():
        assert 40 < np.median(picture) < 200
        assert np.abs(np.diff(picture.astype(int), axis=-1)).mean() > 5  # grey has none
    spread = []
    for point in model.points3D.values():
        codes = []
        for element in point.track.elements:
            image = model.images[element.image_id]
            x, y = np.ravel(image.points2D[element.point2D_idx].xy).astype(int)
            codes.append(shown[image.name][y, x].astype(float))
        np.testing.assert_allclose(np.mean(codes, axis=0), point.color, atol=0.51)
        spread.append(np.std(codes, axis=0).mean())
    assert np.median(spread) < 15
    colours = np.array([point.color for point in model.points3D.values()], int)
    assert 40 < np.median(colours) < 200
    assert np.abs(np.diff(colours, axis=-1)).mean() > 5


def test_the_points_beside_transforms_are_those_of_the_model(arm: Path, points: Array) -> None:
    transforms = json.loads((arm / "calibration" / "transforms.json").read_text())
    file = arm / "calibration" / transforms["ply_file_path"]
    np.testing.assert_allclose(read_ply_points(file)[: len(points)], points, rtol=1e-6, atol=1e-6)
    header, values = file.read_bytes().split(b"end_header\n")
    assert header.split()[:3] == [b"ply", b"format", b"binary_little_endian"]
    model = pycolmap.Reconstruction(str(arm / "calibration" / "colmap"))
    rows = np.frombuffer(values, np.dtype([("xyz", "<f4", 3), ("colour", "u1", 3)]))
    assert len(rows) == model.num_points3D()
    assert (rows["colour"] == [model.points3D[number].color for number in sorted(model.points3D)]).all()


def test_opencv_reads_its_file_and_projects_half_a_pixel_less(
    arm: Path, record: CalibrationRecord, points: Array
) -> None:
    view = record.views[0]
    storage = cv2.FileStorage(
        str(arm / "calibration" / "opencv" / f"{view.camera}.yaml"), cv2.FILE_STORAGE_READ
    )
    motion = view.cam_from_world.matrix()
    pixels, _ = cv2.projectPoints(
        points,
        cv2.Rodrigues(motion[:3, :3])[0],
        motion[:3, 3],
        storage.getNode("camera_matrix").mat(),
        storage.getNode("distortion_coefficients").mat(),
    )
    lens = record.camera(view.camera).lens
    assert lens is not None
    assert storage.getNode("image_width").real() == lens.width
    expected = projected(arm, view.id.image_name, points)
    np.testing.assert_allclose(pixels.reshape(-1, 2) + 0.5, expected, atol=1e-6)
    mounted = record.camera(view.camera).cam_from_rig
    assert mounted is not None
    np.testing.assert_allclose(storage.getNode("cam_from_rig").mat(), mounted.matrix(), atol=1e-12)


def test_a_folder_may_have_any_name(tmp_path: Path) -> None:
    """To OpenCV, what follows a question mark in a path is no part of it."""
    (tmp_path / "S").write_text("of another")
    folder = tmp_path / "S?1"
    folder.mkdir()
    write_opencv_lens(folder / "cam0.yaml", PINHOLE)
    assert (folder / "cam0.yaml").read_bytes().startswith(b"%YAML")
    assert (tmp_path / "S").read_text() == "of another"
    assert len(list(tmp_path.rglob("*"))) == 3


def test_the_chain_of_kalibr_leads_from_camera_to_camera(arm: Path, record: CalibrationRecord) -> None:
    chain = yaml.safe_load((arm / "calibration" / "camchain-arm.yaml").read_text())
    assert list(chain) == ["cam0", "cam1", "cam2", "cam3"]
    here = record.camera("cam0").cam_from_rig
    assert here is not None
    pose = here.matrix()
    for number, camera in enumerate(record.cameras):
        entry = chain[f"cam{number}"]
        if number:
            pose = np.array(entry["T_cn_cnm1"]) @ pose
        assert camera.cam_from_rig is not None
        assert camera.lens is not None
        np.testing.assert_allclose(pose, camera.cam_from_rig.matrix(), atol=1e-12)
        assert entry["intrinsics"] == [
            camera.lens.fx,
            camera.lens.fy,
            camera.lens.cx - 0.5,
            camera.lens.cy - 0.5,
        ]
        assert entry["distortion_coeffs"] == [camera.lens.k1, camera.lens.k2, camera.lens.p1, camera.lens.p2]
        assert entry["resolution"] == [camera.lens.width, camera.lens.height]


def test_numbers_of_any_size_stay_numbers(arm: Path, record: CalibrationRecord, tmp_path: Path) -> None:
    """PyYAML takes 1e-05 for a string, as YAML 1.1 says."""
    tiny = record.cameras[0].lens
    assert tiny is not None
    lens = tiny.model_copy(update={"k1": 1e-05, "k2": -2e-17, "p1": 3e22, "p2": -0.0})
    cameras = tuple(camera.model_copy(update={"lens": lens}) for camera in record.cameras)
    from imaging.session.session import Session

    records = [c.model_copy(update={"rig": "../arm one"}) for c in Session.open(arm).record.cameras]
    changed = record.model_copy(update={"cameras": cameras, "views": ()})
    formats.write_exports(tmp_path, changed, records, {})
    (file,) = tmp_path.glob("camchain-*.yaml")
    assert re.fullmatch(r"camchain-[A-Za-z0-9_.-]+\.yaml", file.name)
    chain = yaml.safe_load(file.read_text())
    assert chain["cam0"]["distortion_coeffs"] == [1e-05, -2e-17, 3e22, 0.0]
    assert not (tmp_path / "transforms.json").exists()


FISHEYE = Lens(
    model="OPENCV_FISHEYE", width=640, height=480, fx=300, fy=302, cx=322, cy=237,
    k1=0.05, k2=-0.02, k3=0.004, k4=-0.001,
)  # fmt: skip
PINHOLE = Lens(model="PINHOLE", width=640, height=480, fx=500, fy=500, cx=320, cy=240)


def test_fisheyes_are_told_as_each_program_tells_them(tmp_path: Path) -> None:
    """cv2.fisheye, Kalibr equidistant, nerfstudio OPENCV_FISHEYE; also beside a lens of another kind."""
    still = Pose(quaternion=(1, 0, 0, 0), translation=(0, 0, 0))
    cameras = tuple(
        CameraCalibration(
            name=name,
            serial=name,
            lens=lens,
            cam_from_rig=still,
            response=Response(kind="linear", evidence=""),
        )
        for name, lens in (("wide", FISHEYE), ("long", PINHOLE))
    )
    record = CalibrationRecord(
        created="2026-01-01T00:00:00Z", versions={}, shots_sha256="", cameras=cameras, exposure_scale={},
        views=tuple(ViewCalibration(camera=c.name, frame=0, cam_from_world=still, points=9) for c in cameras),
    )  # fmt: skip
    rig = [CameraRecord(name=c.name, serial=c.serial, kind="raw", rig="r") for c in cameras]
    formats.write_exports(tmp_path, record, rig, {"wide": FISHEYE, "long": PINHOLE})

    points = np.random.default_rng(0).normal(size=(30, 3)) * (2, 2, 0.1) + (0, 0, 1)
    storage = cv2.FileStorage(str(tmp_path / "opencv" / "wide.yaml"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("distortion_model").string() == "fisheye"
    pixels, _ = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), storage.getNode("camera_matrix").mat(),
        storage.getNode("distortion_coefficients").mat(),
    )  # fmt: skip
    np.testing.assert_allclose(pixels[:, 0] + 0.5, optics.project(FISHEYE, points), atol=1e-8)

    chain = yaml.safe_load((tmp_path / "camchain-r.yaml").read_text())
    models = {entry["distortion_model"]: entry["distortion_coeffs"] for entry in chain.values()}
    assert models == {"equidistant": list(FISHEYE.terms[4:]), "radtan": [0.0] * 4}

    transforms = json.loads((tmp_path / "transforms.json").read_text())
    wide, long = transforms["frames"]
    assert (wide["camera_model"], long["camera_model"]) == ("OPENCV_FISHEYE", "OPENCV")
    assert [wide[name] for name in ("k1", "k2", "k3", "k4")] == list(FISHEYE.terms[4:])
    assert "p1" not in wide
    alone = record.model_copy(update={"cameras": cameras[:1], "views": record.views[:1]})
    (tmp_path / "alone").mkdir()
    formats.write_exports(tmp_path / "alone", alone, rig, {"wide": FISHEYE})
    transforms = json.loads((tmp_path / "alone" / "transforms.json").read_text())
    assert transforms["camera_model"] == "OPENCV_FISHEYE"
    assert "camera_model" not in transforms["frames"][0]
    assert (wide["is_fisheye"], long["is_fisheye"]) == (True, False)  # Instant NGP reads each frame's
    assert transforms["is_fisheye"] is True
