"""Data sets as other programs and systems write them: names, places of models, splits, lenses, far poses."""

import json
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.imports.layouts import detect, read_layout
from capture.imports.layouts.given import OPENCV_FROM_OPENGL, pose_seen
from capture.imports.layouts.llff import pose_of_row
from capture.imports.layouts.named_files import file_named
from capture.imports.layouts.nearest_lens import FARTHEST_OFF
from capture.imports.layouts.ply_points import read_ply_points
from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.colmap import pycolmap
from imaging.optics.lens import project
from imaging.session.session import Session

FILES = [f"images/frame.{n:04d}.png" for n in range(4)]
UTM = np.array([448000.0, 5411000.0, 260.0])


@pytest.fixture
def scene(tmp_path, picture, put):
    """A folder with pictures and a transforms.json."""

    def make(names=FILES, **top):
        for n, file in enumerate(FILES):
            put(tmp_path / "in" / file, picture(n))
        frames = []
        for n, name in enumerate(names):
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_rotvec(np.array([0.3, 1.0, 0.2]) * (0.4 * n + 0.1)).as_matrix()
            pose[:3, :3] = pose[:3, :3].astype(np.float32)
            pose[:3, 3] = UTM + np.array([2.5 * n, -n, 0.0])
            frames.append({"file_path": name, "transform_matrix": pose.tolist()})
        whole = {"fl_x": 60, "fl_y": 60, "cx": 32, "cy": 24, "w": 64, "h": 48} | top | {"frames": frames}
        (tmp_path / "in" / "transforms.json").write_text(json.dumps(whole))
        return tmp_path / "in"

    return make


def write_model(folder, sparse, names, images=FILES, points=True):
    """A COLMAP model in text; its first image has a feature with the number of a point."""
    place = folder / sparse
    place.mkdir(parents=True)
    (place / "cameras.txt").write_text("1 PINHOLE 64 48 60 60 32 24\n")
    features = ["3 4 7" if n == 0 and not points else "" for n in range(len(names))]
    rows = [f"{n} 1 0 0 0 {-0.1 * n} 0 3 1 {name}\n{features[n - 1]}\n" for n, name in enumerate(names, 1)]
    (place / "images.txt").write_text("".join(rows))
    if points:
        (place / "points3D.txt").write_text("")
    return place


@pytest.mark.parametrize("change", [lambda f: f.replace("/", "\\"), lambda f: f[:-4], lambda f: f"./{f}"])
def test_names_with_backslashes_with_dots_and_without_suffix_mean_their_files(scene, change):
    given = read_layout(scene([change(file) for file in FILES]), "nerfstudio")
    assert [photo.path.name for photo in given.photos] == [file.rpartition("/")[2] for file in FILES]
    assert not given.missing


@pytest.mark.parametrize("change", [str.upper, lambda f: f.replace("frame", "FRAME")])
def test_names_that_differ_in_letters_alone_mean_their_files(scene, change):
    given = read_layout(scene([change(file) for file in FILES]), "nerfstudio")
    assert [photo.path.name for photo in given.photos] == [file.rpartition("/")[2] for file in FILES]


@pytest.mark.parametrize("suffix", [".png", ".JPG", ".exr", ".webp", ".HEIC"])
def test_a_name_without_suffix_means_a_picture_of_any_kind(tmp_path, suffix):
    (tmp_path / f"frame.0001{suffix}").touch()
    assert file_named(tmp_path, "frame.0001").name == f"frame.0001{suffix}"


def test_an_accent_may_be_a_character_of_its_own_and_two_likely_files_are_none(tmp_path):
    (tmp_path / "caf\u00e9").mkdir()
    (tmp_path / "caf\u00e9" / "1.png").touch()
    assert file_named(tmp_path, "cafe\u0301/1.PNG") == tmp_path / "caf\u00e9" / "1.png"
    (tmp_path / "caf\u00e9" / "1.Png").touch()
    assert not file_named(tmp_path, "cafe\u0301/1.PNG").exists()
    assert not file_named(tmp_path, "no/1.png").exists()


