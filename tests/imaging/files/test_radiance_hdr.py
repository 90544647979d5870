"""Radiance pictures: the light that they mean, or one sentence."""

from pathlib import Path

import colour
import cv2
import imagecodecs
import numpy as np
import pytest
from hypothesis import given, settings

from capture.imports.photos import import_photos
from imaging.compute import memory
from imaging.errors import InputError
from imaging.files.radiance_hdr import read_hdr, read_light
from imaging.session.calibration import Response
from imaging.session.session import Session
from recon.data.pixels import ShotSource, read_shot
from tests.imaging.files.damage import damaged

LIGHT = np.exp2(np.random.default_rng(1).uniform(-12, 12, (12, 20, 3))).astype(np.float32)
HEAD = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 12 +X 20\n"
DATA = bytes(imagecodecs.rgbe_encode(LIGHT))


def put(path: Path, *lines: bytes, data: bytes = DATA) -> Path:
    assert data.startswith(HEAD) or not lines
    extra = b"".join(line + b"\n" for line in lines)
    path.write_bytes(data.replace(b"#?RADIANCE\n", b"#?RADIANCE\n# a remark\n" + extra, 1) if lines else data)
    return path


def test_opencv_reads_the_same(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.hdr"), LIGHT[..., ::-1])
    light = read_light(tmp_path / "a.hdr")
    assert np.array_equal(light, cv2.imread(str(tmp_path / "a.hdr"), cv2.IMREAD_UNCHANGED)[..., ::-1])
    # eight bits beside the largest of the three
    assert (np.abs(light - LIGHT) <= LIGHT.max(-1, keepdims=True) / 127).all()


def test_what_the_header_says_is_divided_out(tmp_path: Path) -> None:
    plain = read_hdr(put(tmp_path / "a.hdr"))
    with_header = put(tmp_path / "b.hdr", b"EXPOSURE=4", b"EXPOSURE= 0.5", b"COLORCORR=1 2 4")
    assert np.allclose(read_hdr(with_header), plain / [2, 4, 8], rtol=1e-6)


def test_other_primaries_are_the_same_light(tmp_path: Path) -> None:
    plain = read_hdr(put(tmp_path / "a.hdr"))
    light = read_hdr(put(tmp_path / "b.hdr", b"PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290"))
    expected = colour.RGB_to_RGB(plain, "ITU-R BT.2020", "ITU-R BT.709", "Bradford")
    assert np.abs(light - expected).max() < 1e-3 * plain.max()
    assert np.array_equal(read_hdr(put(tmp_path / "c.hdr", b"PRIMARIES=1 2 nonsense")), plain)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "is not a Radiance file"),
        (b"P6 nothing", "is not a Radiance file"),
        (HEAD, "damaged or cut off"),
        (DATA[:-4], "damaged or cut off"),
        (DATA.replace(b"-Y 12", b"+Y 12"), "not in rows from the top left"),
        (DATA.replace(b"-Y 12", b"-Y 99"), "damaged or cut off"),
        (DATA.replace(b"rgbe", b"xyze"), "is in XYZE"),
        (DATA.replace(b"\n\n", b"\nEXPOSURE=0\n\n"), "damaged"),
        (DATA.replace(b"-Y 12 +X 20", b"-Y 99999 +X 99999"), "claims 99999x99999 pixels"),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_sentence(tmp_path: Path, data: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        read_hdr(put(tmp_path / "a.hdr", data=data))
    assert str(error.value).startswith(str(tmp_path))
    assert str(error.value).endswith(".")
    with pytest.raises(InputError, match="cannot be read"):
        read_hdr(tmp_path / "none.hdr")


def test_one_larger_than_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "UNASKED", 0)
    monkeypatch.setattr(memory, "available", lambda: 10_000)
    with pytest.raises(InputError, match="has 20x12 pixels, which takes"):
        read_hdr(put(tmp_path / "a.hdr"))


def test_damaged_bytes_never_raise_anything_else(tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("hdr") / "a.hdr"

    @settings(max_examples=150)
    @given(damaged(DATA, 60))
    def damage(wrong: bytes) -> None:
        path.write_bytes(wrong)
        try:
            light = read_hdr(path)
        except InputError:
            return
        assert light.ndim == 3
        assert np.isfinite(light).all()

    damage()


def test_an_import_of_them_is_light(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    big = np.repeat(np.repeat(LIGHT, 2, 0), 2, 1)
    for name, light in (("a.hdr", big), ("b.HDR", 2 * big)):
        (tmp_path / "photos" / name).write_bytes(bytes(imagecodecs.rgbe_encode(light)))
    assert import_photos(tmp_path / "photos", tmp_path / "s").shots == 2
    session = Session.open(tmp_path / "s")
    (camera,) = session.record.cameras
    assert camera.kind == "hdr"
    file = session.file(session.shots()[0])
    shot, _ = read_shot(ShotSource(file, "a", "hdr", Response(kind="linear", evidence="test")), 1.0)
    assert np.array_equal(shot.pixels, read_hdr(file))


def test_a_real_probe(rig_data: Path) -> None:
    path = rig_data / "radiance" / "Grace_Cathedral.hdr"
    expected = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1]
    assert np.array_equal(read_hdr(path), expected)
