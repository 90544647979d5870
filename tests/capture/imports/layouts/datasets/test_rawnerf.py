import contextlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.imports.layouts import detect
from capture.imports.layouts.datasets import rawnerf
from imaging.errors import InputError
from imaging.files.colmap import pycolmap, read_points
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic
from imaging.session.session import Session, brackets
from recon.data.load import load
from tests.capture.imports.layouts.test_llff import imported

SIZE = (48, 64)
NAMES = [f"IMG_{number}" for number in (9, 10, 11, 12, 13, 14, 15, 16, 17, 18)]
"""Names as text: IMG_10 comes before IMG_9."""


def dng(seed: int, time: float = 1 / 45) -> bytes:
    pixels = np.random.default_rng(seed).integers(528, 4096, SIZE, dtype=np.uint16)
    metadata = FrameMetadata(
        make="Apple", model="iPhone X", exposure=Exposure(time=time, f_number=1.8, iso=100)
    )
    return encode_dng(RawMosaic(pixels, Cfa.RGGB, ((528.0,),), 4095, metadata=metadata))


def sidecar(time: str = "1/45") -> str:
    """Write it as exiftool -json does: a list of one, vectors as text."""
    fields = {"SourceFile": "x.dng", "ShutterSpeed": time, "ISO": 2000, "FNumber": 1.8, "BlackLevel": 528}
    return json.dumps([fields | {"AsShotNeutral": "0.8357477784 1 0.3002712429"}])


def model(folder: Path, names: list[str]) -> None:
    """A COLMAP model of developed copies, all of one camera."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, len(names), 30
    options.camera_width, options.camera_height = SIZE[1], SIZE[0]
    options.camera_model_id = pycolmap.CameraModelId.OPENCV
    options.camera_params = [70.0, 71.0, 32.0, 24.0, 0.01, 0.0, 0.0, 0.0]
    pycolmap.set_random_seed(5)
    made = pycolmap.synthesize_dataset(options)
    for name, image in zip(names, made.images.values(), strict=True):
        image.name = f"{name}.JPG"
    (folder / "sparse" / "0").mkdir(parents=True)
    made.write(str(folder / "sparse" / "0"))


def shot(path: Path, seed: int, time: str = "1/45") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(dng(seed))
    path.with_suffix(".json").write_text(sidecar(time))


def scene(folder: Path, picture, put) -> Path:
    """A scene as the authors' loader reads it: raw/ flat, developed copies, a model."""
    for number, name in enumerate(NAMES):
        shot(folder / "raw" / f"{name}.dng", number)
        put(folder / "images" / f"{name}.JPG", picture(number, SIZE))
    model(folder, NAMES)
    np.save(folder / "poses_bounds.npy", np.zeros((len(NAMES), 17)))
    return folder


def scene_with_clean_mosaic(folder: Path, picture, put) -> Path:
    """One with a clean mosaic: the first name is that of a copy of the test image."""
    for number, time in enumerate(["1/1000", "1/10", "1/10"]):
        shot(folder / "raw" / "test" / f"frame_{number}.dng", 20 + number, time)
    for number, name in enumerate(NAMES):
        shot(folder / "raw" / "train" / f"{name}.dng", number, "1/1000")
    put(folder / "hdrplus_test" / "merged.dng", dng(30))
    names = ["00_test", *NAMES]
    for name in names:
        put(folder / "images" / f"{name}.JPG", picture(1, SIZE))
    model(folder, names)
    return folder


def stems(session: Session) -> dict[int, list[str]]:
    return {
        view.frame: [Path(s.source).stem for s in group] for view, group in brackets(session.shots()).items()
    }


def test_mosaics_get_the_poses_of_the_copies_of_their_name(tmp_path, picture, put):
    folder = scene(tmp_path / "candle", picture, put)
    result, session, record = imported(folder)
    assert (result.layout, result.shots, result.frames, result.views) == ("rawnerf", 10, 10, 10)
    assert result.missing == ()
    truth = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    for frame, (stem,) in stems(session).items():
        (view,) = (view for view in record.views if view.frame == frame)
        expected = truth.find_image_with_name(f"{stem}.JPG").cam_from_world().matrix()
        np.testing.assert_allclose(view.cam_from_world.matrix()[:3], expected, atol=1e-12)
    lens = record.cameras[0].lens
    assert (lens.fx, lens.fy, lens.k1) == (70.0, 71.0, 0.01)
    assert (read_points(session.folder / "calibration" / "colmap").views == len(NAMES)).all()
    for written in session.shots():
        assert session.file(written).read_bytes() == Path(written.source).read_bytes()


def test_a_sidecar_tells_the_exposure_and_every_eighth_name_is_for_testing(tmp_path, picture, put):
    folder = scene(tmp_path / "candle", picture, put)
    (folder / "raw" / "IMG_12.json").unlink()
    (folder / "raw" / "IMG_13.json").write_text(json.dumps([{"ExposureTime": 0.5, "ISO": 64}]))
    _, session, _ = imported(folder)
    reported = {Path(s.source).stem: s.reported for s in session.shots()}
    assert reported["IMG_9"] == Exposure(time=1 / 45, f_number=1.8, iso=2000)
    assert reported["IMG_13"] == Exposure(time=0.5, iso=64)
    assert reported["IMG_12"].iso == 100  # the file's own
    dataset = load(session.folder)
    assert {stems(session)[view.frame][0] for view in dataset.held_out} == {"IMG_10", "IMG_18"}
    assert len(dataset.train) == 8
    assert dataset.train[0].sensor.cfa == Cfa.RGGB