def test_backslashes_in_a_colmap_model_and_beside_it_mean_folders(tmp_path, picture, put):
    names = [f"left\\{n}.png" for n in range(3)]
    for n in range(3):
        put(tmp_path / "in" / "images" / "left" / f"{n}.png", picture(n))
    write_model(tmp_path / "in", "sparse/0", names)
    assert import_photos(tmp_path / "in", tmp_path / "s").views == 3
    model = (tmp_path / "s" / "calibration" / "colmap" / "images.bin").read_bytes()
    assert model.count(b".png") == 3


def test_a_pose_far_from_the_origin_keeps_its_centre_in_every_reader(scene):
    folder = scene()
    for n, photo in enumerate(read_layout(folder, "nerfstudio").photos):
        motion = photo.cam_from_world.matrix()
        centre = -motion[:3, :3].T @ motion[:3, 3]
        np.testing.assert_allclose(centre, UTM + np.array([2.5 * n, -n, 0.0]), atol=1e-6)
    turn = Rotation.from_rotvec([0.3, 1.0, 0.2]).as_matrix().round(5)
    row = np.column_stack([-turn[:, 1], turn[:, 0], turn[:, 2], UTM])
    for pose in (
        pose_of_row(row, "row"),
        pose_seen(np.vstack([np.column_stack([turn, UTM]), [0, 0, 0, 1]]) @ OPENCV_FROM_OPENGL, "frame"),
    ):
        motion = pose.matrix()
        np.testing.assert_allclose(-motion[:3, :3].T @ motion[:3, 3], UTM, atol=1e-6)
        np.testing.assert_allclose(motion[:3, :3].T @ OPENCV_FROM_OPENGL[:3, :3], turn, atol=1e-4)


def uses(given):
    return [photo.use for photo in given.photos]


def test_the_split_of_lists_of_names_is_kept(scene):
    folder = scene(train_filenames=FILES[:2], val_filenames=FILES[2:3], test_filenames=FILES[3:])
    assert uses(read_layout(folder, "nerfstudio")) == ["train", "train", None, "test"]
    result = import_photos(folder, folder.parent / "s")
    assert len(json.loads((folder.parent / "s" / "split.json").read_text())["test"]) == 1
    assert any("2 views are for training and 1 for testing" in guess for guess in result.guesses)
    folder = scene(train_filenames=FILES[:3], val_filenames=FILES[3:])
    assert uses(read_layout(folder, "nerfstudio")) == ["train", "train", "train", "test"]
    given = read_layout(scene(train_filenames=FILES), "nerfstudio")
    assert uses(given) == [None] * 4
    assert any("train_filenames is left out" in note for note in given.notes)


@pytest.mark.parametrize("change", [lambda f: f.rpartition("/")[2], lambda f: f.replace("/", "\\")])
def test_lists_of_a_transforms_json_may_name_files_alone(scene, change):
    names = [change(file) for file in FILES]
    folder = scene(train_filenames=names[:3], test_filenames=names[3:])
    assert uses(read_layout(folder, "nerfstudio")) == ["train"] * 3 + ["test"]


def test_lists_of_names_that_are_not_there_are_told(scene):
    given = read_layout(scene(train_filenames=FILES, test_filenames=["DSC_1.JPG"]), "nerfstudio")
    assert uses(given) == [None] * 4
    assert any("test_filenames is left out" in note for note in given.notes)
    folder = scene()
    (folder / "test.txt").write_text("DSC_1.JPG\nDSC_2.JPG\n")
    (note,) = read_layout(folder, "nerfstudio").notes
    assert note.endswith("test.txt is ignored: only 0 of the photos that it names exist.")


