"""`rig check --repair`: the index is made right again, and nothing outside of the session is touched."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.check.check import check, repair
from capture.imports.photos import import_photos
from capture.record.recorder import record
from imaging.errors import StorageError
from imaging.files.photo import encode_jpeg, encode_png
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import FrameMetadata
from imaging.session.session import Session
from tests.trees import tree

from .index_lines import kinds, lines, write

HOSTILE = [
    "../../etc/passwd",
    "/etc/passwd",
    "raw/../../x",
    "raw/link/passwd",
    "",
    ".",
    "raw",
    "raw/\0",
    "x" * 300,
]


@pytest.mark.parametrize("file", HOSTILE)
def test_a_record_that_leads_out_of_the_session_reads_nothing_and_is_dropped(rig, tmp_path, file):
    (rig.session.folder / "raw" / "link").symlink_to("/etc")
    records = lines(rig.session)
    records[0]["file"] = file
    write(rig.session, records)
    report = check(rig.session.folder)
    first = report.problems[0]
    assert first.kind in ("index", "absent")
    assert report.sound == 17
    done = repair(rig.session.folder)
    assert done.dropped == (file,)
    assert done.added == ("raw/0000/a_0.dng",)
    assert check(rig.session.folder).ok


@given(
    file=st.text(max_size=30)
    | st.from_regex(r"(\.\.|raw|/|\.|0000|a_0\.dng)(/(\.\.|raw|0000|a_0\.dng)){0,4}")
)
@settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
def test_whatever_a_record_names_no_file_outside_is_accepted(rig, file):
    records = lines(rig.session)
    original = records[0]["file"]
    write(rig.session, [records[0] | {"file": file}])
    report = check(rig.session.folder)
    try:
        inside = (rig.session.folder / file).resolve() == (rig.session.folder / original).resolve()
    except ValueError:
        inside = False
    assert report.sound == int(inside and ".." not in file.split("/") and not file.startswith("/"))
    write(rig.session, records)


def test_repair_drops_records_without_file_and_adds_files_without_record(rig):
    folder = rig.session.folder
    records = lines(rig.session)
    (folder / "raw/0000/a_1.dng").unlink()
    index = (folder / "shots.jsonl").read_bytes()
    write(rig.session, records[:-2])
    changed = (folder / "shots.jsonl").read_bytes()
    done = repair(folder)
    assert done.dropped == ("raw/0000/a_1.dng",)
    assert done.added == ("raw/0002/a_2.dng", "raw/0002/b_2.jpg")
    assert done.unrepaired == ()
    assert (folder / done.backup).read_bytes() == changed
    by_file = {record["file"]: record for record in lines(rig.session)}
    for file in done.added:
        original = next(record for record in records if record["file"] == file)
        del original["skew"], original["trigger_delay"]
        for key, value in original.items():
            if key != "reported":
                assert by_file[file][key] == value
        assert by_file[file]["reported"]["time"] == pytest.approx(original["reported"]["time"])
    assert index.count(b"\n") == len(by_file) + 1
    assert kinds(check(folder)) == ["missing"]
    again = repair(folder)
    assert (again.dropped, again.added, again.backup) == ((), (), None)
    assert record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to).taken == 1
    assert check(folder).ok


def test_a_torn_shot_is_set_aside_and_taken_again(rig):
    folder, records = rig.session.folder, lines(rig.session)
    assert records[2]["file"] == "raw/0000/a_1.dng"
    torn = {file: (folder / file).read_bytes()[:-300] for file in ("raw/0000/a_1.dng", "raw/0002/b_2.jpg")}
    for file, data in torn.items():
        (folder / file).write_bytes(data)
    records[2] |= {"developed": "raw/0000/a_1.jpg", "developed_sha256": "0"}
    write(rig.session, records)
    (folder / "raw/0000/a_1.jpg").write_bytes(b"beside")
    (folder / "torn/0000").mkdir(parents=True)
    (folder / "torn/0000/a_1.dng").write_bytes(b"of before")
    mend = "set it aside in torn/ with rig check --repair, and take it again with rig capture --resume."
    assert [one.message.endswith(mend) for one in check(folder).problems if one.kind == "torn"] == [
        True,
        True,
    ]
    done = repair(folder)
    assert (done.dropped, done.added, done.unrepaired) == (tuple(torn), (), ())
    assert {file: data for file, data in tree(folder).items() if file.startswith("torn/")} == {
        "torn/0000/a_1.dng": b"of before",
        "torn/0000/a_1.1.dng": torn["raw/0000/a_1.dng"],
        "torn/0000/a_1.jpg": b"beside",
        "torn/0002/b_2.jpg": torn["raw/0002/b_2.jpg"],
    }
    assert kinds(check(folder)) == ["missing", "missing"]
    assert record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to).taken == 2
    assert check(folder).ok


def test_a_record_of_a_file_that_is_no_shot_is_dropped_and_the_file_stays(rig):
    records = lines(rig.session)
    write(rig.session, [records[0] | {"file": "session.json"}, *records[1:]])
    assert repair(rig.session.folder).dropped == ("session.json",)
    assert check(rig.session.folder).ok


def test_a_torn_import_is_restored_from_its_original(tmp_path):
    (tmp_path / "photos").mkdir()
    pixels = np.random.default_rng(0).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    (tmp_path / "photos" / "a.png").write_bytes(encode_png(pixels))
    import_photos(tmp_path / "photos", tmp_path / "s")
    (shot,) = Session.open(tmp_path / "s").shots()
    path = tmp_path / "s" / shot.file
    path.write_bytes(path.read_bytes()[:-300])
    before = tree(tmp_path / "s")
    assert repair(tmp_path / "s").dropped == ()
    assert tree(tmp_path / "s") == before
    (problem,) = check(tmp_path / "s").problems
    original = problem.message.partition(": restore it from ")[2].removesuffix(".")
    path.write_bytes(Path(original).read_bytes())
    assert check(tmp_path / "s").ok


def test_repair_of_an_import_takes_the_exposures_of_silent_files_from_the_plan(tmp_path):
    (tmp_path / "photos").mkdir()
    for name, code in (("a", 10), ("b", 40), ("c", 160)):
        (tmp_path / "photos" / f"{name}.png").write_bytes(encode_png(np.full((24, 32, 3), code, np.uint8)))
    (tmp_path / "photos" / "image_list.txt").write_text("a.png 8 4 0 0\nb.png 2 4 0 0\nc.png 0.5 4 0 0\n")
    import_photos(tmp_path / "photos", tmp_path / "s")
    session = Session.open(tmp_path / "s")
    before = [(s.identity, s.reported, s.requested) for s in session.shots()]
    assert [s[1].time for s in before] == [1 / 8, 1 / 2, 2]
    (tmp_path / "s" / "shots.jsonl").unlink()
    repair(tmp_path / "s")
    assert [(s.identity, s.reported, s.requested) for s in session.shots()] == before


def test_exposures_of_a_list_are_kept_by_check_and_repair_where_exif_is_wrong(tmp_path):
    """EXIF says half the time of c and f; d is within rounding of its plan, and keeps its own."""
    photos = tmp_path / "photos"
    taken = {"a": 1 / 8, "b": 1 / 2, "c": 1.0, "d": 1 / 8.2, "e": 1 / 2, "f": 1.0}
    photos.mkdir()
    for name, time in taken.items():
        metadata = FrameMetadata(make="A", model="M", exposure=Exposure(time=time, f_number=4, iso=100))
        codes = np.full((24, 32, 3), 90, np.uint8)
        (photos / f"{name}.jpg").write_bytes(encode_jpeg(codes, metadata=metadata))
    (tmp_path / "list.csv").write_text("c.jpg, 2, 4, 100\nf.jpg, 2, 4, 100\n")
    import_photos(photos, tmp_path / "s", exposures=tmp_path / "list.csv", bracket=3)
    session = Session.open(tmp_path / "s")
    before = {shot.identity: shot.reported.time for shot in session.shots()}
    assert list(before.values()) == pytest.approx([1 / 8, 1 / 2, 2, 1 / 8.2, 1 / 2, 2], rel=1e-3)
    assert [look.reported.time for look in check(session).looks] == pytest.approx(list(before.values()))
    (tmp_path / "s" / "shots.jsonl").unlink()
    repair(tmp_path / "s")
    assert {shot.identity: shot.reported.time for shot in session.shots()} == before


def test_an_index_that_is_lost_is_rebuilt_from_the_files(rig):
    folder = rig.session.folder
    shots = {shot.identity: shot for shot in rig.session.shots()}
    (folder / "shots.jsonl").unlink()
    assert len(repair(folder).added) == 18
    rebuilt = {shot.identity: shot for shot in rig.session.shots()}
    assert {i: (s.file, s.sha256, s.requested) for i, s in rebuilt.items()} == {
        i: (s.file, s.sha256, s.requested) for i, s in shots.items()
    }
    assert check(folder).ok


def test_a_damaged_line_hides_no_other(rig):
    folder = rig.session.folder
    text = (folder / "shots.jsonl").read_text().splitlines(keepends=True)
    text[3] = "\x00garbage\n"
    text[7] = text[7].replace('"camera"', '"kamera"')
    (folder / "shots.jsonl").write_text("".join(text))
    report = check(folder)
    assert kinds(report).count("index") == 2
    assert report.sound == 16
    assert "line 4 is not JSON" in report.problems[0].message
    assert "line 8" in report.problems[1].message
    done = repair(folder)
    assert len(done.added) == 2
    assert done.dropped[0] == "shots.jsonl, line 4 is not JSON"
    assert check(folder).ok


def test_repair_takes_no_torn_foreign_or_unplanned_file_and_deletes_none(rig):
    folder = rig.session.folder
    records = lines(rig.session)
    write(rig.session, records[1:])
    good = (folder / "raw/0000/a_0.dng").read_bytes()
    (folder / "raw/0000/a_0.dng").write_bytes(good[:-100])
    strays = {
        "raw/0000/notes.txt": b"mine",
        "raw/0000/a_7.dng": good,
        "raw/0007/a_0.dng": good,
        "raw/0000/c_0.dng": good,
        "raw/0000/b_0.dng": good,
        "raw/x_0.dng": good,
    }
    for name, data in strays.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    before = tree(folder)
    done = repair(folder)
    assert (done.dropped, done.added, done.backup) == ((), (), None)
    assert len(done.unrepaired) == 7
    assert all(
        any(name in sentence for sentence in done.unrepaired)
        for name in [*strays, "raw/0000/a_0.dng"]
        if "c_0" not in name
    )
    assert tree(folder) == before


def test_two_records_of_one_file_become_one(rig):
    records = lines(rig.session)
    records[2]["file"] = records[0]["file"]
    records[2]["sha256"] = records[0]["sha256"]
    write(rig.session, [records[2], *records[:2], *records[3:]])
    assert "duplicate" in kinds(check(rig.session.folder))
    done = repair(rig.session.folder)
    assert done.added == ("raw/0000/a_1.dng",)
    assert check(rig.session.folder).ok


def test_repair_on_a_disk_that_refuses_leaves_the_index_as_it_was(rig, monkeypatch):
    index = rig.session.folder / "shots.jsonl"
    write(rig.session, lines(rig.session)[:-1])
    before = tree(rig.session.folder)

    def refuse(self, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(StorageError):
        repair(rig.session.folder)
    assert tree(rig.session.folder) == before
    assert index.exists()
