import errno
import os
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.photos import import_photos
from imaging import store
from imaging.cfa import Cfa
from imaging.dng import encode_dng
from imaging.errors import InputError, PartialError, StorageError
from imaging.exposure import Exposure
from imaging.exr import write_exr
from imaging.mosaic import FrameMetadata, RawMosaic
from imaging.photo import encode_jpeg, encode_png
from imaging.session import Session, brackets

DATA = os.environ.get("RIG_DATA")
real = pytest.mark.skipif(DATA is None, reason="RIG_DATA is not set: no real photographs")
NOON = datetime(2026, 5, 1, 12, 0, 0)


def metadata(time=None, at=0.0, serial="", model="M1", f_number=4.0, make="Maker"):
    exposure = None if time is None else Exposure(time=time, f_number=f_number, iso=100)
    when = None if at is None else NOON + timedelta(seconds=at)
    return FrameMetadata(make=make, model=model, serial=serial, exposure=exposure, captured_at=when)


def jpeg(seed=0, size=(24, 32), **said) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)
    return encode_jpeg(pixels, metadata=metadata(**said) if said else None)


def dng(seed=0, size=(24, 32), **said) -> bytes:
    pixels = np.random.default_rng(seed).integers(0, 4096, size, dtype=np.uint16)
    return encode_dng(RawMosaic(pixels, Cfa.RGGB, (64.0,) * 4, 4095, metadata=metadata(**said)))


def put(folder: Path, files: dict[str, bytes]) -> Path:
    for name, data in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return folder


def tree(folder: Path) -> dict[str, bytes]:
    return {
        p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def sources(session: Session) -> dict[tuple[int, str, int], str]:
    return {(s.frame, s.camera, s.step): Path(s.source).name for s in session.shots()}


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


def test_a_camera_is_a_serial_number_else_make_and_model_else_a_folder_and_sizes_do_not_mix(tmp_path):
    photos = put(
        tmp_path / "photos",
        {
            "x/1.jpg": jpeg(1, time=0.01, serial="7"),
            "x/2.jpg": jpeg(2, time=0.01, serial="8"),
            "y/1.jpg": jpeg(3, time=0.01, serial="7"),
            "y/2.jpg": jpeg(4, time=0.01),
            "y/3.jpg": jpeg(5, time=0.01, size=(32, 24)),
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
                {"left/1.jpg"},
                {"right/1.jpg"},
                {"2.jpg"},
            ],
        )
    )
    assert len({c.serial for c in session.record.cameras}) == 7
    assert mine["left"] == {"left/1.jpg"}
    assert mine["photos"] == {"2.jpg"}
    assert result.cameras == 7
    assert any("by the serial number 7" in guess for guess in result.guesses)
    assert any("tell no serial number" in guess for guess in result.guesses)


def test_of_a_raw_and_a_jpeg_of_one_name_the_raw_counts(tmp_path):
    photos = put(
        tmp_path / "photos",
        {"IMG_1.DNG": dng(time=0.1), "img_1.jpg": jpeg(time=0.1), "img_2.jpg": jpeg(time=0.1)},
    )
    result = import_photos(photos, tmp_path / "s")
    assert sorted(sources(Session.open(tmp_path / "s")).values()) == ["IMG_1.DNG", "img_2.jpg"]
    assert "1 file is left aside because a RAW file of the same name is there." in result.guesses


def shoot(tmp_path, times, gap=1.0, **said) -> dict[str, bytes]:
    """A series with a clock that runs; None in `times` is a pause of two minutes."""
    files, at = {}, 0.0
    for time in times:
        at += gap if time is not None else 120.0
        if time is not None:
            files[f"{len(files):03d}.jpg"] = jpeg(len(files), time=time, at=at, **said)
    return put(tmp_path / "photos", files)


