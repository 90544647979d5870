"""Lists that say how photographs without EXIF were exposed."""

from pathlib import Path

import numpy as np
import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError
from imaging.files.photo import encode_jpeg, encode_png
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session

from .photo_files import T, jpeg, put


def test_an_exposure_list_speaks_for_photographs_without_exif(tmp_path):
    rows = [("a.png", 4, 0.25), ("b.png", 1, 1), ("c.png", 0.25, 4), ("absent.png", 1, 1)]
    text = "# Filename exposure 1/shutter f/stop gain ND\n" + "".join(
        f"{n} {t} {s} 8 0 0\n" for n, t, s in rows
    )
    pixels = np.random.default_rng(1).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    files = {name: encode_png(pixels + np.uint8(n)) for n, name in enumerate(("a.png", "b.png", "c.png"))}
    put(tmp_path / "photos", files | {"image_list.txt": text.encode()})
    result = import_photos(tmp_path / "photos", tmp_path / "s")
    assert (
        "The exposures of 3 of 3 photos are those of image_list.txt, not of their EXIF; "
        "--exposures FILE gives others." in result.guesses
    )
    shots = Session.open(tmp_path / "s").shots()
    assert [(s.frame, s.step) for s in shots] == [(0, 0), (0, 1), (0, 2)]
    assert [s.reported for s in shots] == [Exposure(time=t, f_number=8) for t in (4, 1, 0.25)]


@pytest.mark.parametrize(
    "line", ["a.png 4", "a.png 4 1 8 0 0", "a.png 1 8 0 2", "a.png 0 8 0 0", "a.png 1 8 9999 0", "\0 \xff"]
)
def test_an_exposure_list_that_is_not_understood_is_left_aside_and_said(tmp_path, line):
    pixels = np.zeros((24, 32, 3), np.uint8)
    put(tmp_path / "photos", {"a.png": encode_png(pixels), "image_list.txt": line.encode("latin-1")})
    result = import_photos(tmp_path / "photos", tmp_path / "s")
    assert Session.open(tmp_path / "s").shots()[0].reported is None
    assert "image_list.txt, line 1 is not" in result.guesses[0]


def test_an_exposure_list_that_names_no_photo_is_left_aside_and_said(tmp_path):
    put(tmp_path / "photos", {"a.jpg": jpeg(1, time=T), "image_list.txt": b"a.ppm 8 8 0 0"})
    result = import_photos(tmp_path / "photos", tmp_path / "s")
    assert (
        "An exposure list is left aside: image_list.txt names none of the photos: correct the names in it."
        in result.guesses
    )
    assert not any("are those of image_list" in guess for guess in result.guesses)


def test_a_list_that_is_asked_for_speaks_before_exif_and_before_one_that_is_found(tmp_path):
    photos = put(
        tmp_path / "photos",
        {
            "a/1.jpg": jpeg(1, time=T),
            "a/2.jpg": jpeg(2, time=T),
            "b/1.jpg": jpeg(3, time=T),
            "image_list.txt": b"2.jpg 8 8 0 0",
        },
    )
    listed = put(tmp_path, {"my.csv": b"a/1.jpg, 1/2\n/elsewhere/2.jpg, 1/4\nnone.jpg, 1\n"}) / "my.csv"
    result = import_photos(photos, tmp_path / "s", exposures=listed)
    times = {
        Path(s.source).relative_to(photos).as_posix(): s.reported.time
        for s in Session.open(tmp_path / "s").shots()
    }
    assert times == {"a/1.jpg": 1 / 2, "a/2.jpg": 1 / 4, "b/1.jpg": pytest.approx(T)}
    assert f"The exposures of 2 of 3 photos are those of {listed}." in result.guesses
    listed.write_text("1.jpg, 1")
    with pytest.raises(InputError, match=r"names 1\.jpg, which is the name of 2 photos"):
        import_photos(photos, tmp_path / "t", exposures=listed)
    listed.write_text("absent.jpg, 1")
    with pytest.raises(InputError, match="names none of the photos"):
        import_photos(photos, tmp_path / "t", exposures=listed)
    with pytest.raises(InputError, match="cannot be read"):
        import_photos(photos, tmp_path / "t", exposures=tmp_path / "absent.csv")
    assert not (tmp_path / "t").exists()


def test_an_exposure_without_iso_or_aperture_is_told(tmp_path):
    def photo(seed, iso, f_number):
        pixels = np.random.default_rng(seed).integers(0, 256, (24, 32, 3), dtype=np.uint8)
        exposure = Exposure(time=1 / 60, iso=iso, f_number=f_number)
        return encode_jpeg(pixels, metadata=FrameMetadata(make="M", model="N", exposure=exposure))

    cases = {
        "none": [(None, 4), (None, 4)],
        "some": [(None, 4), (200, 4), (None, None)],
        "all": [(100, 4), (200, 4)],
    }
    said = {}
    for name, values in cases.items():
        put(tmp_path / name, {f"{n}.jpg": photo(n, *value) for n, value in enumerate(values)})
        result = import_photos(tmp_path / name, tmp_path / f"S{name}")
        said[name] = [guess for guess in result.guesses if " counts as " in guess]
    assert said == {
        "none": [
            "2 photos have no ISO, which counts as ISO 100, and has to be the same in all; "
            "--exposures FILE gives it."
        ],
        "some": [
            "2 photos have no ISO, which counts as ISO 100, although others have one; "
            "--exposures FILE gives it.",
            "1 photo has no f-number, which counts as f/1, although others have one; "
            "--exposures FILE gives it.",
        ],
        "all": [],
    }
    # what a list tells needs no word
    listed = put(tmp_path, {"l.csv": b"0.jpg, 1/2\n1.jpg, 1/4\n"}) / "l.csv"
    result = import_photos(tmp_path / "none", tmp_path / "T", exposures=listed)
    assert not [guess for guess in result.guesses if " counts as " in guess]