def test_frames_for_testing_beside_the_others_are_read(scene):
    folder = scene()
    whole = json.loads((folder / "transforms.json").read_text())
    whole["test_frames"] = [whole["frames"].pop()]
    (folder / "transforms.json").write_text(json.dumps(whole))
    assert uses(read_layout(folder, "nerfstudio")) == ["train"] * 3 + ["test"]


@pytest.mark.parametrize("where", ["", "sparse/0"])
@pytest.mark.parametrize(
    "line", ["frame.0003.png", "frame.0003", "images/frame.0003.png", "images\\frame.0003.png"]
)
def test_a_list_of_names_to_test_on_is_kept(scene, where, line):
    folder = scene()
    (folder / "transforms.json").unlink()
    write_model(folder, "sparse/0", [file.rpartition("/")[2] for file in FILES])
    (folder / where / "test.txt").write_text(f"{line}\n")
    assert uses(read_layout(folder, "colmap")) == ["train"] * 3 + ["test"]
    (folder / where / "test.txt").write_text("notes of mine\nand more\nframe.0003.png\n")
    assert uses(read_layout(folder, "colmap")) == [None] * 4


def test_further_radial_terms_keep_the_poses_and_move_nothing_by_a_pixel(scene):
    k1, k2, k3, k4 = 0.05, -0.01, 0.002, -0.001
    folder = scene(k1=k1, k2=k2, k3=k3, k4=k4, p1=0.001, p2=-0.002)
    given = read_layout(folder, "nerfstudio")
    assert all(photo.cam_from_world is not None for photo in given.photos)
    u, v = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.48, 0.48, 9), np.linspace(-0.36, 0.36, 9)))
    r2 = u * u + v * v
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
    x = u * radial + 2 * 0.001 * u * v - 0.002 * (r2 + 2 * u * u)
    y = v * radial + 0.001 * (r2 + 2 * v * v) - 2 * 0.002 * u * v
    expected = np.stack([60 * x + 32, 60 * y + 24], axis=1)
    there = project(given.photos[0].lens, np.stack([u, v, np.ones_like(u)], axis=1))
    assert np.abs(there - expected).max() < 0.1 * FARTHEST_OFF
    assert any("k3 and k4 are folded" in note for note in given.notes)


@pytest.mark.parametrize(
    ("sparse", "images"),
    [
        ("colmap/sparse/0", "images"),
        ("colmap/text", "images"),
        ("dense/sparse", "dense/images"),
        ("dense/0/sparse", "dense/0/images"),
        ("distorted/sparse/0", "input"),
        ("sparse", "images"),
        (".", "images"),
    ],
)
def test_a_model_is_found_where_programs_put_it_and_its_photographs_with_it(
    tmp_path, picture, put, sparse, images
):
    for n in range(3):
        put(tmp_path / "in" / images / f"{n}.png", picture(n))
    folder = tmp_path / "in"
    place = write_model(folder, sparse if sparse != "." else "x", [f"{n}.png" for n in range(3)])
    if sparse == ".":
        for path in place.iterdir():
            shutil.move(path, folder / path.name)
        place.rmdir()
    assert detect(folder) == "colmap"
    assert import_photos(folder, tmp_path / "s").views == 3


def test_a_transforms_json_counts_more_than_the_model_in_colmap_that_it_was_made_of(scene):
    folder = scene()
    write_model(folder, "colmap/sparse/0", [file.rpartition("/")[2] for file in FILES])
    assert detect(folder) == "nerfstudio"


