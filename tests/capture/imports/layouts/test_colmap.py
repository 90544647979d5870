import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.colmap import pycolmap, read_points
from imaging.files.photo import encode_png
from imaging.session.calibration import read_calibration
from imaging.session.session import Session
from tests.capture.imports.photo_files import dng

PARAMETERS = {
    "SIMPLE_PINHOLE": [70.0, 33.0, 22.5],
    "PINHOLE": [70.0, 72.0, 33.0, 22.5],
    "SIMPLE_RADIAL": [70.0, 33.0, 22.5, -0.1],
    "RADIAL": [70.0, 33.0, 22.5, -0.1, 0.03],
    "OPENCV": [70.0, 72.0, 33.0, 22.5, -0.1, 0.03, 0.004, -0.003],
    "FISHEYE": [50.0, 52.0, 33.0, 22.5],
    "SIMPLE_RADIAL_FISHEYE": [50.0, 33.0, 22.5, 0.05],
    "OPENCV_FISHEYE": [50.0, 52.0, 33.0, 22.5, 0.05, -0.02, 0.004, -0.001],
    "FULL_OPENCV": [70.0, 72.0, 33.0, 22.5, -0.1, 0.03, 0.004, -0.003, 0.02, 0.01, 0.0, 0.0],
}


@pytest.fixture
def project(tmp_path, picture, put):
    """A COLMAP project of synthetic points: `images/` and `sparse/0`; and its reconstruction."""

    def make(model="OPENCV", *, rigs=1, cameras=1, frames=4, text=False, terms=()):
        options = pycolmap.SyntheticDatasetOptions()
        options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = rigs, cameras, frames
        options.num_points3D = 40
        options.camera_width, options.camera_height = 64, 48
        options.camera_model_id = getattr(pycolmap.CameraModelId, model)
        options.camera_params = [*PARAMETERS[model][:4], *terms] if terms else PARAMETERS[model]
        pycolmap.set_random_seed(5)
        truth = pycolmap.synthesize_dataset(options)
        folder = tmp_path / "project"
        (folder / "sparse" / "0").mkdir(parents=True)
        (truth.write_text if text else truth.write)(str(folder / "sparse" / "0"))
        for key, image in truth.images.items():
            put(folder / "images" / image.name, picture(key))
        return folder, truth

    return make


def imported(folder: Path, **options):
    result = import_photos(folder, folder.parent / "s", **options)
    session = Session.open(folder.parent / "s")
    return result, session, {(s.camera, s.frame): Path(s.source).name for s in session.shots()}


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("model", [name for name in PARAMETERS if name != "FULL_OPENCV"])
def test_lenses_poses_and_points_see_what_colmap_sees(project, seen_at, model, text):
    folder, truth = project(model, text=text)
    result, session, names = imported(folder)
    record = read_calibration(session.folder)
    assert (result.layout, result.views, result.cameras) == ("colmap", 4, 1)
    xyz = np.array([truth.points3D[key].xyz for key in sorted(truth.points3D)])
    for (camera, frame), name in names.items():
        image = truth.find_image_with_name(name)
        expected = np.array([image.project_point(point) for point in xyz])
        np.testing.assert_allclose(seen_at(record, camera, frame, xyz), expected, atol=1e-6)
    points = read_points(session.folder / "calibration" / "colmap")
    np.testing.assert_allclose(points.xyz, xyz, atol=1e-12)
    assert (points.views == 4).all()
    assert record.points == 40
    assert record.reprojection_px < 1e-6
    assert {view.points for view in record.views} == {40}
    (rung,) = record.rungs
    assert rung.taken
    assert "given by sparse/0" in rung.reason


def test_a_rig_comes_with_its_frames_and_its_mounting(project, seen_at):
    folder, truth = project("PINHOLE", rigs=1, cameras=3, frames=3)
    _, session, names = imported(folder)
    record = read_calibration(session.folder)
    assert len({camera.rig for camera in session.record.cameras}) == 1
    assert session.record.cameras[0].rig is not None
    assert len(names) == 9
    frame_of = {image.name: image.frame_id for image in truth.images.values()}
    for frame in range(3):
        assert (
            len({frame_of[name] for (_, frame_number), name in names.items() if frame_number == frame}) == 1
        )
    for view in record.views:
        mounting = record.camera(view.camera).cam_from_rig.matrix()
        (reference,) = (
            other
            for other in record.views
            if other.frame == view.frame
            and np.allclose(record.camera(other.camera).cam_from_rig.matrix(), np.eye(4))
        )
        expected = mounting @ reference.cam_from_world.matrix()
        np.testing.assert_allclose(view.cam_from_world.matrix(), expected, atol=1e-9)


