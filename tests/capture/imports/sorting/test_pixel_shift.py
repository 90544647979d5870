"""Pixel shift in a session: four files are one shot, kept beside it byte for byte and hashed."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from capture.check.check import check
from capture.imports.photos import import_photos
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import SimulatedRig, simulate
from imaging.errors import InputError
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.session.session import Session
from tests.drivers.shots import raw_shot

ORDER = ((0, 0), (0, 1), (1, 1), (1, 0))
TIMES = (1 / 250, 1 / 30)


def shifted(rig: SimulatedRig, by: tuple[int, int], frame: int) -> np.ndarray:
    return np.roll(rig.radiance(0, frame), (-by[0], -by[1]), (0, 1))


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two frames of two exposures, each four files of a camera whose sensor moves."""
    folder = tmp_path_factory.mktemp("shifted")
    rig = simulate("toy", cameras=1, positions=2, width=96, height=72, samples=1)
    for frame in range(2):
        for turn, time in enumerate(TIMES):
            for number, by in enumerate(ORDER):
                camera = SimulatedCamera(rig.bodies[0], partial(shifted, rig, by))
                camera.place(frame, 4 * turn + number)
                shot = raw_shot(camera, Exposure(time=time, f_number=4.0, iso=100.0))
                write_dng(folder / f"IMG_{frame}{turn}{number}.dng", shot)
    return folder


def test_four_files_are_one_shot_and_kept_byte_for_byte(photos: Path, tmp_path: Path) -> None:
    result = import_photos(photos, tmp_path / "S", bracket=2, pixel_shift=True)
    assert (result.frames, result.shots, result.missing) == (2, 4, ())
    assert any("Every 4 photographs are a pixel shift, 4 in all" in guess for guess in result.guesses)
    session = Session.open(tmp_path / "S")
    originals = sorted(photos.iterdir())
    files = [name for shot in session.shots() for name in shot.shifted]
    assert [(session.folder / name).read_bytes() for name in files] == [
        path.read_bytes() for path in originals
    ]
    for shot in session.shots():
        raw = read_raw(session.file(shot))
        assert (raw.cfa, raw.pixels.shape) == (None, (72, 96, 3))
        assert shot.reported is not None
        assert shot.reported.time in TIMES
    assert check(session.folder).ok
    (session.folder / files[2]).unlink()
    (session.folder / files[5]).write_bytes(b"another")
    assert {(one.file, one.kind) for one in check(session.folder).problems} == {
        (files[2], "absent"),
        (files[5], "altered"),
    }


def test_an_import_that_was_killed_is_completed(photos: Path, tmp_path: Path) -> None:
    import_photos(photos, tmp_path / "S", bracket=2, pixel_shift=True)
    whole = {path: store.sha256(path) for path in (tmp_path / "S").rglob("*.dng")}
    index = tmp_path / "S" / "shots.jsonl"
    index.write_text("".join(index.read_text().splitlines(keepends=True)[:2]))
    import_photos(photos, tmp_path / "S", bracket=2, pixel_shift=True)
    assert {path: store.sha256(path) for path in (tmp_path / "S").rglob("*.dng")} == whole


def test_files_that_are_no_pixel_shift_are_refused_or_named(photos: Path, tmp_path: Path) -> None:
    some = tmp_path / "some"
    some.mkdir()
    for path in sorted(photos.iterdir())[:7]:
        (some / path.name).write_bytes(path.read_bytes())
    with pytest.raises(InputError, match="7 photographs, no multiple of 4"):
        import_photos(some, tmp_path / "S", pixel_shift=True)
    (some / "IMG_010.dng").unlink()
    for name, path in (("IMG_004.dng", "IMG_000.dng"), ("IMG_020.dng", "IMG_011.dng")):
        raw = read_raw(photos / path)
        write_dng(some / name, replace(raw, metadata=replace(raw.metadata, captured_at=None)))
    with pytest.raises(InputError, match="whose exposure is another"):
        import_photos(some, tmp_path / "S", pixel_shift=True)
    still = tmp_path / "still"
    still.mkdir()
    for number in range(4):
        raw = read_raw(photos / "IMG_000.dng")
        named = replace(raw.metadata, model=f"{raw.metadata.model}{' ' * number}")
        write_dng(still / f"{number}.dng", replace(raw, metadata=named))
    result = import_photos(still, tmp_path / "T", pixel_shift=True)
    assert result.shots == 0
    assert "the sensor did not move" in result.missing[0]


def test_a_group_in_which_something_moved_is_named(photos: Path, tmp_path: Path) -> None:
    some = tmp_path / "some"
    some.mkdir()
    for number in range(4):
        (some / f"{number}.dng").write_bytes((photos / f"IMG_00{number}.dng").read_bytes())
    raw = read_raw(some / "2.dng")
    pixels = raw.pixels.copy()
    pixels[30:42, 40:52] = 3000
    write_dng(some / "2.dng", replace(raw, pixels=pixels))
    result = import_photos(some, tmp_path / "S", pixel_shift=True)
    assert (result.shots, result.missing) == (1, ())
    assert sum("there the first of them is demosaicked alone" in one for one in result.guesses) == 1
    pixels[:, :60] = 3000
    write_dng(some / "2.dng", replace(raw, pixels=pixels))
    result = import_photos(some, tmp_path / "T", pixel_shift=True)
    assert result.shots == 0
    assert "0.dng and the 3 after it" in result.missing[0]
