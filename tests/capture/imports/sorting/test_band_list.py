"""Photographs through filters: lists of bands, bands by folder and by name, frames of a filter wheel."""

from pathlib import Path

import pytest

from capture.check.repair import repair
from capture.imports.photos import import_photos
from capture.imports.sorting.band_list import bands_of, read_band_list
from imaging.errors import InputError
from imaging.session.records import Band
from imaging.session.session import Session
from tests.capture.imports.photo_files import dng, put

WHEEL = (Band(name="450nm", wavelength_nm=450, bandwidth_nm=40), Band(name="650nm", wavelength_nm=650))


def listed(folder: Path, text: str = "450nm, 450, 40\n650nm, 650  # red\n\n") -> Path:
    path = folder / "bands.txt"
    path.write_text(text)
    return path


def test_a_list_of_bands(tmp_path: Path) -> None:
    assert read_band_list(listed(tmp_path)) == WHEEL
    assert read_band_list(listed(tmp_path, "h-alpha")) == (Band(name="h-alpha"),)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("450nm, blue", r"line 1 of .*bands\.txt names no band"),
        ("a\n450nm, 450, 40, 3", "line 2 of"),
        ("450nm, -3", "line 1 of"),
        ("../x", "line 1 of"),
        ("a\nA", "names a band twice"),
        ("# none", "names 0 bands"),
        ("\n".join(f"b{number}" for number in range(17)), "names 17 bands: name 1 to 16"),
    ],
)
def test_what_is_no_list_of_bands_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_band_list(listed(tmp_path, text))


def test_the_band_is_a_folder_or_a_word_of_the_name() -> None:
    home = Path("photos")
    paths = [home / "450nm" / "a.tif", home / "b_650NM_2.tif", home / "x" / "650nm" / "cam0" / "c.tif"]
    assert list(bands_of(home, paths, WHEEL).values()) == ["450nm", "650nm", "650nm"]
    for name, said in (("1450nm.tif", "of no band"), ("450nm/d_650nm.tif", "of 450nm and 650nm")):
        with pytest.raises(InputError, match=said):
            bands_of(home, [home / name], WHEEL)


def test_a_band_whose_name_is_part_of_another_s_is_another_band() -> None:
    home, bands = Path("photos"), (Band(name="red"), Band(name="red-edge"))
    paths = [home / "red" / "a.tif", home / "Red-Edge" / "a.tif", home / "b_red.tif", home / "b_red-edge.tif"]
    assert list(bands_of(home, paths, bands).values()) == ["red", "red-edge", "red", "red-edge"]
    with pytest.raises(InputError, match="of red and red-edge"):
        bands_of(home, [home / "red" / "b_red-edge.tif"], bands)


def wheel_photos(folder: Path, frames: int = 2) -> Path:
    """Photographs of one camera without a serial number: two exposures of each band at each frame."""
    return put(
        folder,
        {
            f"{band}/cam0/{frame}_{step}.dng": dng(
                10 * frame + step,
                time=(0.01, 0.1)[step],
                at=100.0 * frame + 10 * turn + step,
                make="",
                model="",
            )
            for turn, band in enumerate(("450nm", "650nm"))
            for frame in range(frames)
            for step in range(2)
        },
    )


def test_a_wheel_is_one_camera_whose_frames_have_every_band(tmp_path: Path) -> None:
    photos = wheel_photos(tmp_path / "photos")
    result = import_photos(photos, tmp_path / "s", bracket=2, bands=listed(tmp_path))
    session = Session.open(tmp_path / "s")
    assert session.record.bands == WHEEL
    assert (result.cameras, result.frames, result.shots) == (1, 2, 8)
    bands = {
        (shot.frame, shot.step): (shot.band, shot.exposure and shot.exposure.time) for shot in session.shots()
    }
    for frame in range(2):
        assert [bands[frame, step] for step in range(4)] == [
            ("450nm", 0.01), ("450nm", 0.1), ("650nm", 0.01), ("650nm", 0.1),
        ]  # fmt: skip
    for shot in session.shots():
        assert shot.source is not None
        assert f"{shot.band}/cam0/{shot.frame}_" in shot.source


def test_a_band_with_a_frame_less_is_named(tmp_path: Path) -> None:
    photos = wheel_photos(tmp_path / "photos")
    for step in range(2):
        (photos / "650nm" / "cam0" / f"1_{step}.dng").unlink()
    with pytest.raises(InputError, match="unequal numbers of frames, 2 of 450nm, 1 of 650nm"):
        import_photos(photos, tmp_path / "s", bracket=2, bands=listed(tmp_path))


def test_an_import_without_bands_has_none(tmp_path: Path) -> None:
    import_photos(wheel_photos(tmp_path / "photos"), tmp_path / "s")
    session = Session.open(tmp_path / "s")
    assert session.record.bands == ()
    assert {shot.band for shot in session.shots()} == {None}


def test_a_repair_knows_the_bands_of_a_wheel_again(tmp_path: Path) -> None:
    import_photos(wheel_photos(tmp_path / "photos"), tmp_path / "s", bracket=2, bands=listed(tmp_path))
    session = Session.open(tmp_path / "s")
    before = {shot.identity: shot.band for shot in session.shots()}
    assert set(before.values()) == {"450nm", "650nm"}
    (tmp_path / "s" / "shots.jsonl").unlink()
    repair(tmp_path / "s")
    assert {shot.identity: shot.band for shot in session.shots()} == before