def test_a_photo_that_the_model_of_a_rig_lacks_shares_a_frame_with_no_other(project, picture, put):
    folder, truth = project("PINHOLE", rigs=1, cameras=2, frames=3)
    last = max(image.frame_id for image in truth.images.values())
    for image in truth.images.values():
        home = folder / "images" / f"cam{image.camera_id}"
        put(home / image.name, (folder / "images" / image.name).read_bytes())
        (folder / "images" / image.name).unlink()
        if (image.frame_id, image.camera_id) == (last, 1):
            (home / image.name).unlink()
        image.name = f"{home.name}/{image.name}"
    truth.write(str(folder / "sparse" / "0"))
    for extra in range(2):
        put(folder / "images" / "cam1" / f"x{extra}.png", picture(90 + extra))
    _, _, names = imported(folder)
    others = {frame for (_, frame), name in names.items() if not name.startswith("x")}
    assert sorted(others) == [0, 1, 2]
    assert sorted(frame for (_, frame), name in names.items() if name.startswith("x")) == [3, 4]


def test_the_model_in_the_session_has_its_images_named_as_views(project):
    folder, truth = project()
    _, session, names = imported(folder)
    model = pycolmap.Reconstruction(str(session.folder / "calibration" / "colmap"))
    assert {image.name for image in model.images.values()} == {f"{c}/{f:04d}.png" for c, f in names}
    for (camera, frame), name in names.items():
        mine = model.find_image_with_name(f"{camera}/{frame:04d}.png").cam_from_world().matrix()
        theirs = truth.find_image_with_name(name).cam_from_world().matrix()
        np.testing.assert_array_equal(mine, theirs)


def test_a_lens_with_more_terms_becomes_the_nearest_and_says_so(project, seen_at):
    folder, truth = project("FULL_OPENCV")
    result, session, names = imported(folder)
    assert (result.shots, result.views) == (4, 4)
    assert any("FULL_OPENCV become the nearest that rig has" in guess for guess in result.guesses)
    record = read_calibration(session.folder)
    xyz = np.array([truth.points3D[key].xyz for key in sorted(truth.points3D)])
    for (camera, frame), name in names.items():
        expected = np.array([truth.find_image_with_name(name).project_point(point) for point in xyz])
        assert np.abs(seen_at(record, camera, frame, xyz) - expected).max() < 1
    model = pycolmap.Reconstruction(str(session.folder / "calibration" / "colmap"))
    assert {camera.model_name for camera in model.cameras.values()} <= {"OPENCV", "OPENCV_FISHEYE"}


def test_a_lens_that_rig_has_not_comes_without_poses_and_says_so(project):
    folder, _ = project("FULL_OPENCV", terms=(-0.9, 0.8, 0.2, 0.2, 3.0, 0.5, 0.9, 9.0))
    result, session, _ = imported(folder)
    assert (result.shots, result.views) == (4, 0)
    assert any("FULL_OPENCV come without lens and poses" in guess for guess in result.guesses)
    assert not (session.folder / "calibration").exists()


def test_photos_beside_the_model_come_without_a_pose_and_absent_ones_are_missing(project, picture, put):
    folder, truth = project()
    gone = min(image.name for image in truth.images.values())
    (folder / "images" / gone).unlink()
    put(folder / "images" / "later.png", picture(99))
    result, session, names = imported(folder)
    assert result.missing == ()
    assert any(re.search(gone, guess) for guess in result.guesses)
    record = read_calibration(session.folder)
    assert (result.shots, result.views) == (4, 3)
    (alone,) = record.unregistered
    assert names[alone.camera, alone.frame] == "later.png"
    assert len(read_points(session.folder / "calibration" / "colmap").xyz) == 40


def test_what_other_programs_keep_among_the_photos_is_no_view(project, picture, put):
    folder, truth = project()
    images, names = folder / "images", sorted(image.name for image in truth.images.values())
    mask = encode_png(np.full((48, 64), 255, np.uint8))
    for seed, name in enumerate(names):
        put(images / "@eaDir" / name / "SYNOPHOTO_THUMB_M.png", picture(seed, (24, 32)))
        put(images / "masks" / f"{name}.png", mask)
        put(images / f"{Path(name).stem}.tif", picture(seed))
    result, session, _ = imported(folder)
    assert (result.shots, result.views) == (4, 4)
    assert all(session.mask(shot).read_bytes() == mask for shot in session.shots())
    said = "\n".join(result.guesses)
    assert "8 files are left aside as made of the photographs" in said
    assert "those of images/@eaDir" in said
    assert "4 files are left aside beside photos of the same name, which have poses." in said
    assert "4 of 4 photos have a mask" in said