def frames_of(tmp_path, **options) -> list[int]:
    """Lengths of the brackets in order of frames."""
    import_photos(tmp_path / "photos", tmp_path / "s", **options)
    return [len(group) for group in brackets(Session.open(tmp_path / "s").shots()).values()]


T = 1 / 60
GUESSES = {
    "three by three": ([T, T / 4, 4 * T] * 3, [3, 3, 3]),
    "three by three, moved by auto exposure": (
        [T, T / 4, 4 * T, 1.5 * T, 1.5 * T / 4, 6 * T, T / 1.7, T / 6.8, 4 * T / 1.7],
        [3, 3, 3],
    ),
    "one series by hand": ([2.0, 0.5, 1 / 8, 1 / 30, 1 / 125, 1 / 1000], [6]),
    "one camera bracket": ([T, T / 4, 4 * T], [3]),
    "the same exposure": ([T] * 6, [1] * 6),
    "auto exposure that wanders": ([T, T / 1.3, T * 1.2, T, T / 1.6, T * 1.1], [1] * 6),
    "two photos": ([T, T / 4], [1, 1]),
    "pairs, three times": ([T, T / 8] * 3, [2, 2, 2]),
    "brackets, then singles after a pause": ([T, T / 4, 4 * T, None, T, T, T, T], [3, 1, 1, 1, 1]),
    "a third of a stop is no bracket": ([T, T / 1.26, T * 1.26] * 2, [1] * 6),
    "one bracket is incomplete": ([T, T / 4, 4 * T, T, T / 4, 4 * T, T, T / 4], [1] * 8),
}


@pytest.mark.parametrize("name", GUESSES)
def test_brackets_are_guessed_from_exposure_and_time(tmp_path, name):
    times, lengths = GUESSES[name]
    shoot(tmp_path, times)
    assert frames_of(tmp_path) == lengths


def test_a_pause_within_a_bracket_makes_single_frames(tmp_path):
    shoot(tmp_path, [T, None, T / 4, None, 4 * T])
    assert frames_of(tmp_path) == [1, 1, 1]


def test_another_aperture_is_no_bracket(tmp_path):
    put(
        tmp_path / "photos",
        {f"{n}.jpg": jpeg(n, time=T, at=n, f_number=f) for n, f in enumerate((2.8, 5.6, 11.0))},
    )
    assert frames_of(tmp_path) == [1, 1, 1]


def test_a_bracket_that_is_given_wins_over_the_guess(tmp_path):
    shoot(tmp_path, [T, T / 4, 4 * T] * 3)
    assert frames_of(tmp_path, bracket=2) == [2, 2, 2, 2, 1]
    session = Session.open(tmp_path / "s")
    plans = {len(plan.bracket): plan for plan in session.plans()}
    assert plans[2].frames == (0, 1, 2, 3)
    assert plans[1].frames == (4,)
    assert plans[2].bracket == (None, None)  # the frames do not agree


def test_the_plan_states_the_exposures_that_all_frames_share(tmp_path):
    shoot(tmp_path, [T, T / 4, 4 * T] * 3)
    result = import_photos(tmp_path / "photos", tmp_path / "s")
    (plan,) = Session.open(tmp_path / "s").plans()
    assert [exposure.time for exposure in plan.bracket] == pytest.approx([T, T / 4, 4 * T], rel=1e-3)
    assert plan.frames == (0, 1, 2)
    assert "3 brackets of 3" in result.guesses[-1]
    assert plan.reason == result.guesses[-1]


