import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.imports.photos import import_photos
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_png
from imaging.session.session import Session

from .photo_files import T, dng, jpeg, put, sources


def test_photographs_come_in_byte_for_byte_in_natural_order_and_the_originals_stay(tmp_path):
    names = ["IMG_9.JPG", "IMG_10.JPG", "img_11.jpeg"]
    files = {name: jpeg(n, time=1 / 100, at=10 * n) for n, name in enumerate(names)}
    photos = put(tmp_path / "photos", files)
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in photos.iterdir()}
    result = import_photos(photos, tmp_path / "s")
    assert (result.cameras, result.frames, result.shots, result.missing) == (1, 3, 3, ())
    result.require_complete()
    session = Session.open(tmp_path / "s")
    assert session.record.origin == "import"
    shots = session.shots()
    assert [shot.file for shot in shots] == ["raw/0000/m1_0.jpg", "raw/0001/m1_0.jpg", "raw/0002/m1_0.jpeg"]
    for name, shot in zip(names, shots, strict=True):
        assert session.file(shot).read_bytes() == files[name]
        assert shot.source == str(photos / name)
        assert store.sha256(session.file(shot)) == shot.sha256
        assert shot.requested is None
        assert shot.reported.time == pytest.approx(1 / 100)
        assert (shot.width, shot.height) == (32, 24)
    assert {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in photos.iterdir()} == before


def test_every_kind_of_picture_is_read_and_other_files_are_counted(tmp_path):
    pixels = np.random.default_rng(1).integers(0, 65536, (24, 32, 3), dtype=np.uint16)
    photos = put(
        tmp_path / "photos",
        {
            "a.dng": dng(time=0.1),
            "b/b.png": encode_png(pixels),
            "notes.txt": b"x",
            ".hidden.jpg": b"x",
            "k": b"",
        },
    )
    write_exr(photos / "c" / "c.exr", np.ones((24, 32, 3), np.float32))
    result = import_photos(photos, tmp_path / "s")
    session = Session.open(tmp_path / "s")
    assert {(c.name, c.kind) for c in session.record.cameras} == {("m1", "raw"), ("b", "ldr"), ("c", "hdr")}
    assert result.guesses[0] == "2 files are left aside as no picture that rig reads: k, notes.txt."
    assert {s.camera: s.reported for s in session.shots()}["b"] is None


def test_a_camera_is_a_serial_number_else_make_and_model_else_one_and_sizes_do_not_mix(tmp_path):
    photos = put(
        tmp_path / "photos",
        {
            "x/1.jpg": jpeg(1, time=0.01, serial="7"),
            "x/2.jpg": jpeg(2, time=0.01, serial="8"),
            "y/1.jpg": jpeg(3, time=0.01, serial="7"),
            "y/2.jpg": jpeg(4, time=0.01),
            "y/3.jpg": jpeg(5, time=0.01, size=(20, 24)),
            "left/1.jpg": jpeg(6),
            "right/1.jpg": jpeg(7),
            "2.jpg": jpeg(8),
        },
    )
    result = import_photos(photos, tmp_path / "s")
    session = Session.open(tmp_path / "s")
    mine = {
        c.name: {Path(s.source).relative_to(photos).as_posix() for s in session.shots() if s.camera == c.name}
        for c in session.record.cameras
    }
    assert sorted(map(sorted, mine.values())) == sorted(
        map(
            sorted,
            [
                {"x/1.jpg", "y/1.jpg"},
                {"x/2.jpg"},
                {"y/2.jpg"},
                {"y/3.jpg"},
                {"left/1.jpg", "right/1.jpg", "2.jpg"},
            ],
        )
    )
    assert len({c.serial for c in session.record.cameras}) == 5
    assert mine["photos"] == {"left/1.jpg", "right/1.jpg", "2.jpg"}
    assert result.cameras == 5
    assert any("by the serial numbers 7, 8:" in guess for guess in result.guesses)
    assert any("have no serial number" in guess for guess in result.guesses)


def test_of_a_raw_and_a_jpeg_of_one_name_the_raw_counts(tmp_path):
    photos = put(
        tmp_path / "photos",
        {"IMG_1.DNG": dng(time=0.1), "img_1.jpg": jpeg(time=0.1), "img_2.jpg": jpeg(2, time=0.1)},
    )
    result = import_photos(photos, tmp_path / "s")
    assert sorted(sources(Session.open(tmp_path / "s")).values()) == ["IMG_1.DNG", "img_2.jpg"]
    assert "1 file kept beside RAW files of the same name, but not read." in result.guesses


