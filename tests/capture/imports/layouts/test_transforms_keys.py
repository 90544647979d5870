"""Keys of transforms.json that change what a pixel means: read as their programs do, or named."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.imports.layouts import nerfstudio
from capture.imports.layouts.given import Given
from imaging.errors import InputError

LENS = {"fl_x": 70.0, "fl_y": 72.0, "cx": 33.0, "cy": 22.5, "w": 64, "h": 48}
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def motion(turn=(0.0, 0.0, 0.0), centre=(0.0, 0.0, 0.0)) -> list:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    matrix[:3, 3] = centre
    return matrix.tolist()


@pytest.fixture
def read(tmp_path, picture, put):
    """A folder of two photographs, read with further keys in both frames and at the top."""

    def make(frame=None, suffix=".png", poses=True, lens=LENS, files=(), **top) -> Given:
        frames = []
        for n in range(2):
            put(tmp_path / f"{n}{suffix}", picture(n))
            pose = {"transform_matrix": motion((0.1, 0.2, 0.3), (n, 2, 3))} if poses else {}
            frames.append({"file_path": f"{n}{suffix}"} | pose | (frame or {}))
        for name in files:
            put(tmp_path / name, picture(9))
        (tmp_path / "transforms.json").write_text(json.dumps(lens | top | {"frames": frames}))
        return nerfstudio.read(tmp_path)

    return make


def world_from_cam(given: Given, number: int = 0) -> np.ndarray:
    return np.linalg.inv(given.photos[number].cam_from_world.matrix())


START, END = motion((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)), motion((0.0, 0.0, 0.4), (3.0, 2.0, 1.0))


@pytest.mark.parametrize(
    ("shutter", "time"),
    [
        ([0.0, 0.0, 1.0], 0.5),  # rows from the start to the end
        ([0.25, 0.0, 0.5, 0.0], 0.5),
        ([0.1, 0.2, 0.4, 0.2], 0.5),
        ([0.0, 0.0, -0.5], -0.25),
        (None, 0.0),
    ],
)
def test_a_camera_that_moved_while_it_was_read_has_the_pose_of_its_middle(read, shutter, time):
    given = read(
        {"transform_matrix_start": START, "transform_matrix_end": END}, poses=False, rolling_shutter=shutter
    )
    expected = np.array(motion((0, 0, 0.4 * time), (1 + 2 * time, 2, 3 - 2 * time))) @ FLIP
    np.testing.assert_allclose(world_from_cam(given), expected, atol=1e-12)
    notes = [note for note in given.notes if "rolling_shutter" in note]
    if shutter is None:
        assert notes == []
        return
    # From the first row to the middle one is half of the way that the rows take.
    share = sum(map(abs, shutter[1:])) / 2
    far, turn = np.sqrt(8) * share, np.degrees(0.4) * share
    (note,) = notes
    assert note.startswith("2 photos have a rolling shutter")
    assert f"up to {far:.3g} units of the poses and {turn:.2g} degrees" in note


def test_rows_read_one_after_another_with_one_pose_are_named(read):
    assert any(
        "(rolling_shutter) is not modelled" in note for note in read(rolling_shutter=[0, 0, 0.03]).notes
    )
    for still in ([0, 0, 0, 0], None):
        assert not any("rolling_shutter" in note for note in read(rolling_shutter=still).notes)
    velocity = read({"camera_linear_velocity": [0.1, 0, 0]}, rolling_shutter_time=0.02).notes
    assert any("(rolling_shutter_time, camera_linear_velocity) is not modelled" in note for note in velocity)


@pytest.mark.parametrize("shutter", [0.03, "fast", [1, 2], [0, 0, "a"], [0, 0, 1e9], [0, 0, None], {}])
def test_a_rolling_shutter_of_another_form_is_refused(read, shutter):
    with pytest.raises(InputError, match=r"frame 0 of .* has an? (invalid )?rolling_shutter.*: correct"):
        read(rolling_shutter=shutter)


@pytest.mark.parametrize("key", [{"from_mitsuba": True}, {"normal_mts_args": []}])
def test_the_camera_axes_of_mitsuba(read, key):
    expected = np.array(motion((0.1, 0.2, 0.3), (0, 2, 3))) @ np.diag([-1.0, -1.0, 1.0, 1.0])
    np.testing.assert_allclose(world_from_cam(read(**key)), expected, atol=1e-12)
    np.testing.assert_allclose(
        world_from_cam(read(**key | {"from_mitsuba": False})), expected @ np.diag([-1, 1, -1, 1]), atol=1e-12
    )


def test_fields_of_view_in_degrees_and_terms_in_a_list(read):
    size = {"w": 64, "h": 48}
    given = read(lens=size, x_fov=90.0, y_fov=60.0, distortion_params=[-0.1, 0.02, 0, 0, 0.001, -0.002])
    lens = given.photos[0].lens
    assert (lens.fx, lens.fy) == pytest.approx((32.0, 24 / np.tan(np.pi / 6)))
    assert lens.terms[4:] == (-0.1, 0.02, 0.001, -0.002)
    listed = [0.1, 0.01, 0.001, 1e-4, 0, 0]
    fisheye = read(camera_model="OPENCV_FISHEYE", distortion_params=listed, k1=9.0).photos[0].lens
    assert fisheye.terms[4:] == tuple(listed[:4])
    # What a frame says counts before what stands at the top.
    assert read({"x_fov": 90.0}).photos[0].lens.fx == pytest.approx(32.0)
    with pytest.raises(InputError, match="distortion_params that is not a list of 6 numbers"):
        read(distortion_params=[0.1])


def test_a_focal_length_stands_where_a_field_of_view_cannot_be(read):
    degrees = {"camera_angle_x": 50.0, "camera_angle_y": 40.0}  # which are taken for radians
    size = {"w": 64, "h": 48}
    for frame, lens in (({}, degrees | {"fl_x": 70.0}), (degrees, {"fl_x": 70.0})):
        given = read(frame, lens=size | lens).photos[0].lens
        assert (given.fx, given.fy) == (70.0, 70.0)
    with pytest.raises(InputError, match=r"a field of view of 2864\.79 degrees: correct it"):
        read(lens=size | degrees)


@pytest.mark.parametrize("key", ["ftheta_p0", "latlong", "equirectangular", "orthographic"])
def test_other_lenses_come_without_poses_and_are_named(read, key):
    given = read(**{key: 0.0 if key == "ftheta_p0" else True})
    assert [photo.lens for photo in given.photos] == [None, None]
    assert any("2 photos come without lens and pose" in note for note in given.notes)
    assert read(**{key: None if key == "ftheta_p0" else False}).photos[0].lens is not None


def test_depth_in_the_unit_that_is_stated_or_not_at_all(read):
    named = {"depth_file_path": "d.png"}
    assert read(named, files=["d.png"], depth_unit_scale_factor=0.01).photos[0].depth.unit == 0.01
    assert read(named, depth_unit_scale_factor=0.01, integer_depth_scale=0.5).photos[0].depth.unit == 0.5
    for key, value in {"enable_depth_loading": False, "applied_scale": 2.0}.items():
        given = read(named, **{key: value})
        assert given.photos[0].depth is None
        assert any(
            "2 photos have a depth map that is not read" in note and key in note for note in given.notes
        )
    assert read(named, enable_depth_loading=True, applied_scale=1.0).photos[0].depth is not None


def test_points_are_in_the_scale_that_was_applied_to_the_poses(read, put, tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(f"property float {n}\n" for n in "xyz")
    put(tmp_path / "p.ply", f"{head}end_header\n1 2 3\n".encode())
    assert read(ply_file_path="p.ply", applied_scale=0.5).points.tolist() == [[0.5, 1.0, 1.5]]
    with pytest.raises(InputError, match="applied_scale of 0"):
        read(ply_file_path="p.ply", applied_scale=0)


NAMED = {
    "fisheye_crop_radius": ({}, {"fisheye_crop_radius": 20.0, "camera_model": "OPENCV_FISHEYE"}, ()),
    "white_transparent": ({}, {"white_transparent": True}, ()),
    "black_transparent": ({}, {"black_transparent": True}, ()),
    "driver_parameters": ({"driver_parameters": {"LightX": 1.0}}, {}, ()),
    "n_frames": ({}, {"n_frames": 1}, ()),
    "dynamic_mask_0.png": ({}, {}, ["dynamic_mask_0.png"]),
    "0.png.alpha.png": ({}, {}, ["0.png.alpha.png"]),
    "rays_": ({}, {}, ["rays_0.dat"]),
}


@pytest.mark.parametrize("name", NAMED)
def test_what_is_not_kept_is_named(read, name):
    frame, top, files = NAMED[name]
    assert not any(name in note for note in read().notes)
    given = read(frame, files=files, **top)
    (note,) = (note for note in given.notes if name in note)
    assert note.endswith(".")
    if name == "rays_":
        assert [photo.lens is None for photo in given.photos] == [True, False]


def test_frames_of_several_moments_are_named(read, tmp_path):
    read()
    whole = json.loads((tmp_path / "transforms.json").read_text())
    for n, frame in enumerate(whole["frames"]):
        frame["time"] = n / 2
    (tmp_path / "transforms.json").write_text(json.dumps(whole))
    assert any("of 2 moments (time)" in note for note in nerfstudio.read(tmp_path).notes)
    assert not any("moments" in note for note in read({"time": 0.5}).notes)


def test_exr_that_is_not_multiplied_by_its_alpha_is_refused(read):
    with pytest.raises(InputError, match="states fix_premult, so that its EXR"):
        read(suffix=".exr", fix_premult=True)
    assert read(fix_premult=True).notes == ()


def test_keys_that_steer_a_training_only_change_nothing(read):
    plain = read()
    steered = read(
        aabb_scale=16, scale=0.5, offset=[0, 0, 1], sharpen=1.0, up=[0, 0, 1], orientation_override="none",
        aabb=[[0, 0, 0], [1, 1, 1]], importance_sampling=True, n_extra_learnable_dims=8, envmap="e.png",
        sharpness_discard_threshold=0.5, applied_transform=np.eye(4)[:3].tolist(),
    )  # fmt: skip
    assert steered == plain
