"""Photographs of one body with several lenses, of one that was turned, and of bodies that no file names."""

from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from capture.imports.photos import import_photos
from capture.imports.sorting.lens_settings import LensSetting, lens_settings
from imaging.files.photo import encode_jpeg, encode_png, read_metadata, read_photo
from imaging.merge.masks import mask_of
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from tests.capture.imports.photo_files import NOON, jpeg, put


def shot(seed=0, size=(24, 32), at=None, make="Acme", **said) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)
    when = None if at is None else NOON + timedelta(seconds=at)
    exposure = Exposure(time=0.01, f_number=8, iso=100)
    model = "Z1" if make else ""
    said |= {"make": make, "model": model, "exposure": exposure, "captured_at": when}
    return encode_jpeg(pixels, metadata=FrameMetadata(**said))


def cameras_of(session: Path) -> list[list[int]]:
    """The numbers in the names of the photographs of each camera."""
    photos_by_camera: dict[str, list[int]] = {}
    for one in Session.open(session).shots():
        photos_by_camera.setdefault(one.camera, []).append(int(Path(one.source).stem))
    return sorted(sorted(numbers) for numbers in photos_by_camera.values())


ZOOM = [{"focal_length_mm": 24.0}, {"focal_length_mm": 70.0}]
SETTINGS = {
    "zoom": ZOOM,
    "zoom, both lengths": [{"focal_length_mm": mm, "focal_length_35mm": 1.5 * mm} for mm in (24.0, 70.0)],
    "only equivalents": [{"focal_length_35mm": 24.0}, {"focal_length_35mm": 25.0}],
    "lenses of a telephone": [
        {"focal_length_mm": 5.7, "lens": "back camera 5.7mm"},
        {"focal_length_mm": 1.57, "lens": "back camera 1.57mm"},
    ],
    "lenses of one length": [
        {"focal_length_mm": 50.0, "lens": lens} for lens in ("A 50 f/1.8", "B 50 macro")
    ],
    "digital zoom by its ratio": [{"focal_length_mm": 4.25}, {"focal_length_mm": 4.25, "digital_zoom": 2.0}],
    "digital zoom by its equivalent": [
        {"focal_length_mm": 4.25, "focal_length_35mm": 26.0},
        {"focal_length_mm": 4.25, "focal_length_35mm": 52.0},
    ],
}


@pytest.mark.parametrize("at", [None, 10.0])
@pytest.mark.parametrize("serial", ["", "77"])
@pytest.mark.parametrize("name", SETTINGS)
def test_each_setting_of_the_lens_of_a_body_is_a_camera_and_none_was_there_twice(tmp_path, name, serial, at):
    files = {f"{n}.jpg": shot(n, at=at and at * n, serial=serial, **SETTINGS[name][n % 2]) for n in range(8)}
    result = import_photos(put(tmp_path / "in", files), tmp_path / "s")
    assert cameras_of(tmp_path / "s") == [[0, 2, 4, 6], [1, 3, 5, 7]]
    assert (result.cameras, result.frames) == (2, 8)
    assert any("2 cameras, by" in guess and "focal length or lens" in guess for guess in result.guesses)
    assert import_photos(tmp_path / "in", tmp_path / "t", cameras="one").cameras == 1


def test_one_setting_is_one_lens_however_files_round_it_and_whether_all_tell_it():
    rounded = [
        FrameMetadata(focal_length_mm=mm, focal_length_35mm=f) for mm, f in ((4.25, 26.0), (4.26, 27.0))
    ]
    assert len(set(lens_settings([*rounded, FrameMetadata()]))) == 1
    assert set(lens_settings([FrameMetadata()] * 2)) == {LensSetting()}
    three = [FrameMetadata(focal_length_mm=mm) for mm in (24.0, 70.0)] + [FrameMetadata()]
    assert len(set(lens_settings(three))) == 3


def test_a_camera_that_tells_its_lens_and_no_serial_number_is_one_sentence(tmp_path):
    put(tmp_path / "in", {f"{n}.jpg": shot(n, lens="A 50mm", focal_length_mm=50.0) for n in range(2)})
    said = import_photos(tmp_path / "in", tmp_path / "s").guesses[0]
    assert "no serial number, the lens at A 50mm, 50 mm and the size 32x24" in said


@pytest.mark.parametrize("make", ["Acme", ""])
def test_portrait_and_landscape_are_one_camera_whose_pictures_lie_alike(tmp_path, make):
    sizes = [(24, 32), (32, 24), (24, 32), (32, 24), (24, 32)]
    files = {f"{n}.jpg": shot(n, size, make=make, focal_length_35mm=35.0) for n, size in enumerate(sizes)}
    photos = put(tmp_path / "in", files)
    mask = np.zeros((32, 24), np.uint8)
    mask[:5] = 255
    put(tmp_path / "masks", {"1.png": encode_png(mask)})
    result = import_photos(photos, tmp_path / "s", masks=tmp_path / "masks")
    session = Session.open(tmp_path / "s")
    assert (result.cameras, result.frames) == (1, 5)
    assert any(guess.startswith("2 photos lie across the others") for guess in result.guesses)
    for number, one in enumerate(session.shots()):
        stored, original = read_photo(session.file(one)), read_photo(photos / f"{number}.jpg")
        assert (one.width, one.height) == (32, 24)
        upright = number % 2 == 1
        assert np.array_equal(stored.pixels, np.rot90(original.pixels) if upright else original.pixels)
        assert read_metadata(session.file(one)).focal_length_35mm == 35.0
        assert [(session.folder / name).read_bytes() for name in one.shifted] == [
            files[f"{number}.jpg"]
        ] * upright
    turned = session.shots()[1]
    assert np.array_equal(mask_of(session, turned, 24, 32), np.rot90(mask) > 0)


def test_photographs_that_tell_neither_camera_nor_time_are_frames_of_one_camera_in_few_sentences(tmp_path):
    nested = {f"{folder}/{n}.jpg": jpeg(n + 10 * at) for at, folder in enumerate("abcd") for n in range(3)}
    result = import_photos(put(tmp_path / "in", nested), tmp_path / "s")
    assert (result.cameras, result.frames, result.shots) == (1, 12, 12)
    assert import_photos(tmp_path / "in", tmp_path / "t", cameras="folder").frames == 3
    other = {f"{n}.jpg": jpeg(n, size=(24 + n, 40)) for n in range(10)}
    result = import_photos(put(tmp_path / "other", other), tmp_path / "u")
    assert (result.cameras, result.frames) == (10, 10)
    assert len(result.guesses) <= 4


def test_folders_are_cameras_where_counts_and_times_agree(tmp_path):
    def taken(late: float, count: int = 5) -> dict[str, bytes]:
        return {f"{n}.jpg": shot(n, at=7.0 * n * n + late, make="") for n in range(count)}

    def beside(name: str, right: dict[str, bytes]) -> Path:
        left = {f"left/{file}": data for file, data in taken(0.0).items()}
        return put(tmp_path / name, left | {f"right/{file}": data for file, data in right.items()})

    together = import_photos(beside("rig", taken(3600.3)), tmp_path / "s")
    assert (together.cameras, together.frames) == (2, 5)
    fewer = import_photos(beside("fewer", taken(3600.3, 4)), tmp_path / "t")
    assert (fewer.cameras, fewer.frames) == (1, 9)
    files = {f"{n}.jpg": shot(n, at=500.0 + 3.0 * n, make="") for n in range(5)}
    apart = import_photos(beside("apart", files), tmp_path / "u")
    assert (apart.cameras, apart.frames) == (1, 10)
