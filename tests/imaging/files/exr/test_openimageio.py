"""EXR files as OpenImageIO reads them: Arnold, Blender's compositor and most pipelines read by it."""

from datetime import datetime
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from imaging.files.exr.camera import camera_attributes, capture_date, film_attributes
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import EXPOSURE_FACTOR, white_luminance, write_exr
from imaging.optics.exposure import Exposure

oiio = pytest.importorskip("OpenImageIO")
LIGHT = np.exp(np.random.default_rng(3).normal(0, 4, (24, 40, 3))).astype(np.float32)


def parts(path: Path) -> list[tuple[object, np.ndarray]]:
    """Header and pixels of each part of a file."""
    file = oiio.ImageInput.open(str(path))
    assert file is not None, oiio.geterror()
    read = []
    while file.seek_subimage(len(read), 0):
        read.append((file.spec(), file.read_image(len(read), 0, 0, file.spec().nchannels, "float")))
    file.close()
    return read


def test_light_is_bit_for_bit_what_was_written(tmp_path: Path) -> None:
    light = LIGHT.copy()
    light[0, 0], light[1, 1], light[2, 2] = np.nan, np.inf, 2.0**60
    write_exr(tmp_path / "a.exr", light, attributes=white_luminance(80.0, 2.0))
    ((spec, pixels),) = parts(tmp_path / "a.exr")
    assert spec.channelnames == ("R", "G", "B")
    assert np.array_equal(pixels, light, equal_nan=True)
    assert spec.getattribute("oiio:ColorSpace") == "lin_rec709_scene"
    assert spec.getattribute("whiteLuminance") == 80.0


def test_half_and_dwaa_lose_what_they_may(tmp_path: Path) -> None:
    light = LIGHT.clip(1e-3, 6e4)
    for storage, most in (("half", 2.0**-11), ("dwaa", 0.3)):
        write_exr(tmp_path / f"{storage}.exr", light, storage=storage)
        ((spec, pixels),) = parts(tmp_path / f"{storage}.exr")
        assert spec.format == oiio.HALF
        assert np.abs(pixels / light - 1).max() <= most
        assert np.array_equal(pixels, read_exr(tmp_path / f"{storage}.exr").rgb())


def test_parts_of_data_stand_behind_the_light(tmp_path: Path) -> None:
    sigma = {"sigma.R": LIGHT[..., 0], "mask": np.eye(24, 40, dtype=np.float32)}
    write_exr(tmp_path / "a.exr", LIGHT, data={"data": sigma})
    (light, pixels), (data, planes) = parts(tmp_path / "a.exr")
    assert (light.getattribute("name"), data.getattribute("name")) == ("light", "data")
    assert np.array_equal(pixels, LIGHT)
    for index, name in enumerate(data.channelnames):
        assert np.array_equal(planes[..., index], sigma[name])
    assert data.getattribute("oiio:ColorSpace") == "data"


def test_exposure_camera_and_time_have_the_names_that_programs_look_for(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1.0, -2.0, 5.0
    K = np.array([[60.0, 0, 20], [0, 60.0, 12], [0, 0, 1]])
    attributes = {EXPOSURE_FACTOR: 0.25} | camera_attributes(pose, K, (40, 24)) | film_attributes(3723, 24.0)
    attributes |= capture_date(datetime(2026, 3, 4, 5, 6, 7))
    exposure = Exposure(time=0.125, f_number=4.0, iso=200.0)
    write_exr(tmp_path / "a.exr", LIGHT, exposure=exposure, attributes=attributes)
    ((spec, _),) = parts(tmp_path / "a.exr")
    assert spec.getattribute("ExposureTime") == 0.125
    assert spec.getattribute("FNumber") == 4.0
    assert spec.getattribute("DateTime") == "2026:03:04 05:06:07"
    assert spec.getattribute("rig:exposureFactor") == 0.25
    assert spec.getattribute("pinholeFocalLength") == pytest.approx(54.0)
    rate = spec.getattribute("FramesPerSecond")
    assert Fraction(*rate) == 24 if isinstance(rate, tuple) else rate == pytest.approx(24)
    to_camera = np.reshape(spec.getattribute("worldtocamera"), (4, 4))
    assert np.allclose([0, 0, 0, 1] @ to_camera, [1.0, 2.0, 5.0, 1.0])
    assert spec.getattribute("smpte:TimeCode")[0] == 0x00023503  # digits of 00:02:35:03
