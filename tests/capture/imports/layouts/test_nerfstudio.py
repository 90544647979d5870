import json
import math
import re
import shutil

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from capture.imports.layouts.ply_points import read_ply_points
from capture.imports.layouts.posed_frame import PosedFrame
from imaging.colour.spaces import camera_from_rec709
from imaging.errors import InputError
from imaging.files.colmap import pycolmap, read_points
from imaging.files.tiff.dng import encode_dng
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic, as_matrix
from imaging.sensor.noise import SensorNoise
from imaging.session.calibration import read_calibration
from recon.data.light import radiance_image
from recon.data.load import load
from recon.start.initialisation import start_points

from .nerfstudio_scenes import CENTRES, LENS, TERMS, frames, imported, looking_at, scene


def test_a_point_is_seen_where_opengl_axes_and_centres_at_a_half_put_it(tmp_path, seen_at):
    result, session, at = imported(scene(tmp_path / "n", LENS | TERMS | {"frames": frames()}))
    assert (result.layout, result.views, result.cameras, result.frames) == ("nerfstudio", 4, 1, 4)
    record = read_calibration(session.folder)
    xyz = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3))
    for n, centre in enumerate(CENTRES):
        local = (xyz - centre) @ looking_at(centre)[:3, :3]
        camera = pycolmap.Camera.create_from_model_name(1, "OPENCV", 70.0, 64, 48)
        camera.params = [70.0, 72.0, 33.0, 22.5, *TERMS.values()]
        expected = np.array([camera.img_from_cam([x, -y, -z]) for x, y, z in local])
        assert (local[:, 2] < 0).all()
        np.testing.assert_allclose(seen_at(record, *at[f"{n}.png"], xyz), expected, atol=1e-6)
    # What the camera looks at is in the middle; what is above it is above it.
    middle, above = seen_at(record, *at["0.png"], np.array([[0, 0, 0], [0, 0, 0.2]], float))
    np.testing.assert_allclose(middle, [33.0, 22.5], atol=1e-6)
    assert above[1] < middle[1]


def test_the_lens_may_stand_in_the_frames_and_each_other_lens_is_a_camera(tmp_path):
    some = frames(**LENS)
    some[2] |= {"fl_x": 90.0}
    result, session, at = imported(scene(tmp_path / "n", {"frames": some}))
    record = read_calibration(session.folder)
    focal = {name: record.camera(camera).lens.fx for name, (camera, _) in at.items()}
    assert focal == {"0.png": 70.0, "1.png": 70.0, "2.png": 90.0, "3.png": 70.0}
    assert result.cameras == 2
    # Nothing says that two cameras were there at one moment.
    assert sorted(frame for _, frame in at.values()) == [0, 1, 2, 3]


def test_lenses_that_are_put_together_are_a_rig_whose_mounting_is_unknown(tmp_path):
    some = frames()
    for frame in some[2:]:
        frame["fl_x"] = 90.0
    result, session, at = imported(scene(tmp_path / "n", LENS | {"frames": some}), together="order")
    assert [at[f"{n}.png"][1] for n in range(4)] == [0, 1, 0, 1]
    assert len({camera.rig for camera in session.record.cameras} - {None}) == 1
    assert [camera.cam_from_rig for camera in read_calibration(session.folder).cameras] == [None, None]
    assert result.views == 4


def test_a_blender_scene_has_a_field_of_view_and_names_without_a_suffix(tmp_path):
    folder = scene(tmp_path / "n", "{}")
    (folder / "transforms.json").unlink()
    for split, part in (("train", frames()[:3]), ("test", frames()[3:])):
        value = {"camera_angle_x": 0.8, "frames": [f | {"file_path": f["file_path"][:-4]} for f in part]}
        (folder / f"transforms_{split}.json").write_text(json.dumps(value))
    result, session, _ = imported(folder)
    lens = read_calibration(session.folder).cameras[0].lens
    assert lens.fx == lens.fy == pytest.approx(32 / math.tan(0.4))
    assert (lens.model, lens.cx, lens.cy, result.views) == ("PINHOLE", 32, 24, 4)
    assert any("3 views are for training and 1 for testing" in guess for guess in result.guesses)
    split = session.split()
    assert split is not None
    assert (len(split.train), len(split.test)) == (3, 1)


@pytest.mark.parametrize(("names", "uses"), [("train val test", (2, 1, 1)), ("train val", (2, 2, 0))])
def test_what_a_blender_scene_validates_with_is_tested_on_where_it_has_no_other_test(tmp_path, names, uses):
    folder = scene(tmp_path / "n", "{}")
    (folder / "transforms.json").unlink()
    training, testing, neither = uses
    parts = {"train": frames()[:2], "val": frames()[2:], "test": []}
    if "test" in names:
        parts |= {"val": frames()[2:3], "test": frames()[3:]}
    for name in names.split():
        (folder / f"transforms_{name}.json").write_text(json.dumps(LENS | {"frames": parts[name]}))
    _, session, _ = imported(folder)
    split = session.split()
    assert split is not None
    assert (len(split.train), len(split.test)) == (training, testing)
    assert len(session.shots("scene")) - len(split.train) - len(split.test) == neither


