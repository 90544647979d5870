"""Cameras of other programs: the same camera by every format, and a sentence for what is wrong in a file."""

import csv
import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from pxr import Gf, Usd, UsdGeom
from scipy.spatial.transform import Rotation

from imaging.errors import InputError
from recon.rendering.cameras.camera_files import read_camera_path
from recon.splat import SplatCamera
from tests.recon.rendering.scenes import scene, sheet

SCENE = scene(sheet((0, 0, 2), (0.5, 0, 0), (0, 0.5, 0), 1.0, 0.2))
"""Its views are 48x36 with a focal length of 40 px."""
TURNS = Rotation.from_euler("xyz", [(10, 20, 30), (12, 25, 28), (-80, 5, 170)], degrees=True)
PLACES = np.array([(1.0, 2.0, 3.0), (1.5, 2.5, 2.0), (-4.0, 0.5, 0.25)])
"""Places in Blender's axes: the camera looks along its -z axis, y up."""


def matrices() -> np.ndarray:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = TURNS.as_matrix(), PLACES
    return poses


def check(camera: SplatCamera, number: int, focal: float = 60.0, size: tuple[int, int] = (64, 48)) -> None:
    """The pose of that number, and the lens; a point ahead and up is seen above the middle of the picture."""
    assert (camera.width, camera.height) == size
    assert camera.fx == pytest.approx(focal)
    assert camera.fy == pytest.approx(focal)
    motion = camera.cam_from_world
    np.testing.assert_allclose(-motion[:3, :3].T @ motion[:3, 3], PLACES[number], atol=1e-6)
    ahead = TURNS[number].apply([0.0, 1.0, -10.0]) + PLACES[number]
    np.testing.assert_allclose((motion @ [*ahead, 1])[:3], [0, -1, 10], atol=1e-6)


def written(path: Path, rows: list[dict[str, object]]) -> Path:
    with path.open("w", newline="") as file:
        file.write("# from Nuke\n")
        table = csv.DictWriter(file, rows[0])
        table.writeheader()
        table.writerows(rows)
    return path


def quaternion_rows() -> list[dict[str, object]]:
    return [
        dict(zip(("x", "y", "z"), place, strict=True))
        | dict(zip(("qw", "qx", "qy", "qz"), turn.as_quat(scalar_first=True), strict=True))
        for place, turn in zip(PLACES, TURNS, strict=True)
    ]


def matrix_rows() -> list[dict[str, object]]:
    return [{f"m{i}{j}": pose[i, j] for i in range(4) for j in range(4)} for pose in matrices()]


LENSES = {
    "pixels": {"fx": 60, "width": 64, "height": 48},
    "millimetres": {"focal_mm": 33.75, "sensor_mm": 36, "width": 64, "height": 48},
    "angle": {"fov_deg": np.degrees(2 * np.arctan(32 / 60)), "width": 64, "height": 48},
}


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("rows", [quaternion_rows, matrix_rows])
def test_a_table(tmp_path: Path, lens: str, rows) -> None:
    lines = [{"frame": 1001 + 2 * i} | row | LENSES[lens] for i, row in enumerate(rows())]
    path_of_file = read_camera_path(written(tmp_path / "shot.csv", lines), SCENE)
    assert (path_of_file.name, path_of_file.numbers) == ("shot", (1001, 1003, 1005))
    for number, camera in enumerate(path_of_file.cameras):
        check(camera, number)


def test_what_a_table_leaves_out_is_as_the_first_view(tmp_path: Path) -> None:
    path_of_file = read_camera_path(written(tmp_path / "shot.csv", quaternion_rows()), SCENE)
    assert not path_of_file.numbers
    check(path_of_file.cameras[2], 2, 40.0, (48, 36))


def test_transforms_json(tmp_path: Path) -> None:
    frames = [
        {"file_path": f"{i}.png", "transform_matrix": pose.tolist()} for i, pose in enumerate(matrices())
    ]
    frames[1] |= {"fl_x": 60.0, "k1": 0.1}
    top = {"camera_angle_x": 2 * np.arctan(32 / 60), "w": 64, "h": 48, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(top))
    for path in (tmp_path / "transforms.json", tmp_path):
        path_of_file = read_camera_path(path, SCENE)
        assert path_of_file.name == "transforms"
        for number, camera in enumerate(path_of_file.cameras):
            check(camera, number)
            assert camera.k1 == (0.1 if number == 1 else 0.0)


def test_fields_of_view_in_degrees_and_terms_in_a_list(tmp_path: Path) -> None:
    frames = [{"transform_matrix": matrices()[0].tolist()}]
    top = {"x_fov": np.degrees(2 * np.arctan(32 / 60)), "w": 64, "h": 48, "frames": frames}
    top["distortion_params"] = [0.1, 0.02, 0, 0, 0.001, -0.002]
    (tmp_path / "a.json").write_text(json.dumps(top))
    (camera,) = read_camera_path(tmp_path / "a.json", SCENE).cameras
    check(camera, 0)
    assert (camera.k1, camera.k2, camera.p1, camera.p2) == (0.1, 0.02, 0.001, -0.002)


