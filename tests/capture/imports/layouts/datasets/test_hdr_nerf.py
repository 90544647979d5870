import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.imports.layouts.datasets import hdr_nerf
from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.colmap import pycolmap, read_points
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import write_exr
from imaging.session.session import brackets
from recon.data.load import load
from recon.measure.truth import has_truth, true_radiance

from .hdr_nerf_scenes import (
    CENTRES,
    POINTS,
    TIMES,
    expected_pixels,
    handed_on,
    imported,
    light,
    photographed,
    png,
    rendered,
    table,
)


@pytest.mark.parametrize("form", [rendered, photographed])
def test_views_are_brackets_of_one_camera_that_see_what_their_axes_say(tmp_path, form, seen_at):
    result, session, record = imported(form(tmp_path / "h"))
    assert (result.layout, result.cameras, result.frames, result.views) == ("hdr-nerf", 1, 4, 4)
    (camera,) = session.record.cameras
    for view, group in brackets(session.shots()).items():
        assert [shot.reported.time for shot in group] == list(TIMES)
        assert len({Path(shot.source).stem.rsplit("_", 1)[0] for shot in group}) == 1
        pixels = seen_at(record, camera.name, view.frame, POINTS)
        np.testing.assert_allclose(pixels, expected_pixels(CENTRES[view.frame]), atol=1e-6)
    assert {shot.file: shot.reported.time for shot in session.shots()} == record.exposure_scale


def test_a_scene_handed_on_with_a_model_has_its_points_and_every_exposure_a_pose(tmp_path):
    folder = handed_on(tmp_path / "h")
    result, session, record = imported(folder)
    assert (result.layout, result.frames, result.views, result.shots) == ("hdr-nerf", 4, 4, 20)
    assert any(
        "taken to be 0.125, 0.5, 2, 8, 32 s" in guess and "--exposures" in guess for guess in result.guesses
    )
    model = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    for shot in session.shots():
        name = Path(shot.source).stem.split("_")[0]
        (view,) = (v for v in record.views if v.frame == shot.frame)
        expected = model.find_image_with_name(f"{name}_1.png").cam_from_world().matrix()
        np.testing.assert_allclose(view.cam_from_world.matrix()[:3], expected, atol=1e-12)
        assert shot.reported.time == TIMES[shot.step]
    assert (read_points(session.folder / "calibration" / "colmap").views == 4).all()


@pytest.mark.parametrize(
    ("form", "tested"), [(rendered, ("test",)), (photographed, ("001", "003")), (handed_on, ("1", "3"))]
)
def test_what_the_data_set_tests_on_is_what_training_does_not_see(tmp_path, form, tested):
    result, session, _ = imported(form(tmp_path / "h"))
    assert any("2 views are for training and 2 for testing" in guess for guess in result.guesses)
    assert any("4 photographs are for neither" in guess for guess in result.guesses)
    dataset = load(session.folder)
    sources = {shot.file: Path(shot.source) for shot in session.shots()}
    for view in dataset.views:
        test = view in dataset.held_out
        assert [shot.k for shot in view.shots] == list(TIMES if test else TIMES[::2])
        for shot in view.shots:
            path = sources[shot.file]
            view_name = path.parent.name if form is rendered else path.stem.split("_")[0]
            assert (view_name in tested) == test
    assert len(dataset.held_out) == len(dataset.train) == 2
    assert [dataset.trained_at(time) for time in TIMES] == [True, False, True, False, True]


def test_views_take_turns_in_the_order_of_names_as_text(tmp_path):
    """Sort as the loader of HDR-GS, which has `10_0` before `1_0`."""
    folder = handed_on(tmp_path / "h")
    for old, new in (("3", "10"), ("2", "3"), ("1", "2"), ("0", "1")):
        for path in sorted((folder / "images").glob(f"{old}_?.png")):
            path.rename(path.with_name(path.name.replace(f"{old}_", f"{new}_", 1)))
        (folder / "exr" / f"{old}.exr").rename(folder / "exr" / f"{new}.exr")
    model = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    for image in model.images.values():
        image.name = {
            "0_1.png": "1_1.png",
            "1_1.png": "2_1.png",
            "2_1.png": "3_1.png",
            "3_1.png": "10_1.png",
        }[image.name]
    model.write(str(folder / "sparse" / "0"))
    given = hdr_nerf.read(folder)
    assert {photo.path.stem.split("_")[0] for photo in given.photos if photo.use == "test"} == {"1", "3"}


