"""The focal length of metadata in pixels, against cameras whose pitch is published."""

import hashlib
import math
from datetime import UTC, datetime

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from calib.sensor.focal_length import focal_length, rig_focal_length, sensor_width
from calib.sensor.metadata import describe
from imaging.files.photo import encode_jpeg, read_metadata
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.records import CameraRecord, SessionRecord, ShotRecord
from imaging.session.session import Session


def stated(width, height, **tags):
    focal = focal_length(FrameMetadata(**tags), width, height)
    assert focal is not None
    return focal


def test_an_equivalent_refers_to_the_diagonal():
    """An iPhone 7 of 28 mm equivalent has 3.99 mm on a pitch of 1.22 um."""
    focal = stated(4032, 3024, focal_length_35mm=28.0)
    assert focal.px == pytest.approx(3.99 / 1.22e-3, rel=0.01)
    assert 0.02 < focal.spread < 0.04


@pytest.mark.parametrize(("width", "height"), [(4000, 2250), (2250, 4000)])
def test_a_wide_picture_may_be_cut_from_a_taller_sensor(width, height):
    """A DJI FC300S of 20 mm equivalent has 3.6 mm on 6.17 mm of 4000 pixels, of which 16:9 is a part."""
    focal = stated(width, height, focal_length_35mm=20.0)
    true = 3.6 / 6.17 * 4000
    assert abs(focal.px / true - 1) < 2 * focal.spread
    assert focal.spread > stated(4000, 3000, focal_length_35mm=20.0).spread


def test_millimetres_count_where_the_file_or_a_table_tells_the_sensor():
    assert stated(6000, 4000, focal_length_mm=50.0, sensor_mm=36.0).px == pytest.approx(50 / 36 * 6000)
    assert sensor_width("DJI", "FC300S") == pytest.approx(6.17, rel=0.01)
    named = stated(4000, 3000, focal_length_mm=3.61, make="DJI", model="FC300S")
    assert named.px == pytest.approx(3.61 / 6.17 * 4000, rel=0.01)
    assert focal_length(FrameMetadata(focal_length_mm=3.6, make="No", model="Body"), 100, 100) is None
    assert sensor_width("", "") is None


def test_two_tellings_are_one_between_them_and_no_surer():
    both = stated(4000, 2250, focal_length_35mm=20.0, focal_length_mm=3.6, make="DJI", model="FC300S")
    one = stated(4000, 2250, focal_length_35mm=20.0)
    other = stated(4000, 2250, focal_length_mm=3.6, make="DJI", model="FC300S")
    assert one.px < both.px < other.px
    assert both.spread == min(one.spread, other.spread)
    assert "20 mm equivalent" in both.words
    assert "3.6 mm on a sensor" in both.words
    assert f"{both.px:.0f} px" in both.words


def test_what_contradicts_itself_is_spread_wide():
    """A table that has another sensor of the same name would be off by half."""
    focal = stated(6000, 4000, focal_length_35mm=75.0, focal_length_mm=50.0, sensor_mm=36.0)
    plain = stated(6000, 4000, focal_length_35mm=75.0)
    assert focal.px == plain.px
    assert focal.spread > math.log(1.5) / 2


def test_digital_zoom_lengthens_millimetres_and_widens_the_equivalent():
    """Some cameras count it in their equivalent, and some do not."""
    zoomed = stated(6000, 4000, focal_length_mm=50.0, sensor_mm=36.0, digital_zoom=2.0)
    assert zoomed.px == pytest.approx(100 / 36 * 6000)
    with_it = stated(6000, 4000, focal_length_35mm=50.0, digital_zoom=2.0)
    for true in (50.0, 100.0):
        assert abs(math.log(with_it.px / (true / 36 * 6000))) < 1.2 * with_it.spread
    once = stated(6000, 4000, focal_length_35mm=50.0, digital_zoom=1.0)
    assert once.px == stated(6000, 4000, focal_length_35mm=50.0).px


def test_nothing_is_told_by_nothing():
    assert focal_length(FrameMetadata(), 100, 100) is None
    assert focal_length(FrameMetadata(focal_length_35mm=1e6, focal_length_mm=1e6), 100, 100) is None


@pytest.mark.parametrize(("unit", "inch"), [(2, 1.0), (3, 2.54), (4, 25.4)])
def test_the_sensor_is_what_the_resolution_in_the_focal_plane_says(tmp_path, unit, inch):
    """Read 3,888 pixels over 22.2 mm, in three units, whatever the file was scaled to."""
    exif = Image.Exif()
    tags = exif.get_ifd(0x8769)
    dense = IFDRational(round(3888 / 22.2 * 25.4 / inch * 1000), 1000)
    tags |= {37386: IFDRational(50, 1), 41486: dense, 41487: dense, 41488: unit, 40962: 3888, 40963: 2592}
    tags[41988] = IFDRational(3, 2)
    path = tmp_path / "a.jpg"
    Image.new("RGB", (96, 64)).save(path, exif=exif)
    metadata = read_metadata(path)
    assert metadata.sensor_mm == pytest.approx(22.2, rel=1e-3)
    assert metadata.digital_zoom == 1.5
    px = stated(96, 64, focal_length_mm=50.0, sensor_mm=metadata.sensor_mm).px
    assert px == pytest.approx(50 / 22.2 * 96, rel=1e-3)
    tags[41486] = tags[41487] = IFDRational(0, 1)
    Image.new("RGB", (96, 64)).save(path, exif=exif)
    assert read_metadata(path).sensor_mm is None


def test_a_lens_of_the_rig_file_counts_where_the_picture_states_none(tmp_path):
    """An acA2440 (Sony IMX250, 3.45 um) behind a lens of 8 mm; a file that states its own is nearer to it."""
    camera = CameraRecord(name="cam0", serial="1", kind="ldr", focal_length=8.0, pixel_pitch=3.45)
    focal = rig_focal_length(camera)
    assert focal.px == pytest.approx(8.0 / 3.45e-3)
    assert 0.02 < focal.spread < 0.05
    assert focal.words == "2319 px (8 mm before photosites 3.45 um apart, by the rig file)"
    assert rig_focal_length(camera.model_copy(update={"pixel_pitch": None})) is None
    session = Session.create(
        tmp_path, SessionRecord(name="S", created=datetime.now(UTC), origin="RIG.toml", cameras=(camera,))
    )
    for said, expected in ((FrameMetadata(), 2319), (FrameMetadata(focal_length_35mm=26.0), 49)):
        data = encode_jpeg(np.zeros((48, 64), np.uint8), metadata=said)
        (tmp_path / "a.jpg").write_bytes(data)
        shot = ShotRecord(
            kind="scene",
            plan="scene",
            camera="cam0",
            frame=0,
            step=0,
            file="a.jpg",
            width=64,
            height=48,
            sha256=hashlib.sha256(data).hexdigest(),
        )
        sensor = describe(session, camera, shot)
        assert sensor.focal is not None
        assert sensor.lens.fx == sensor.focal.px
        assert round(sensor.focal.px) == pytest.approx(expected, abs=1)