def test_a_model_without_points_keeps_its_poses_and_takes_points_of_a_ply(tmp_path, picture, put):
    for n in range(3):
        put(tmp_path / "in" / "images" / f"{n}.png", picture(n))
    place = write_model(tmp_path / "in", "sparse/0", [f"{n}.png" for n in range(3)], points=False)
    assert import_photos(tmp_path / "in", tmp_path / "s").views == 3
    (place / "points3D.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n1 2 3\n4 5 6\n"
    )
    result = import_photos(tmp_path / "in", tmp_path / "t")
    assert result.views == 3
    assert json.loads((tmp_path / "t" / "calibration" / "calibration.json").read_text())["points"] == 2


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian", "ascii"])
@pytest.mark.parametrize("kind", [("float", "f4"), ("double", "f8"), ("float64", "f8"), ("int", "i4")])
@pytest.mark.parametrize("names", [("x", "y", "z"), ("X", "Y", "Z"), ("px", "py", "pz")])
@pytest.mark.parametrize("first", [False, True])
def test_points_of_a_ply_in_every_dialect(tmp_path, form, kind, names, first):
    order = ">" if form == "binary_big_endian" else "<"
    points = np.random.default_rng(0).integers(-50, 50, (5, 3))
    table = np.zeros(5, [("red", "u1"), *((name, order + kind[1]) for name in names)])
    for axis, name in enumerate(names):
        table[name] = points[:, axis]
    other = np.array([7, 8], f"{order}i4")
    header = [
        "ply",
        f"format {form} 1.0",
        "comment end_header of another",
        *(["element a 2", "property int b"] * first),
    ]
    header += ["element vertex 5", "property uchar red", *(f"property {kind[0]} {name}" for name in names)]
    body = (other.tobytes() if first else b"") + table.tobytes()
    if form == "ascii":
        body = "\n".join(
            [*(["7", "8"] * first), *(" ".join(map(str, row)) for row in table.tolist())]
        ).encode()
    (tmp_path / "a.ply").write_bytes("\r\n".join([*header, "end_header\r\n"]).encode() + body)
    np.testing.assert_array_equal(read_ply_points(tmp_path / "a.ply"), points)


def test_listed_photographs_that_are_not_there_are_one_sentence(scene):
    folder = scene()
    for file in FILES[:2]:
        (folder / file).unlink()
    result = import_photos(folder, folder.parent / "s")
    result.require_complete()
    assert len(Session.open(folder.parent / "s").shots()) == 2
    (guess_of_missing,) = (guess for guess in result.guesses if "not there" in guess)
    assert guess_of_missing.startswith("2 photos that are listed are not there and left out")


def test_photographs_of_a_panorama_come_without_poses(tmp_path, picture, put):
    """pycolmap ends the process where it is asked for the focal length of one."""
    put(tmp_path / "in" / "images" / "0.png", picture())
    place = write_model(tmp_path / "in", "sparse/0", ["0.png"])
    (place / "cameras.txt").write_text("1 EQUIRECTANGULAR 64 48 64 48\n")
    given = read_layout(tmp_path / "in", "colmap")
    assert [photo.cam_from_world for photo in given.photos] == [None]
    assert "EQUIRECTANGULAR come without lens" in given.notes[0]


def test_names_with_spaces_are_read_of_a_model_in_text(tmp_path, picture, put):
    names = ["a b.png", "a c.png"]
    for n, name in enumerate(names):
        put(tmp_path / "in" / "images" / name, picture(n))
    write_model(tmp_path / "in", "sparse/0", names)
    given = read_layout(tmp_path / "in", "colmap")
    assert [photo.path.name for photo in given.photos if photo.cam_from_world] == names


@pytest.mark.parametrize("binary", [False, True])
def test_a_rotation_of_zeros_is_refused(tmp_path, picture, put, binary):
    put(tmp_path / "in" / "images" / "0.png", picture())
    place = write_model(tmp_path / "in", "sparse/0", ["0.png"])
    if binary:
        pycolmap.Reconstruction(place).write_binary(place)
        for name in ("images.bin", "frames.bin"):
            data = (place / name).read_bytes()
            (place / name).write_bytes(data.replace(np.float64(1).tobytes() + bytes(24), bytes(32)))
    else:
        (place / "images.txt").write_text("1 0 0 0 0 0 0 3 1 0.png\n\n")
    with pytest.raises(InputError, match=r"images\.bin is damaged" if binary else "rotation of zeros"):
        read_layout(tmp_path / "in", "colmap")
