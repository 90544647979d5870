"""Shots that stay on the disk are the shots that memory would hold, whatever happens to their files."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imaging.errors import InputError, StorageError
from imaging.files.photo import encode_png
from imaging.progress import unreported
from imaging.session.calibration import Response
from recon.data import decoded
from recon.data.dataset import View
from recon.data.decoded import StoredPlanes, read_stored
from recon.data.light import StoredImages, radiance_image, radiance_images
from recon.data.load import again, load
from recon.data.pixels import ShotSource, read_shot
from recon.data.shot import Shot
from recon.decide.overrides import Overrides

PLANES = ("pixels", "saturated", "dark", "valid", "alpha")


def stored(session: Path, **settings: int) -> tuple[View, ...]:
    return load(session, examine=lambda firsts, counts: True, **settings).views


def same(one: Shot, other: Shot) -> bool:
    pairs = [(getattr(one, name), getattr(other, name)) for name in PLANES]
    bits = all(
        (a is None and b is None) or (a.dtype == b.dtype and a.tobytes() == b.tobytes()) for a, b in pairs
    )
    facts = ("file", "k", "ceiling", "band", "shape")
    return bits and all(getattr(one, name) == getattr(other, name) for name in facts)


@pytest.fixture(params=["toy", "toy_ldr"])
def session(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return shutil.copytree(request.getfixturevalue(request.param), tmp_path / "session")


@pytest.mark.parametrize("settings", [{}, {"max_width": 24}])
def test_shots_on_the_disk_are_those_in_memory_bit_for_bit(session: Path, settings: dict[str, int]) -> None:
    held = load(session, examine=lambda firsts, counts: False, **settings).views
    for _ in range(2):  # decoded, and found
        for view, on_disk in zip(held, stored(session, **settings), strict=True):
            assert view.held
            assert not on_disk.held
            assert view.sensor.cfa == on_disk.sensor.cfa
            for shot, other in zip(view.shots, on_disk.shots, strict=True):
                assert same(shot, other)
                signal = np.linspace(0, 1, 30, dtype=np.float32).reshape(10, 3)
                noises = [one.noise and one.noise.variance(signal) for one in (shot, other)]
                assert np.array_equal(*noises)
            assert np.array_equal(view.valid, on_disk.valid)
            assert all(map(np.array_equal, radiance_image(view), radiance_image(on_disk)))


def test_a_second_reading_decodes_nothing(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = [shot.pixels for view in stored(session) for shot in view.shots]
    firsts = {view.camera for view in stored(session)}

    def never(*arguments: object) -> None:
        raise AssertionError("decoded again")

    monkeypatch.setattr(decoded, "_written", never)
    after = [shot.pixels for view in stored(session) for shot in view.shots]
    assert firsts
    assert all(map(np.array_equal, before, after))


@pytest.mark.parametrize("all_views", [False, True])
def test_pictures_at_another_width_are_of_the_same_views_and_shots(session: Path, all_views: bool) -> None:
    whole = load(session, all_views=all_views, examine=lambda firsts, counts: True)
    assert all_views == (not whole.held_out)
    asked = Overrides(views=2, exposures=1).subset(whole)
    for part in (whole, asked):
        narrow = again(part, 24, unreported)
        for views, others in ((part.train, narrow.train), (part.held_out, narrow.held_out)):
            assert [view.id for view in views] == [view.id for view in others]
            for view, other in zip(views, others, strict=True):
                assert [shot.file for shot in view.shots] == [shot.file for shot in other.shots]
                assert (other.held, other.lens.width) == (False, 24)


def photo(folder: Path, codes: np.ndarray, name: str = "photo.png") -> ShotSource:
    path = folder / name
    path.write_bytes(encode_png(codes))
    return ShotSource(path, name, "ldr", Response(kind="srgb", evidence="test"))


def codes_of(seed: int, *, dtype: type = np.uint8, channels: int = 3) -> np.ndarray:
    top = np.iinfo(dtype).max
    return np.random.default_rng(seed).integers(0, top, (40, 30, channels), dtype, endpoint=True)


@pytest.mark.parametrize(("dtype", "most"), [(np.uint8, 1.0), (np.uint16, 2.0)])
def test_codes_take_the_bits_that_they_have(tmp_path: Path, dtype: type, most: float) -> None:
    source = photo(tmp_path, np.tile(codes_of(0, dtype=dtype), (10, 10, 1)))
    shot, _ = read_stored(tmp_path / "decoded", source, 2.0)
    assert same(read_shot(source, 2.0)[0], shot)
    with np.load(shot.planes.path) as file:
        assert file["pixels"].nbytes == most * 400 * 300 * 3


@pytest.mark.parametrize("seed", range(3))
def test_any_float_is_given_back_by_its_bits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for values in (
        rng.normal(0, 10.0 ** rng.integers(-6, 6), (50, 40)).astype(np.float32),
        (rng.integers(0, 1 << 14, (50, 40)).astype(np.float32) - 512) / np.float32(15871),
        np.float32([[0.0, -0.0, 1.0]]),
        np.full((3, 4), 0.25, np.float32),
        np.float32([[1e38, -3e38, 0]]),
        np.float32([[np.nan, 1.0, np.inf]]),
        np.float32([[1e-45, 2e-45, 0]]),
    ):
        decoded_values = decoded._decoded(decoded._encoded("a", values), "a")
        assert (decoded_values.dtype, decoded_values.shape) == (values.dtype, values.shape)
        assert decoded_values.tobytes() == values.tobytes()


def test_alpha_stays_with_its_photograph(tmp_path: Path) -> None:
    source = photo(tmp_path, codes_of(1, channels=4))
    held = read_shot(source, 1.0)[0]
    assert held.alpha is not None
    assert same(held, read_stored(tmp_path / "decoded", source, 1.0)[0])


@pytest.mark.parametrize("harm", ["cut off", "a bit", "gone", "emptied", "other"])
def test_what_is_damaged_is_decoded_anew_in_the_midst_of_a_training(tmp_path: Path, harm: str) -> None:
    source = photo(tmp_path, codes_of(2))
    held = read_shot(source, 1.0)[0]
    shot, _ = read_stored(tmp_path / "decoded", source, 1.0)
    path = shot.planes.path
    data = bytearray(path.read_bytes())
    if harm == "cut off":
        path.write_bytes(data[: len(data) // 2])
    elif harm == "a bit":
        data[len(data) // 3] ^= 16  # of the pixels
        path.write_bytes(data)
    elif harm == "gone":
        shutil.rmtree(tmp_path / "decoded")
    elif harm == "emptied":
        path.write_bytes(b"")
    else:
        np.savez(path, pixels=np.zeros((3, 3), np.float32))
    assert same(held, shot)
    assert same(held, read_stored(tmp_path / "decoded", source, 1.0)[0])
    assert path.stat().st_size == len(data)


def test_a_photograph_that_was_replaced_is_never_taken_for_the_old_one(tmp_path: Path) -> None:
    source = photo(tmp_path, codes_of(3))
    old, _ = read_stored(tmp_path / "decoded", source, 1.0)
    before = os.stat(source.path)
    photo(tmp_path, codes_of(4))
    os.utime(source.path, ns=(before.st_atime_ns, before.st_mtime_ns + 1))
    new, _ = read_stored(tmp_path / "decoded", source, 1.0)
    assert same(read_shot(source, 1.0)[0], new)
    assert not old.planes.path.exists()
    with pytest.raises(InputError, match=r"photo.png was changed while it was in use: run again\.$"):
        _ = old.pixels


def test_other_settings_are_other_files(tmp_path: Path) -> None:
    source = photo(tmp_path, codes_of(5))
    narrow = replace(source, max_width=8)
    linear = replace(source, response=Response(kind="linear", evidence="test"), max_width=8)
    keys = {decoded.key_of(one) for one in (source, narrow, linear)}
    assert len(keys) == 3
    whole, _ = read_stored(tmp_path / "decoded", source, 1.0)
    small, _ = read_stored(tmp_path / "decoded", narrow, 1.0)
    before = small.pixels
    other, _ = read_stored(tmp_path / "decoded", linear, 1.0)
    assert whole.shape == (40, 30, 3)
    assert not np.array_equal(before, other.pixels)
    assert whole.planes.path.exists()  # of another width
    assert not small.planes.path.exists()  # of another calibration


def test_a_missing_photograph_is_named(tmp_path: Path) -> None:
    source = photo(tmp_path, codes_of(6))
    source.path.unlink()
    with pytest.raises(InputError, match=r"photo.png cannot be read .*: restore it\.$"):
        read_stored(tmp_path / "decoded", source, 1.0)


def test_a_disk_without_room_is_refused_in_a_sentence(session: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = shutil.disk_usage(session)
    monkeypatch.setattr(decoded.shutil, "disk_usage", lambda folder: usage._replace(free=1000))
    with pytest.raises(StorageError, match=r"decoded takes .* for images .* are free: free some of the disk"):
        stored(session)


def test_light_on_the_disk_is_that_in_memory(session: Path) -> None:
    held = load(session, examine=lambda firsts, counts: False)
    on_disk = load(session, examine=lambda firsts, counts: True)
    light = radiance_images(on_disk)
    assert isinstance(light, StoredImages)
    assert len(light) == len(held.train)
    for one, other in zip(radiance_images(held), light, strict=True):
        assert all(map(np.array_equal, one, other))
    assert np.array_equal(light[1:][0][0], light[1][0])
    assert not list(session.glob("tmp*"))


def test_planes_are_no_longer_in_memory_when_nobody_looks(session: Path) -> None:
    (shot, *_) = stored(session)[0].shots
    assert isinstance(shot.planes, StoredPlanes)
    assert shot.pixels is not shot.pixels