@pytest.mark.parametrize(
    ("name", "light"),
    [
        ("frame_{:03d}.png", ""),
        ("frame_{:03d}.png", "other"),
        ("frame_{:03d}.png", "frame"),
        ("IMG_{:04d}.png", "IMG"),
    ],
)
def test_a_colmap_project_with_a_folder_exr_of_its_own_keeps_its_poses(tmp_path, name, light):
    folder = handed_on(tmp_path / "h", lit=())
    place = folder / "sparse" / "0"
    model = pycolmap.Reconstruction(str(place))
    shutil.rmtree(folder / "images")
    (folder / "images").mkdir()
    (folder / "exr").mkdir()
    if light:
        (folder / "exr" / f"{light}.exr").write_bytes(b"")
    for number, image in enumerate(model.images.values(), start=1):
        image.name = name.format(number)
        (folder / "images" / image.name).write_bytes(png(number))
    model.write(str(place))
    result, _, _ = imported(folder)
    assert (result.layout, result.frames, result.views) == ("colmap", 4, 4)


def test_a_picture_of_another_name_is_refused_with_the_layout_that_reads_it(tmp_path):
    folder = handed_on(tmp_path / "h")
    (folder / "images" / "cover.png").write_bytes(png(1))
    assert not hdr_nerf.is_one(folder)
    with pytest.raises(InputError, match=r"cover\.png is not named VIEW_INDEX: .* use --layout colmap\.$"):
        hdr_nerf.read(folder)


def test_a_layout_without_test_views_has_no_split(tmp_path):
    folder = rendered(tmp_path / "h")
    (folder / "transforms_test.json").unlink()
    _, session, _ = imported(folder)
    assert session.split() is None


@pytest.mark.parametrize("form", [rendered, handed_on])
def test_true_light_is_where_an_evaluation_looks_for_it(tmp_path, form):
    folder = form(tmp_path / "h")
    _, session, _ = imported(folder)
    assert has_truth(session.folder)
    shots = {shot.frame: shot for shot in session.shots()}
    dataset = load(session.folder)
    assert len(dataset.views) == 4
    for view in dataset.views:
        name = Path(shots[view.frame].source).stem.split("_")[0]
        number = int(name) if form is handed_on else view.frame
        np.testing.assert_array_equal(true_radiance(session.folder, view), light(number))