def test_an_exposure_list_speaks_for_photographs_without_exif(tmp_path):
    rows = [("a.png", 4, 0.25), ("b.png", 1, 1), ("c.png", 0.25, 4), ("absent.png", 1, 1)]
    text = "# Filename exposure 1/shutter f/stop gain ND\n" + "".join(
        f"{n} {t} {s} 8 0 0\n" for n, t, s in rows
    )
    pixels = np.random.default_rng(1).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    files = {name: encode_png(pixels + np.uint8(n)) for n, name in enumerate(("a.png", "b.png", "c.png"))}
    put(tmp_path / "photos", files | {"image_list.txt": text.encode()})
    import_photos(tmp_path / "photos", tmp_path / "s")
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
    found: dict[str, set[str]] = {}
    for shot in Session.open(tmp_path / "s").shots():
        found.setdefault(shot.camera, set()).add(Path(shot.source).relative_to(photos).as_posix())
    assert sorted(map(sorted, found.values())) == sorted(map(sorted, groups))
    told = "--cameras sorts them otherwise" if cameras is None else "as given"
    assert sum(told in guess for guess in result.guesses) == len(groups)


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
    """By camera and frame, the number in the names of its photos."""
    found: dict[str, dict[int, set[str]]] = {}
    for shot in Session.open(folder).shots():
        name = Path(shot.source)
        found.setdefault(name.parent.name, {}).setdefault(shot.frame, set()).add(name.name[:2])
    return found


def test_cameras_that_fired_together_share_frames_whatever_their_clocks_say(tmp_path):
    result = import_photos(two_cameras(tmp_path, there=[0, 1, 3, 4]), tmp_path / "s")
    every = {n: {f"{n:02d}"} for n in range(5)}
    assert frames_by_camera(tmp_path / "s") == {"7": every, "8": {n: every[n] for n in (0, 1, 3, 4)}}
    assert {camera.rig for camera in Session.open(tmp_path / "s").record.cameras} == {"rig0"}
    (told,) = (guess for guess in result.guesses if "fired together" in guess)
    assert "3600 s ahead" in told
    assert "lacks 1 frame;" in told
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


BAD = {
    "text": b"This is no picture.\n",
    "empty": b"",
    "truncated": dng(9, time=T / 4)[:-200],
    "header only": dng(9, time=T / 4)[:700],
}


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_file_is_named_and_does_not_shift_the_brackets_after_it(tmp_path, bad):
    files = {f"{n}.dng": dng(n, time=[T, T / 4, 4 * T][n % 3], at=n) for n in range(9)}
    photos = put(tmp_path / "photos", files | {"4.dng": BAD[bad]})
    result = import_photos(photos, tmp_path / "s")
    assert len(result.missing) == 1
    assert "4.dng" in result.missing[0]
    assert result.shots == 8
    with pytest.raises(PartialError, match=r"1 of 9 photos are missing .*4\.dng") as caught:
        result.require_complete()
    assert caught.value.exit_code == 3
    found = sources(Session.open(tmp_path / "s"))
    expected = {(n // 3, "m1", n % 3): f"{n}.dng" for n in range(9) if n != 4}
    assert found == expected
    assert len(Session.open(tmp_path / "s").plans()[0].bracket) == 3


def test_a_bad_file_shifts_no_bracket_that_is_given_either(tmp_path):
    put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(6)} | {"1.jpg": b"\xff\xd8\xff"})
    import_photos(tmp_path / "photos", tmp_path / "s", bracket=3)
    found = sources(Session.open(tmp_path / "s"))
    assert {name: (frame, step) for (frame, _, step), name in found.items()} == {
        f"{n}.jpg": (n // 3, n % 3) for n in (0, 2, 3, 4, 5)
    }


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ({}, "holds no RAW, JPEG, PNG, TIFF or EXR"),
        ({"notes.txt": b"x"}, "holds no RAW, JPEG, PNG, TIFF or EXR"),
        ({"a.dng": b"text"}, r"holds no photograph that can be read \(.*a\.dng"),
        (
            {"a.dng": b"text", "b.jpg": b"", "c.exr": b"1", "d.png": b"2", "e.tif": b"3"},
            r"a\.dng.*; and 2 more",
        ),
    ],
)
def test_nothing_usable_is_an_input_error_and_leaves_nothing(tmp_path, files, sentence):
    (tmp_path / "photos").mkdir()
    put(tmp_path / "photos", files)
    with pytest.raises(InputError, match=sentence):
        import_photos(tmp_path / "photos", tmp_path / "new" / "s")
    assert {path.name for path in tmp_path.iterdir()} == {"photos"}