def test_the_test_view_of_a_test_scene_is_the_first_by_name(tmp_path, picture, put):
    folder = scene_with_clean_mosaic(tmp_path / "candlefiat", picture, put)
    result, session, record = imported(folder)
    assert (result.layout, result.shots, result.frames, result.views) == ("rawnerf", 13, 11, 11)
    assert any("00_test.JPG is the test view" in guess and "merged.dng" in guess for guess in result.guesses)
    assert stems(session)[0] == ["frame_0", "frame_1", "frame_2"]
    assert sorted(stem for frame, (stem, *_) in stems(session).items() if frame) == sorted(NAMES)
    dataset = load(session.folder)
    assert [view.frame for view in dataset.held_out] == [0]
    assert [s.file for s in dataset.held_out[0].shots] == [session.shots()[0].file]
    assert dataset.held_out[0].shots[0].k == pytest.approx(20 / 1000 / 1.8**2)
    assert len(dataset.train) == 10
    truth = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    expected = truth.find_image_with_name("00_test.JPG").cam_from_world().matrix()
    (view,) = (view for view in record.views if view.frame == 0)
    np.testing.assert_allclose(view.cam_from_world.matrix()[:3], expected, atol=1e-12)


def test_poses_may_come_as_rows_in_the_order_of_the_copies(tmp_path, picture, put):
    folder = scene(tmp_path / "candle", picture, put)
    for path in (folder / "sparse" / "0").iterdir():
        path.unlink()
    rows = np.zeros((len(NAMES), 17))
    for number, row in enumerate(rows):
        matrix = np.zeros((3, 5))
        matrix[:, 0], matrix[:, 1], matrix[:, 2] = (0, -1, 0), (1, 0, 0), (0, 0, 1)
        matrix[:, 3], matrix[:, 4] = (number, 0, 0), (*SIZE, 70.0)
        row[:15] = matrix.ravel()
    np.save(folder / "poses_bounds.npy", rows)
    result, session, record = imported(folder)
    assert (result.layout, result.views) == ("rawnerf", 10)
    ordered = sorted(NAMES)
    for view in record.views:
        motion = view.cam_from_world.matrix()
        centre = -motion[:3, :3].T @ motion[:3, 3]
        np.testing.assert_allclose(centre, [ordered.index(stems(session)[view.frame][0]), 0, 0], atol=1e-12)


def test_what_is_not_there_is_told(tmp_path, picture, put):
    folder = scene(tmp_path / "a", picture, put)
    (folder / "raw" / "IMG_11.dng").unlink()
    shot(folder / "raw" / "IMG_99.dng", 99)
    result, session, _ = imported(folder)
    assert result.missing == ()
    assert any(
        re.search(r"IMG_11\.dng, of which IMG_11\.JPG is made, does not exist", guess)
        for guess in result.guesses
    )
    assert any("1 DNG file is left aside" in guess for guess in result.guesses)
    assert (result.shots, result.views) == (9, 9)
    assert "IMG_99" not in {stem for group in stems(session).values() for stem in group}


def test_folders_that_only_look_alike_are_read_as_before(tmp_path, picture, put):
    folder = scene(tmp_path / "a", picture, put)
    for path in (folder / "raw").glob("*.json"):
        path.unlink()
    assert detect(folder) == "colmap"
    (folder / "sparse" / "0" / "cameras.bin").unlink()
    assert detect(folder) == "llff"
    (folder / "poses_bounds.npy").unlink()
    assert detect(folder) == "photos"


BROKEN = {
    "an object": ("{}", "is not what exiftool -json writes"),
    "no object": ("[]", "is not what exiftool -json writes"),
    "no JSON": ("[{", "cannot be read as JSON"),
    "no time": ('[{"ShutterSpeed": "soon"}]', "has a ShutterSpeed of soon"),
    "one over nothing": ('[{"ShutterSpeed": "1/0"}]', "has a ShutterSpeed of 1/0"),
    "negative": ('[{"ShutterSpeed": -1}]', "has a ShutterSpeed of -1"),
    "true": ('[{"ShutterSpeed": true}]', "has a ShutterSpeed of True"),
    "ISO": ('[{"ShutterSpeed": "1/45", "ISO": "auto"}]', "has a ISO of auto"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_damaged_sidecar_is_refused(tmp_path, picture, put, name):
    text, sentence = BROKEN[name]
    folder = scene(tmp_path / "a", picture, put)
    (folder / "raw" / "IMG_14.json").write_text(text)
    with pytest.raises(InputError, match=sentence) as error:
        imported(folder)
    assert "IMG_14.json" in str(error.value)
    assert not (tmp_path / "s").exists()


def test_a_test_scene_without_its_shots_and_two_copies_of_one_name_are_refused(tmp_path, picture, put):
    folder = scene_with_clean_mosaic(tmp_path / "a", picture, put)
    for path in (folder / "raw" / "test").iterdir():
        path.unlink()
    with pytest.raises(InputError, match=r"raw/test has no DNG file beside hdrplus_test/merged\.dng"):
        rawnerf.read(folder)
    folder = scene(tmp_path / "b", picture, put)
    made = pycolmap.Reconstruction(str(folder / "sparse" / "0"))
    made.find_image_with_name("IMG_10.JPG").name = "IMG_9.png"
    made.write(str(folder / "sparse" / "0"))
    with pytest.raises(InputError, match="two images named IMG_9"):
        rawnerf.read(folder)


@given(
    text=st.text(max_size=60)
    | st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=2)
            | st.dictionaries(st.sampled_from(["ShutterSpeed", "ISO", "FNumber", "x"]), inner, max_size=3)
        ),
    ).map(json.dumps)
)
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
def test_any_sidecar_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("any") / "a.dng"
    path.with_suffix(".json").write_text(text, errors="surrogatepass")
    exposure = None
    with contextlib.suppress(InputError):
        exposure = rawnerf._exposure(path)
    assert exposure is None or exposure.scale > 0