def test_true_light_is_that_of_the_views_at_the_width_they_are_trained_at(tmp_path):
    """40 px, as a preset has them, of 64: the whole picture and not a corner of it."""
    _, session, _ = imported(rendered(tmp_path / "h"))
    ramp = np.arange(48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    for view in load(session.folder, max_width=40).views:
        write_exr(session.folder / "truth" / f"{view.frame:04d}" / f"{view.camera}.exr", ramp)
        assert (view.lens.width, view.lens.height) == (40, 30)
        whole = cv2.resize(ramp, (40, 30), interpolation=cv2.INTER_AREA)
        np.testing.assert_allclose(true_radiance(session.folder, view), whole, rtol=1e-6)


def test_true_light_that_some_views_lack_is_left_aside_and_said(tmp_path):
    result, session, _ = imported(handed_on(tmp_path / "h", lit=(0, 1, 3)))
    assert not has_truth(session.folder)
    assert any("true light of 3 of 4 views is left aside" in guess for guess in result.guesses)
    shutil.rmtree(session.folder)
    folder = handed_on(tmp_path / "k")
    write_exr(folder / "exr" / "2.exr", light(2, (24, 32)))
    result, session, _ = imported(folder)
    assert any("2.exr is smaller than its photographs" in guess for guess in result.guesses)
    assert not (session.folder / "truth").exists()


def test_another_list_of_exposures_wins(tmp_path):
    folder = handed_on(tmp_path / "h")
    rows = [f"{view}_{step}.png, 1/{2 ** (9 - step)}, 4" for view in range(4) for step in range(5)]
    (tmp_path / "times.csv").write_text("\n".join(rows))
    _, session, _ = imported(folder, exposures=tmp_path / "times.csv")
    for shot in session.shots():
        assert (shot.reported.time, shot.reported.f_number) == (1 / 2 ** (9 - shot.step), 4)


def test_an_import_that_was_killed_between_any_two_steps_is_completed(tmp_path):
    folder = handed_on(tmp_path / "h")
    import_photos(folder, tmp_path / "whole")

    def files(root: Path):
        return {
            p.relative_to(root).as_posix(): p.read_bytes()
            for p in sorted(root.rglob("*"))
            if p.is_file() and p.suffix not in (".json", ".jsonl")
        }

    for stop_at in (3, 20, 21):
        steps = 0

        def stop(message, done, total, last=stop_at):
            nonlocal steps
            steps += message.startswith(("copying", "writing the calibration"))
            if steps == last:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            import_photos(folder, tmp_path / "s", on_progress=stop)
        assert not (tmp_path / "s" / "calibration").exists()
        result = import_photos(folder, tmp_path / "s")
        assert (result.shots, result.views) == (20, 4)
        assert files(tmp_path / "s") == files(tmp_path / "whole")
        with pytest.raises(InputError, match="holds this import already, complete"):
            import_photos(folder, tmp_path / "s")
        shutil.rmtree(tmp_path / "s")


def rows_with(**cells) -> np.ndarray:
    rows = table()
    for column, value in cells.items():
        rows[7, int(column[1:])] = value
    return rows


BAD_ROWS = {
    "one row short": (table()[1:], "has 19 rows for 20 photos"),
    "seventeen columns": (table()[:, :17], r"shape \[20, 17\]"),
    "no rows": (table()[:0], r"shape \[0, 18\]"),
    "text": (np.array([["a"] * 18] * 20), "cannot be read as an array of numbers"),
    "objects": (np.array([[None] * 18] * 20), "cannot be read as an array of numbers"),
    "complex": (table() + 1j, "cannot be read as an array of numbers"),
    "no exposure": (rows_with(c17=0.0), "row 7 of .* has an exposure of 0.0 s"),
    "NaN exposure": (rows_with(c17=np.nan), "row 7 of .* has an exposure of nan s"),
    "another size": (rows_with(c4=97.0), "more than one size"),
    "NaN focal length": (rows_with(c14=np.nan), "more than one size"),
    "NaN pose": (rows_with(c0=np.nan), "row 7 of .* finite numbers"),
    "no rotation": (rows_with(c0=3.0), "row 7 of .* scales, shears or mirrors"),
}


@pytest.mark.parametrize("name", BAD_ROWS)
def test_an_array_that_cannot_be_is_refused(tmp_path, name):
    rows, sentence = BAD_ROWS[name]
    with pytest.raises(InputError, match=sentence):
        imported(photographed(tmp_path / "h", rows))
    assert {path.name for path in tmp_path.iterdir()} == {"h"}


def test_names_and_files_that_contradict_each_other_are_refused_or_told(tmp_path):
    folder = photographed(tmp_path / "a")
    (folder / "input_images" / "cover.png").write_bytes(png(1))
    with pytest.raises(InputError, match=r"cover\.png is not named VIEW_INDEX"):
        imported(folder)
    folder = rendered(tmp_path / "b")
    (folder / "exposure_test.json").write_text(json.dumps({"./test/000_0.png": "soon"}))
    with pytest.raises(InputError, match="has an exposure of soon s"):
        imported(folder)
    (folder / "exposure_test.json").write_text(json.dumps({"../test/000_0.png": 1}))
    with pytest.raises(InputError, match=r"frame 0 of .* has no exposure time"):
        imported(folder)
    folder = rendered(tmp_path / "c")
    (folder / "test" / "001_3.png").unlink()
    result, session, _ = imported(folder)
    assert result.missing == ()
    assert any(
        re.search(r"001_3\.png is named in frame 1 of .*transforms_test\.json", guess)
        for guess in result.guesses
    )
    assert [len(group) for group in brackets(session.shots()).values()] == [5, 5, 5, 4]


@given(data=st.binary(max_size=200) | st.binary(max_size=120).map(lambda tail: b"\x93NUMPY\x01\x00" + tail))
@settings(max_examples=80, suppress_health_check=list(HealthCheck))
def test_any_bytes_in_place_of_the_array_are_refused(tmp_path_factory, data):
    folder = tmp_path_factory.mktemp("any")
    (folder / "input_images").mkdir()
    (folder / "input_images" / "0_0.png").write_bytes(b"")
    (folder / "poses_bounds_exps.npy").write_bytes(data)
    with pytest.raises(InputError, match=r"cannot be read as an array of numbers|has the shape"):
        hdr_nerf.read(folder)


def test_the_true_light_comes_byte_for_byte_and_the_originals_stay(tmp_path):
    folder = handed_on(tmp_path / "h")
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file()}
    _, session, _ = imported(folder)
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file()} == before
    stored = {path.read_bytes() for path in (session.folder / "truth").rglob("*.exr")}
    assert stored == {path.read_bytes() for path in (folder / "exr").iterdir()}
    assert all(read_exr(path).rgb().min() > 0 for path in (session.folder / "truth").rglob("*.exr"))
