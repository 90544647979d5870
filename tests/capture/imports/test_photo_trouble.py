"""Imports of damaged files, into folders that cannot be, on disks that refuse."""

import errno
import os

import pytest

from capture.imports.photos import import_photos
from imaging.errors import InputError, PartialError, StorageError
from imaging.session.session import Session
from tests.trees import tree

from .photo_files import T, dng, jpeg, put, sources

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
    with pytest.raises(
        PartialError, match=r"1 of 9 files could not be read .*4\.dng.*: repair it and"
    ) as caught:
        result.require_complete()
    assert caught.value.exit_code == 3
    with pytest.raises(InputError, match="holds this import already, all that can be read: name a new"):
        import_photos(photos, tmp_path / "s")
    names = sources(Session.open(tmp_path / "s"))
    expected = {(n // 3, "m1", n % 3): f"{n}.dng" for n in range(9) if n != 4}
    assert names == expected
    assert len(Session.open(tmp_path / "s").plans()[0].bracket) == 3


def test_a_bad_file_shifts_no_bracket_that_is_given_either(tmp_path):
    put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(6)} | {"1.jpg": b"\xff\xd8\xff"})
    import_photos(tmp_path / "photos", tmp_path / "s", bracket=3)
    names = sources(Session.open(tmp_path / "s"))
    assert {name: (frame, step) for (frame, _, step), name in names.items()} == {
        f"{n}.jpg": (n // 3, n % 3) for n in (0, 2, 3, 4, 5)
    }


@pytest.mark.parametrize(
    ("files", "sentence"),
    [
        ({}, "holds no RAW, JPEG, PNG, TIFF, EXR or HDR"),
        ({"notes.txt": b"x"}, "holds no RAW, JPEG, PNG, TIFF, EXR or HDR"),
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
    with pytest.raises(InputError, match=r"whole holds this import already, complete: name a new folder to"):
        import_photos(photos, tmp_path / "whole")
    with pytest.raises(InputError, match=r"holds no part of this import: name a new folder\.$"):
        import_photos(put(tmp_path / "other", {"a.jpg": jpeg(9, time=T)}), tmp_path / "whole")

    def stop(message, done, total):
        if message.startswith("copying") and done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_photos(photos, tmp_path / "s", on_progress=stop)
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

    result = import_photos(photos, tmp_path / "s", on_progress=remove)
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


def test_a_session_is_not_imported_with_its_renders(tmp_path):
    photos = put(tmp_path / "photos", {f"{n}.jpg": jpeg(n, time=T) for n in range(2)})
    import_photos(photos, tmp_path / "s")
    with pytest.raises(InputError, match=r"s is a session, with .*: name the folder of .*/s/raw\.$"):
        import_photos(tmp_path / "s", tmp_path / "t")
    assert not (tmp_path / "t").exists()
    assert import_photos(tmp_path / "s" / "raw", tmp_path / "t").shots == 2


@pytest.mark.parametrize(
    ("name", "fix"),
    [
        ("a.AVIF", "convert AVIF to JPEG or TIFF"),
        ("b.mov", "a video is imported by itself: rig import VIDEO S"),
    ],
)
def test_pictures_that_are_not_read_are_told_with_what_to_do(tmp_path, name, fix):
    photos = put(tmp_path / "photos", {name: b"x", "notes.txt": b"mine"})
    with pytest.raises(InputError, match=f"holds no RAW, JPEG, PNG, TIFF, EXR or HDR file: {fix}"):
        import_photos(photos, tmp_path / "s")
    put(photos, {"1.jpg": jpeg(1, time=T)})
    result = import_photos(photos, tmp_path / "s")
    assert any(
        f"2 files are left aside as no picture that rig reads: {name}, notes.txt; {fix}" in one
        for one in result.guesses
    )