def test_a_colmap_model(tmp_path: Path) -> None:
    model = pycolmap.Reconstruction()
    lens = pycolmap.Camera(model="SIMPLE_RADIAL", width=64, height=48, params=[60, 32, 24, 0.1], camera_id=1)
    model.add_camera_with_trivial_rig(lens)
    for number in (2, 0, 1):
        pose = matrices()[number] @ np.diag([1.0, -1, -1, 1])
        image = pycolmap.Image(name=f"{number}.png", camera_id=1, image_id=number + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(np.linalg.inv(pose)[:3]))
    (tmp_path / "sparse").mkdir()
    model.write(str(tmp_path / "sparse"))
    path_of_file = read_camera_path(tmp_path / "sparse", SCENE)
    for number, camera in enumerate(path_of_file.cameras):
        check(camera, number)
        assert camera.k1 == pytest.approx(0.1)


def test_a_usd_camera_that_moves(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    stage.SetStartTimeCode(1001)
    stage.SetEndTimeCode(1003)
    camera = UsdGeom.Camera.Define(stage, "/World/Camera")
    camera.CreateFocalLengthAttr(45.0)
    camera.CreateHorizontalApertureAttr(36.0)
    camera.CreateVerticalApertureAttr(24.0)
    moved = UsdGeom.Xformable(camera).AddTransformOp()
    for number, pose in enumerate(matrices()):
        moved.Set(Gf.Matrix4d(*pose.T.ravel().tolist()), Usd.TimeCode(1001 + number))
    stage.Save()
    path_of_file = read_camera_path(tmp_path / "shot.usda", SCENE)
    assert path_of_file.numbers == (1001, 1002, 1003)
    for number, one in enumerate(path_of_file.cameras):
        check(one, number, 60.0, (48, 32))


@pytest.mark.parametrize(
    ("stated", "times", "numbers"),
    [
        (None, (10, 11, 12), (10, 11, 12)),
        (None, (10, 12), (10, 11, 12)),
        (None, (9.5, 12.5), (10, 11, 12)),
        (None, (10.5,), (11,)),
        (None, (), ()),
        ((11, 11), (10, 12), (11,)),
        ((12, 11), (10, 12), (10, 11, 12)),
    ],
)
@pytest.mark.parametrize("below", [False, True])
def test_a_usd_camera_moves_where_its_stage_states_no_range(
    below: bool,
    stated: tuple[float, float] | None,
    times: tuple[float, ...],
    numbers: tuple[int, ...],
    tmp_path: Path,
) -> None:
    """One that its parent moves and whose lens zooms; below: in a sublayer, whose range does not count."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    moved = UsdGeom.Xform.Define(stage, "/rails").AddTranslateOp()
    camera = UsdGeom.Camera.Define(stage, "/rails/camera")
    for time in times:
        moved.Set(Gf.Vec3d(time, 6, 7), time)
        camera.GetFocalLengthAttr().Set(40.0 + time, time)
    path = tmp_path / "shot.usda"
    if below:
        stage.SetStartTimeCode(1)
        stage.SetEndTimeCode(2)
        stage.Save()
        path = tmp_path / "root.usda"
        stage = Usd.Stage.CreateNew(str(path))
        stage.GetRootLayer().subLayerPaths.append("./shot.usda")
    if stated is not None:
        stage.SetStartTimeCode(stated[0])
        stage.SetEndTimeCode(stated[1])
    stage.Save()
    path_of_file = read_camera_path(path, SCENE)
    assert path_of_file.numbers == numbers
    along = [float(one.world_from_cam[0, 3]) for one in path_of_file.cameras]
    held = [float(np.clip(number, times[0], times[-1])) for number in numbers]
    assert along == pytest.approx(held or [0.0])
    focals = np.array([one.fx for one in path_of_file.cameras])
    assert focals / focals[0] == pytest.approx([(40 + time) / (40 + held[0]) for time in held] or [1.0])


def test_a_usd_camera_that_zooms_has_the_frames_of_its_lens(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    camera = UsdGeom.Camera.Define(stage, "/camera")
    for time in (3, 5):
        camera.GetFocalLengthAttr().Set(10.0 * time, time)
    stage.Save()
    path_of_file = read_camera_path(tmp_path / "shot.usda", SCENE)
    assert path_of_file.numbers == (3, 4, 5)
    assert path_of_file.cameras[2].fx == pytest.approx(path_of_file.cameras[0].fx * 5 / 3)


def refuse(path: Path, match: str) -> None:
    with pytest.raises(InputError, match=match) as caught:
        read_camera_path(path, SCENE)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"qw": 5}, "not of length 1"),
        ({"x": "nan"}, "not a finite number"),
        ({"y": "left"}, "'left' for y"),
        ({"frame": 1.5}, "not an integer"),
        ({"frame": -1}, "above the last"),
        ({"width": 0}, "a lens that cannot be"),
        ({"width": 1e9}, "has a picture of"),
        ({"fx": -1}, "a lens that cannot be"),
        ({"focal_mm": 35}, "without a sensor_mm"),
        ({"fov_deg": 180}, "within 0 to 170"),
        ({"roll": 3}, "column 'roll'"),
    ],
)
def test_a_line_that_cannot_be_is_named(tmp_path: Path, changed: dict[str, object], match: str) -> None:
    rows = [{"frame": number} | row for number, row in enumerate(quaternion_rows())]
    refuse(
        written(tmp_path / "a.csv", [rows[0] | dict.fromkeys(changed, 1) | changed, rows[1] | changed]), match
    )


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("a.csv", b"", "is empty"),
        ("a.csv", b"x,y,z\n1,2,3\n", "has no poses"),
        ("a.csv", b"x,y,z,qw,qx,qy,qz\n1,2\n", "has 2 cells"),
        ("a.csv", b"x,y,z,qw,qx,qy,qz\n", "has 0 cameras"),
        ("a.csv", b"\xff\xfe\x00", "cannot be read as text"),
        ("a.json", b'{"frames": 3}', "no list of frames"),
        ("a.json", b'{"frames": [{"transform_matrix": [[1, 2], [3]]}]}', "4x4 matrix of finite numbers"),
        ("a.json", b'{"camera_model": "EQUIRECTANGULAR", "frames": [{}]}', "which rig cannot draw"),
        ("a.json", b'{"latlong": true, "frames": [{}]}', "has a latlong, which rig does not support"),
        (
            "a.json",
            b'{"distortion_params": [0.1], "frames": [{}]}',
            "distortion_params that is not 6 numbers",
        ),
        ("a.json", b'{"camera_path": [{}]}', "a camera path of nerfstudio's viewer"),
        ("a.json", b'{"path": [{}], "time": 0}', "a camera path of Instant NGP's viewer"),
        ("a.json", b'{"rolling_shutter": [0, 0, 1], "frames": [{}]}', "has a rolling_shutter"),
        ("a.json", b'{"frames": [{"transform_matrix_end": [[1]]}]}', "has a transform_matrix_end"),
        ("a.json", b'{"w": "wide", "frames": [{}]}', "not a number"),
        ("a.json", b'{"w": NaN, "frames": [{}]}', "not a number"),
        ("a.json", b'{"h": Infinity, "frames": [{}]}', "too large"),
        ("a.json", b'{"fl_x": 1e400, "frames": [{}]}', "too large"),
        ("a.json", b'{"k1": 0.1, "k3": 0.1, "frames": [{}]}', "a lens with k3"),
        ("a.json", b'{"is_fisheye": true, "p1": 0.1, "frames": [{}]}', "a lens with p1"),
        (
            "a.json",
            b'{"is_fisheye": true, "camera_angle_x": 2, "frames": [{}]}',
            "field of view of a fisheye",
        ),
        ("a.json", b'{"is_fisheye": true, "x_fov": 90, "frames": [{}]}', "field of view of a fisheye"),
        (
            "a.json",
            b'{"camera_angle_x": 4, "frames": [{}]}',
            "a field of view of 229.183 degrees: correct it",
        ),
        ("a.abc", b"", "Alembic"),
        ("a.usda", b"#usda 1.0\n", "has no camera"),
        ("a.usdc", b"nonsense", "damaged or not USD"),
        ("a.txt", b"", "not a file of cameras"),
    ],
)
def test_a_file_that_holds_no_cameras_is_refused(
    tmp_path: Path, name: str, content: bytes, match: str
) -> None:
    (tmp_path / name).write_bytes(content)
    refuse(tmp_path / name, match)


def test_a_mirrored_camera_a_missing_file_and_an_empty_folder_are_refused(tmp_path: Path) -> None:
    pose = (matrices()[0] @ np.diag([-1.0, 1, 1, 1])).tolist()
    (tmp_path / "a.json").write_text(json.dumps({"frames": [{"transform_matrix": pose}]}))
    refuse(tmp_path / "a.json", "mirrors")
    refuse(tmp_path / "b.csv", "is not a path to render")
    (tmp_path / "empty").mkdir()
    refuse(tmp_path / "empty", "COLMAP model")


def test_a_fisheye_beyond_what_is_drawn_is_refused(tmp_path: Path) -> None:
    lens = {"w": 400, "h": 300, "fl_x": 100.0, "camera_model": "OPENCV_FISHEYE"}
    for focal, refused in ((100.0, True), (200.0, False)):
        frames = [{"transform_matrix": matrices()[0].tolist()}]
        (tmp_path / "a.json").write_text(json.dumps(lens | {"fl_x": focal, "frames": frames}))
        if refused:
            refuse(tmp_path / "a.json", "sees more than 88 degrees")
        else:
            assert read_camera_path(tmp_path / "a.json", SCENE).cameras[0].fisheye


def test_images_of_a_model_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 64 48 60 60 32 24\n")
    (tmp_path / "points3D.txt").write_text("")
    rows = [f"{n + 1} 1 0 0 0 {-n} 0 3 1 v{n}.png\n\n" for n in (10, 9, 100)]
    (tmp_path / "images.txt").write_text("".join(rows))
    centres = [-one.cam_from_world[0, 3] for one in read_camera_path(tmp_path, SCENE).cameras]
    assert centres == [9, 10, 100]