@pytest.mark.parametrize("raw", [False, True])
def test_of_a_pair_without_a_pose_the_file_like_those_of_the_model_counts(project, picture, put, raw):
    folder, truth = project()
    images, data = folder / "images", dng(size=(48, 64), time=0.1)
    if raw:
        for image in truth.images.values():
            (images / image.name).unlink()
            image.name = f"{Path(image.name).stem}.dng"
            put(images / image.name, dng(image.image_id, size=(48, 64), time=0.1))
        truth.write(str(folder / "sparse" / "0"))
    put(images / "later.DNG", data)
    put(images / "Later.png", picture(99))
    put(images / "last.png", picture(98))
    result, _, names = imported(folder)
    assert (result.shots, result.views) == (6, 4)
    unposed = {"later.DNG" if raw else "Later.png", "last.png"}
    assert set(names.values()) == {image.name for image in truth.images.values()} | unposed
    assert "1 file is left aside beside photos of the same name, which have no poses." in result.guesses
    assert any(guess.startswith("2 photos that") for guess in result.guesses)


def test_pictures_of_half_the_size_get_half_the_focal_length(project, picture, put):
    folder, truth = project("PINHOLE")
    for image in truth.images.values():
        put(folder / "images" / image.name, picture(1, (24, 32)))
    _, session, _ = imported(folder)
    lens = read_calibration(session.folder).cameras[0].lens
    assert (lens.width, lens.height, lens.fx, lens.fy, lens.cx) == (32, 24, 35.0, 36.0, 16.5)


def test_pictures_of_another_shape_than_their_lens_are_refused(project, picture, put):
    folder, truth = project("PINHOLE")
    put(folder / "images" / truth.images[1].name, picture(1, (64, 48)))
    with pytest.raises(InputError, match=r"has 48x64 pixels but .* says 64x48"):
        imported(folder)
    assert not (folder.parent / "s").exists()


def test_the_layout_can_be_overridden_and_the_bracket_too(project):
    folder, _ = project()
    result, session, _ = imported(folder, layout="photos")
    assert (result.layout, result.views, result.shots) == ("photos", 0, 4)
    shutil.rmtree(session.folder)
    result, session, names = imported(folder, bracket=2)
    assert (result.frames, result.views) == (2, 2)
    assert {frame for _, frame in names} == {0, 1}
    model = pycolmap.Reconstruction(str(session.folder / "calibration" / "colmap"))
    assert model.num_reg_images() == 2


@pytest.mark.parametrize("name", ["cameras", "images", "points3D", "rigs", "frames"])
def test_a_model_cut_off_anywhere_is_refused_in_one_sentence(project, name):
    folder, _ = project(rigs=1, cameras=2, frames=2)
    path = folder / "sparse" / "0" / f"{name}.bin"
    data = path.read_bytes()
    for end in {*range(0, min(len(data), 120)), *range(0, len(data), 97)}:
        path.write_bytes(data[:end])
        with pytest.raises(InputError, match=r"damaged or cut off: copy it again\.$"):
            imported(folder)
    assert not (folder.parent / "s").exists()


@pytest.mark.parametrize("text", [False, True])
def test_a_model_of_wrong_bytes_is_read_or_refused(project, text):
    folder, _ = project(frames=2, text=text)
    place = folder / "sparse" / "0"
    rng = np.random.default_rng(4)
    sentences = []
    for name in ("cameras", "images", "points3D", "rigs", "frames"):
        path = place / f"{name}.{'txt' if text else 'bin'}"
        data = path.read_bytes()
        for _ in range(8):
            wrong = bytearray(data)
            for at in rng.integers(0, len(wrong), 3):
                wrong[at] = int(rng.integers(256))
            path.write_bytes(wrong)
            try:
                imported(folder)
            except InputError as error:
                sentences.append(str(error))
            shutil.rmtree(folder.parent / "s", ignore_errors=True)
        path.write_bytes(data)
    assert len(sentences) > 10
    assert all("\n" not in sentence and len(sentence) < 400 for sentence in sentences)


def test_of_several_models_the_first_is_read_and_that_is_said(project):
    folder, _ = project()
    (folder / "sparse" / "1").mkdir()
    result, _, _ = imported(folder)
    assert any("Only sparse/0 is read; the photos of sparse/1" in guess for guess in result.guesses)
    assert result.views == 4


def test_two_images_of_one_name_are_refused(project):
    folder, truth = project(text=True)
    path = folder / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace(truth.images[1].name, truth.images[2].name))
    with pytest.raises(InputError, match="twice: take one of both out"):
        imported(folder)


def test_a_name_that_leads_out_of_the_folder_is_refused(project):
    folder, truth = project(text=True)
    path = folder / "sparse" / "0" / "images.txt"
    path.write_text(path.read_text().replace(truth.images[1].name, "../../secret.png"))
    with pytest.raises(InputError, match=r"'../../secret.png' leads out of"):
        imported(folder)