@pytest.mark.parametrize(
    ("cameras", "groups"),
    [
        (None, [{"x/1.jpg", "y/1.jpg"}, {"x/2.jpg"}]),
        ("serial", [{"x/1.jpg", "y/1.jpg"}, {"x/2.jpg"}]),
        ("folder", [{"x/1.jpg", "x/2.jpg"}, {"y/1.jpg"}]),
        ("one", [{"x/1.jpg", "x/2.jpg", "y/1.jpg"}]),
    ],
)
def test_what_tells_cameras_apart_can_be_chosen(tmp_path, cameras, groups):
    photos = put(
        tmp_path / "photos",
        {
            "x/1.jpg": jpeg(1, time=T, serial="7"),
            "x/2.jpg": jpeg(2, time=T, serial="8"),
            "y/1.jpg": jpeg(3, time=T, serial="7"),
        },
    )
    result = import_photos(photos, tmp_path / "s", cameras=cameras)
    by_camera: dict[str, set[str]] = {}
    for shot in Session.open(tmp_path / "s").shots():
        by_camera.setdefault(shot.camera, set()).add(Path(shot.source).relative_to(photos).as_posix())
    assert sorted(map(sorted, by_camera.values())) == sorted(map(sorted, groups))
    words = "--cameras sorts them otherwise" if cameras is None else "as given"
    (told_of,) = (guess for guess in result.guesses if words in guess)
    assert f"of {len(groups)} cameras" in told_of or len(groups) == 1


def two_cameras(tmp_path, there=range(5), ahead=3600.0) -> Path:
    """Brackets of three at uneven times by cameras 7 and 8; the clock of 8 is `ahead`."""
    begun = [0.0, 41.0, 97.0, 140.0, 203.0]
    files = {
        f"{serial}/{n:02d}_{step}.jpg": jpeg(
            100 * n + 10 * step + int(serial), time=time, at=begun[n] + step + late, serial=serial
        )
        for serial, frames, late in (("7", range(5), 0.0), ("8", there, ahead + 0.4))
        for n in frames
        for step, time in enumerate([T, T / 4, 4 * T])
    }
    return put(tmp_path / "photos", files)


def frames_by_camera(folder: Path) -> dict[str, dict[int, set[str]]]:
    """Numbers in the names of photographs, by camera and frame."""
    frames: dict[str, dict[int, set[str]]] = {}
    for shot in Session.open(folder).shots():
        name = Path(shot.source)
        frames.setdefault(name.parent.name, {}).setdefault(shot.frame, set()).add(name.name[:2])
    return frames


def test_cameras_that_fired_together_share_frames_whatever_their_clocks_say(tmp_path):
    result = import_photos(two_cameras(tmp_path, there=[0, 1, 3, 4]), tmp_path / "s")
    every = {n: {f"{n:02d}"} for n in range(5)}
    assert frames_by_camera(tmp_path / "s") == {"7": every, "8": {n: every[n] for n in (0, 1, 3, 4)}}
    assert {camera.rig for camera in Session.open(tmp_path / "s").record.cameras} == {"rig0"}
    (guess_of_clocks,) = (guess for guess in result.guesses if "fired together" in guess)
    assert "3600 s ahead" in guess_of_clocks
    assert "lacks 1 frame;" in guess_of_clocks
    import_photos(tmp_path / "photos", tmp_path / "t", together="order")
    assert frames_by_camera(tmp_path / "t")["8"] == {0: {"00"}, 1: {"01"}, 2: {"03"}, 3: {"04"}}
    import_photos(tmp_path / "photos", tmp_path / "u", together="never")
    assert set(frames_by_camera(tmp_path / "u")["8"]) == {5, 6, 7, 8}
    assert {camera.rig for camera in Session.open(tmp_path / "u").record.cameras} == {None}


def test_a_counter_that_starts_over_does_not_turn_the_order_round(tmp_path):
    names = ["IMG_9998.jpg", "IMG_9999.jpg", "IMG_0001.jpg", "IMG_0002.jpg"]
    put(tmp_path / "photos", {name: jpeg(n, time=T, at=60 * n) for n, name in enumerate(names)})
    import_photos(tmp_path / "photos", tmp_path / "s")
    assert list(sources(Session.open(tmp_path / "s")).values()) == names


# Any name that Linux allows: all characters but NUL and "/", even bytes that are no UTF-8.
NAMES = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=40)


BYTES = st.binary(min_size=1, max_size=30).filter(lambda name: not set(name) & set(b"/\0")).map(os.fsdecode)


ONE_JPEG = jpeg(1)


@given(folder=NAMES | BYTES, name=NAMES | BYTES)
@settings(max_examples=40, suppress_health_check=list(HealthCheck))
def test_any_name_of_a_file_is_imported_under_a_plain_one(tmp_path_factory, folder, name):
    root = tmp_path_factory.mktemp("names")
    place = root / "photos" / f"x{folder}"
    place.mkdir(parents=True)
    (place / f"y{name}.jpg").write_bytes(ONE_JPEG)
    result = import_photos(root / "photos", root / "s")
    session = Session.open(root / "s")
    (shot,) = session.shots()
    assert session.file(shot).read_bytes() == ONE_JPEG
    assert shot.file == f"raw/0000/{session.record.cameras[0].name}_0.jpg"
    "".join(result.guesses).encode()
    shot.source.encode()


def test_ten_before_nine_and_other_digits_do_not_disturb_the_order(tmp_path):
    names = ["a2.jpg", "a10.jpg", "a٣b.jpg", "b.jpg", "²1.jpg"]
    put(tmp_path / "photos", {name: jpeg(n) for n, name in enumerate(names)})
    import_photos(tmp_path / "photos", tmp_path / "s")
    order = list(sources(Session.open(tmp_path / "s")).values())
    assert order.index("a2.jpg") < order.index("a10.jpg") < order.index("b.jpg")
    assert len(order) == 5