def test_photos_that_no_frame_names_are_not_imported_and_absent_ones_are_told(tmp_path):
    result, _, at = imported(scene(tmp_path / "n", LENS | {"frames": frames()[1:]}))
    assert sorted(at) == ["1.png", "2.png", "3.png"]
    shutil.rmtree(tmp_path / "s")
    result, _, at = imported(scene(tmp_path / "m", LENS | {"frames": frames()}, photos=3))
    assert sorted(at) == ["0.png", "1.png", "2.png"]
    assert result.missing == ()
    assert any(
        re.search(r"3\.png is named in frame 3 of .*transforms\.json but does not exist", guess)
        for guess in result.guesses
    )
    shutil.rmtree(tmp_path / "s")
    with pytest.raises(InputError, match=r"0\.png is named .* and no other photograph is"):
        imported(scene(tmp_path / "k", LENS | {"frames": frames()}, photos=0))
    assert not (tmp_path / "s").exists()


def test_exposures_of_one_place_are_one_bracket(tmp_path):
    some = frames()
    some[1] |= {"transform_matrix": some[0]["transform_matrix"]}
    for n, frame in enumerate(some):
        frame["exposure_time"] = 1 / (10 * (n + 1))
    result, session, at = imported(scene(tmp_path / "n", LENS | {"frames": some}))
    assert [at[f"{n}.png"][1] for n in range(4)] == [0, 0, 1, 2]
    assert [s.reported.time for s in session.shots()] == [1 / 10, 1 / 20, 1 / 30, 1 / 40]
    assert result.views == 3


def test_a_fisheye_sees_what_colmaps_sees(tmp_path, seen_at):
    terms = {"k1": 0.05, "k2": -0.02, "k3": 0.004, "k4": -0.001}
    top = LENS | terms | {"camera_model": "OPENCV_FISHEYE", "frames": frames()}
    result, session, at = imported(scene(tmp_path / "n", top))
    assert (result.views, result.cameras) == (4, 1)
    record = read_calibration(session.folder)
    assert record.cameras[0].lens.terms == (70.0, 72.0, 33.0, 22.5, *terms.values())
    camera = pycolmap.Camera.create_from_model_name(1, "OPENCV_FISHEYE", 70.0, 64, 48)
    camera.params = [70.0, 72.0, 33.0, 22.5, *terms.values()]
    xyz = np.random.default_rng(2).uniform(-0.5, 0.5, (20, 3))
    local = (xyz - CENTRES[1]) @ looking_at(CENTRES[1])[:3, :3]
    expected = np.array([camera.img_from_cam([x, -y, -z]) for x, y, z in local])
    np.testing.assert_allclose(seen_at(record, *at["1.png"], xyz), expected, atol=1e-6)
    model = pycolmap.Reconstruction(str(session.folder / "calibration" / "colmap"))
    assert {camera.model_name for camera in model.cameras.values()} == {"OPENCV_FISHEYE"}


@pytest.mark.parametrize("terms", [{"k1": 0.02, "k2": -0.01}, {"k1": 0.02, "k2": -0.01, "k3": 0.003}])
def test_the_flag_of_instant_ngp_makes_a_fisheye(tmp_path, seen_at, terms):
    # as its colmap2nerf.py writes COLMAP's fisheyes: Brown terms of 0, and no camera_model
    flag = {"is_fisheye": True, "p1": 0, "p2": 0, "k3": 0, "k4": 0, "camera_angle_x": 0.8}
    _, session, at = imported(scene(tmp_path / "n", LENS | flag | terms | {"frames": frames()}))
    record = read_calibration(session.folder)
    assert record.cameras[0].lens.fisheye
    xyz = np.random.default_rng(2).uniform(-2.5, 2.5, (20, 3))
    local = (xyz - CENTRES[0]) @ looking_at(CENTRES[0])[:3, :3] * [1, -1, -1]
    xyz, local = xyz[local[:, 2] > 0.5], local[local[:, 2] > 0.5]
    matrix = np.array([[70.0, 0, 33.0], [0, 72.0, 22.5], [0, 0, 1]])
    k = np.array([terms.get(f"k{n}", 0.0) for n in range(1, 5)])
    expected, _ = cv2.fisheye.projectPoints(local[:, None], np.zeros(3), np.zeros(3), matrix, k)
    np.testing.assert_allclose(seen_at(record, *at["0.png"], xyz), expected.reshape(-1, 2), atol=1e-6)


def test_another_camera_model_comes_without_poses_and_says_so(tmp_path):
    result, session, _ = imported(
        scene(tmp_path / "n", LENS | {"camera_model": "EQUIRECTANGULAR", "frames": frames()})
    )
    assert (result.shots, result.views) == (4, 0)
    assert any("4 photos come without lens and pose" in guess for guess in result.guesses)
    assert not (session.folder / "calibration").exists()