def test_folders_that_cannot_be_are_refused(tmp_path):
    photos = put(tmp_path / "photos", {"a.jpg": jpeg()})
    (tmp_path / "link").symlink_to(photos)
    full = put(tmp_path / "full", {"notes.txt": b"mine"})
    for folder, out, sentence in (
        (tmp_path / "absent", tmp_path / "s", "is not a folder"),
        (photos / "a.jpg", tmp_path / "s", "is not a folder"),
        (photos, photos, "lies inside"),
        (photos, photos / "s", "lies inside"),
        (photos, tmp_path / "link" / "s", "lies inside"),
        (photos, full, "is not empty"),
        (photos, full / "notes.txt", "is a file"),
        (photos, full / "notes.txt" / "s", "is a file"),
    ):
        with pytest.raises(InputError, match=sentence):
            import_photos(folder, out)
    with pytest.raises(InputError, match="a bracket of 0"):
        import_photos(photos, tmp_path / "s", bracket=0)
    assert {p.name for p in tmp_path.iterdir()} == {"photos", "link", "full"}
    assert tree(full) == {"notes.txt": b"mine"}
    assert set(tree(photos)) == {"a.jpg"}


def test_a_finished_import_is_not_empty_and_a_killed_one_is_completed(tmp_path):
    photos = put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(4)})
    import_photos(photos, tmp_path / "whole")
    with pytest.raises(InputError, match="not empty"):
        import_photos(photos, tmp_path / "whole")

    def stop(message, done, total):
        if message.startswith("copying") and done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_photos(photos, tmp_path / "s", progress=stop)
    assert len(Session.open(tmp_path / "s").shots()) == 2
    other = put(tmp_path / "other", {f"{n}.jpg": jpeg(n + 9, time=T) for n in range(4)})
    with pytest.raises(InputError, match="not empty"):
        import_photos(other, tmp_path / "s")
    assert import_photos(photos, tmp_path / "s").shots == 4
    assert tree(tmp_path / "s" / "raw") == tree(tmp_path / "whole" / "raw")


def test_a_photo_that_vanishes_before_it_is_copied_is_listed(tmp_path):
    photos = put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(4)})

    def remove(message, done, total):
        if message == "copying 1.jpg":
            (photos / "2.jpg").unlink()

    result = import_photos(photos, tmp_path / "s", progress=remove)
    assert result.shots == 3
    assert result.missing == (f"{photos / '2.jpg'} could not be read (no such file or directory)",)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
@pytest.mark.parametrize("moment", range(1, 9))
@pytest.mark.parametrize("there", [False, True])
def test_a_disk_that_refuses_leaves_nothing_behind(tmp_path, monkeypatch, code, moment, there):
    photos = put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(4)})
    before = tree(photos)
    if there:
        (tmp_path / "s").mkdir()
    calls = 0
    fsync = os.fsync

    def refuse(descriptor):
        nonlocal calls
        calls += 1
        if calls == 2 * moment:
            raise OSError(code, "refused")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", refuse)
    with pytest.raises(StorageError, match="could not be written"):
        import_photos(photos, tmp_path / "s")
    assert (tmp_path / "s").exists() == there
    assert tree(tmp_path) == {f"photos/{name}": data for name, data in before.items()}


# Any name that Linux allows: all characters but NUL and "/", even bytes that are no UTF-8.
NAMES = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=40)
BYTES = st.binary(min_size=1, max_size=30).filter(lambda name: not set(name) & set(b"/\0")).map(os.fsdecode)
ONE_JPEG = jpeg(1)


@given(folder=NAMES | BYTES, name=NAMES | BYTES)
@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
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
