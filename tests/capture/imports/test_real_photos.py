"""Photographs that real cameras took."""

import os
from pathlib import Path

import pytest

from capture.imports.photos import import_photos
from imaging.optics.exposure import Exposure
from imaging.session.session import Session

DATA = os.environ.get("RIG_DATA")


real = pytest.mark.skipif(DATA is None, reason="RIG_DATA is not set: no real photographs")


@real
def test_the_castle_of_sceaux_is_eleven_frames_of_one_camera(tmp_path):
    folder = Path(DATA) / "sceaux"
    result = import_photos(folder, tmp_path / "s")
    assert (result.cameras, result.frames, result.shots, result.missing) == (1, 11, 11, ())
    session = Session.open(tmp_path / "s")
    shots = session.shots()
    assert [Path(s.source).name for s in shots] == [f"100_71{n:02d}.JPG" for n in range(11)]
    assert (shots[0].width, shots[0].height) == (2832, 2128)
    assert shots[0].reported == Exposure(time=1 / 400, f_number=2.8, iso=80)
    assert session.record.cameras[0].kind == "ldr"


@real
def test_the_room_of_the_t2i_is_one_bracket_of_seven(tmp_path):
    result = import_photos(Path(DATA) / "t2i", tmp_path / "s")
    assert (result.cameras, result.frames, result.shots) == (1, 1, 7)
    (plan,) = Session.open(tmp_path / "s").plans()
    assert [e.time for e in plan.bracket] == pytest.approx(
        [2, 1 / 2, 1 / 8, 1 / 30, 1 / 125, 1 / 1000, 1 / 4000]
    )


@real
def test_the_memorial_church_is_one_bracket_of_sixteen_from_its_list(tmp_path):
    result = import_photos(Path(DATA) / "memorial", tmp_path / "s")
    assert (result.cameras, result.frames, result.shots) == (1, 1, 16)
    shots = Session.open(tmp_path / "s").shots()
    assert [s.reported for s in shots] == [Exposure(time=2.0**-n, f_number=8) for n in range(-5, 11)]


@real
def test_a_real_raw_file_is_one_raw_camera(tmp_path):
    result = import_photos(Path(DATA) / "raw", tmp_path / "s")
    assert (result.cameras, result.frames, result.shots) == (1, 1, 1)
    session = Session.open(tmp_path / "s")
    (camera,), (shot,) = session.record.cameras, session.shots()
    assert (camera.kind, camera.model) == ("raw", "Canon EOS Kiss X4")
    assert (shot.width, shot.height, shot.reported) == (1734, 1156, None)
    assert session.file(shot).read_bytes() == (Path(DATA) / "raw" / "colorchart.dng").read_bytes()