@given(
    turns=st.lists(st.floats(-10, 10), min_size=3, max_size=3),
    centre=st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    digits=st.integers(5, 17),
)
@settings(max_examples=60)
def test_any_rigid_motion_comes_back_however_it_was_rounded(turns, centre, digits):
    motion = np.eye(4)
    motion[:3, :3] = Rotation.from_rotvec(turns).as_matrix()
    motion[:3, 3] = centre
    rounded = [[float(f"{value:.{digits}g}") for value in row] for row in motion]
    entry = PosedFrame({"transform_matrix": rounded}, {}, "here")
    returned = np.linalg.inv(entry.cam_from_world().matrix()) @ np.diag([1, -1, -1, 1])
    scale = max(1.0, *map(abs, centre))
    np.testing.assert_allclose(returned[:3, :3], motion[:3, :3], atol=10.0 ** (1 - digits) + 1e-12)
    np.testing.assert_allclose(returned[:3, 3], centre, atol=scale * (10.0 ** (1 - digits) + 1e-12) * 10)


def ply(xyz, form="ascii", colour="uint8") -> bytes:
    names = "".join(
        f"property {kind} {name}\n"
        for kind, name in [("float", "x"), ("double", "y"), ("float", "z"), (colour, "red")]
    )
    head = f"ply\nformat {form} 1.0\ncomment c\nelement vertex {len(xyz)}\n{names}end_header\n".encode()
    if form == "ascii":
        return head + "".join(f"{x!r} {y!r} {z!r} 7\n" for x, y, z in xyz.tolist()).encode()
    fields = [("x", "<f4"), ("y", "<f8"), ("z", "<f4"), ("red", "u1")]
    return head + np.array([(*row, 7) for row in xyz.tolist()], fields).tobytes()


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_scene_points_come_along_and_training_may_start_from_them(tmp_path, form):
    folder = scene(tmp_path / "n", LENS | {"ply_file_path": "sparse_pc.ply", "frames": frames()})
    xyz = np.random.default_rng(0).uniform(-1, 1, (50, 3)).astype(np.float32).astype(np.float64)
    (folder / "sparse_pc.ply").write_bytes(ply(xyz, form))
    _, session, _ = imported(folder)
    points = read_points(session.folder / "calibration" / "colmap")
    np.testing.assert_array_equal(sorted(points.xyz.tolist()), sorted(xyz.tolist()))
    assert not points.views.any()
    record = read_calibration(session.folder)
    assert (record.points, record.reprojection_px) == (50, None)
    dataset = load(session.folder)
    images = [radiance_image(view) for view in dataset.train]
    start = start_points(dataset, images, 50, np.random.Generator(np.random.PCG64(0)))
    assert start.sparse == 50


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_point_file_cut_off_anywhere_is_refused(tmp_path, form):
    data = ply(np.ones((3, 3)), form)
    path = tmp_path / "p.ply"
    for end in range(len(data) - 2):
        path.write_bytes(data[:end])
        with pytest.raises(InputError, match="is not a PLY file of points, or it is truncated"):
            read_ply_points(path)
    path.write_bytes(data.replace(b"vertex 3", b"vertex 3000000000"))
    with pytest.raises(InputError, match="truncated"):
        read_ply_points(path)
    with pytest.raises(InputError, match="leads out of"):
        imported(scene(tmp_path / "n", LENS | {"ply_file_path": "../p.ply", "frames": frames()}))


def test_raw_brings_the_colours_and_the_noise_that_its_files_state(tmp_path):
    """A scene is trained on it at once: light in camera RGB would look like light."""
    matrix = np.array([[0.6, 0.2, 0.1], [0.2, 0.7, 0.1], [0.0, 0.2, 0.6]])
    profile = SensorNoise(gain=0.5, read_noise=2.0).profile(64.0, 4095.0)
    pixels = np.random.default_rng(0).integers(64, 4000, (48, 64), dtype=np.uint16)
    raw = RawMosaic(
        pixels, Cfa.RGGB, ((64.0,),), 4095, camera_from_xyz=as_matrix(matrix), noise_profile=profile
    )
    value = {"frames": [one | {"file_path": f"images/{n}.dng"} for n, one in enumerate(frames())]}
    folder = scene(tmp_path / "n", LENS | value, photos=0)
    for n in range(4):
        (folder / "images" / f"{n}.dng").write_bytes(encode_dng(raw))
    _, session, _ = imported(folder)
    record = read_calibration(session.folder)
    (camera,) = record.cameras
    np.testing.assert_allclose(camera.camera_from_rec709, camera_from_rec709(matrix), atol=1e-3)
    assert camera.noise is not None
    assert camera.noise.gain == pytest.approx(0.5, rel=1e-3)
    assert [rung.name for rung in record.rungs if rung.taken] == ["poses", "camera_colour"]
