import shutil

import numpy as np
import pytest

from capture.check.check import CheckReport, check, repair
from capture.check.findings import ShotLook
from capture.check.picture_warnings import warnings
from capture.imports.photos import import_photos
from capture.record.recorder import record
from imaging.errors import InputError
from imaging.files import store
from imaging.files.exr.writing import write_exr
from imaging.files.photo import encode_jpeg, encode_png
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import RawMosaic
from imaging.session.session import Session
from tests.trees import tree

from ..imports.photo_files import jpeg, put
from .index_lines import kinds, lines, write


def test_a_sound_session_has_no_problem_and_is_not_changed(rig):
    before = tree(rig.session.folder)
    steps = []
    report = check(rig.session.folder, on_progress=lambda message, done, total: steps.append((done, total)))
    assert report.ok
    assert (report.planned, report.shots, report.sound) == (18, 18, 18)
    assert steps == [(n, 18) for n in range(19)]
    assert tree(rig.session.folder) == before
    parsed = CheckReport.model_validate_json(report.model_dump_json())
    assert parsed == report.model_copy(update={"thumbnails": {}})
    groups = {(e.camera, e.exposure.time): e for e in report.exposures}
    assert set(groups) == {(camera, e.time) for camera in "ab" for e in rig.plan.bracket}
    assert all(e.shots == 3 for e in groups.values())
    assert [e.exposure.time for e in report.exposures[:3]] == [1 / 8, 1 / 32, 1 / 128]
    assert groups["b", 1 / 8].max_skew == pytest.approx(0.004)


def test_clipped_and_black_shares_count_each_photosite_for_its_own_colour(fake_rig):
    rig = fake_rig(a="raw")
    record(rig.session, rig.plan, rig.cameras, move_to=rig.move_to)
    pixels = np.full((24, 32), 1000, np.uint16)
    pixels[0::2, 0::2][:3] = 4095  # a quarter of the red sites, phase RGGB
    pixels[0::2, 1::2][:6, :4] = 4095  # an eighth of the greens
    pixels[1::2, 1::2] = 64  # all blue at black
    data = encode_dng(RawMosaic(pixels, Cfa.RGGB, ((64.0,),), 4095))
    records = lines(rig.session)
    (rig.session.folder / records[0]["file"]).write_bytes(data)
    records[0]["sha256"] = store.sha256(rig.session.folder / records[0]["file"])
    records[0]["requested"]["time"] = 1 / 2
    write(rig.session, records)
    exposed = check(rig.session.folder).exposures[0]
    assert exposed.exposure.time == 1 / 2
    assert exposed.shots == 1
    assert exposed.clipped == pytest.approx((0.25, 24 / 384, 0.0))
    assert exposed.black == pytest.approx(0.25)


def test_of_a_photograph_the_top_code_is_clipped_and_zero_is_black(tmp_path):
    pixels = np.full((24, 32, 3), 100, np.uint8)
    pixels[:12, :, 0], pixels[:6, :, 2] = 255, 0
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.png").write_bytes(encode_png(pixels))
    import_photos(tmp_path / "photos", tmp_path / "s")
    (exposed,) = check(tmp_path / "s").exposures
    assert exposed.clipped == pytest.approx((0.5, 0.0, 0.0))
    assert exposed.black == pytest.approx(0.25 / 3)


DAMAGE = {
    "absent": lambda path: path.unlink(),
    "torn": lambda path: path.write_bytes(path.read_bytes()[:-300]),
    "altered": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
}


@pytest.mark.parametrize("kind", DAMAGE)
@pytest.mark.parametrize("file", ["raw/0001/a_2.dng", "raw/0001/b_2.jpg"])
def test_a_file_that_is_not_as_recorded_is_named_with_its_mend(rig, kind, file):
    DAMAGE[kind](rig.session.folder / file)
    report = check(rig.session.folder)
    (problem,) = report.problems
    assert (problem.kind, problem.file) == (kind, file)
    assert (problem.camera, problem.frame, problem.step) == (file[9], 1, 2)
    assert file in problem.message
    assert ": " in problem.message
    assert problem.message.endswith(".")
    assert report.sound == 17


def test_one_flipped_bit_is_found(rig):
    path = rig.session.folder / "raw/0000/a_0.dng"
    data = bytearray(path.read_bytes())
    data[-100] ^= 1
    path.write_bytes(data)
    assert kinds(check(rig.session.folder)) == ["altered"]


def test_missing_shots_strays_leftovers_and_duplicates_are_named(rig):
    folder = rig.session.folder
    records = lines(rig.session)
    write(rig.session, records[:-1])  # its file is now a stray, its shot missing
    (folder / "raw" / "0000" / ".a_9.dng.part").write_bytes(b"half")
    (folder / "raw" / "0000" / "notes.txt").write_bytes(b"mine")
    shutil.copy(folder / "raw/0000/a_0.dng", folder / "raw/0000/a_1.dng")
    records[2]["sha256"] = records[0]["sha256"]
    write(rig.session, records[:-1])
    report = check(folder)
    assert sorted((p.kind, p.file) for p in report.problems if p.kind != "exposure") == [
        ("duplicate", "raw/0000/a_1.dng"),
        ("leftover", "raw/0000/.a_9.dng.part"),
        ("missing", ""),
        ("stray", "raw/0000/notes.txt"),
        ("stray", "raw/0002/b_2.jpg"),
    ]
    assert [p.file for p in report.problems if p.kind == "exposure"] == ["raw/0000/a_1.dng"]
    missing = next(p for p in report.problems if p.kind == "missing")
    assert (missing.camera, missing.frame, missing.step) == ("b", 2, 2)


def test_an_exposure_that_the_file_does_not_confirm_is_named(rig):
    records = lines(rig.session)
    assert records[0]["reported"]["time"] == 1 / 8
    records[0]["requested"]["time"] = 1 / 10
    write(rig.session, records)
    (problem,) = check(rig.session.folder).problems
    assert (problem.kind, problem.file) == ("exposure", records[0]["file"])
    assert "1/8 s ISO 100 where 1/10 s ISO 100 was asked for (+0.32 stops)" in problem.message


def test_cameras_that_did_not_expose_together_are_named(rig):
    records = lines(rig.session)
    records[1]["skew"] = 0.5
    write(rig.session, records)
    (problem,) = check(rig.session.folder).problems
    assert (problem.kind, problem.camera) == ("skew", "b")
    assert "500 ms" in problem.message


@pytest.mark.parametrize(("tolerance", "expected"), [(0.001, 1), (None, 0), (0.6, 0)])
def test_what_is_together_is_what_the_plan_says(rig, tolerance, expected):
    plans = store.read_lines(rig.session.folder / "plans.jsonl")
    (rig.session.folder / "plans.jsonl").unlink()
    store.append_line(rig.session.folder / "plans.jsonl", plans[0] | {"tolerance": tolerance})
    records = lines(rig.session)
    for line in records:
        line["skew"] = 0.0
    records[1]["skew"] = 0.5 if tolerance == 0.6 else 0.01
    write(rig.session, records)
    problems = check(rig.session.folder).problems
    assert len(problems) == expected
    assert all(one.kind == "skew" and "1 ms are allowed" in one.message for one in problems)


def test_records_of_unknown_cameras_and_plans_are_named(rig):
    records = lines(rig.session)
    records[0]["camera"] = "z"
    records[1]["plan"] = "other"
    write(rig.session, records)
    report = check(rig.session.folder)
    assert kinds(report) == ["index", "index", "missing", "missing"]
    assert "'z', which is not a camera of the session" in report.problems[0].message
    assert report.problems[1].message.startswith("plans.jsonl lacks the plan other of its scene shot: ")


def test_a_lost_plan_is_named_once(rig):
    (rig.session.folder / "plans.jsonl").unlink()
    (problem,) = check(rig.session.folder).problems
    assert (problem.kind, problem.file) == ("index", "plans.jsonl")
    assert problem.message == (
        "plans.jsonl lacks the plan scene of its 18 scene shots: restore it from a copy."
    )


def test_a_shot_beyond_its_plan_is_named(rig):
    records = lines(rig.session)
    records[0]["step"] = 9
    write(rig.session, records)
    report = check(rig.session.folder)
    assert kinds(report) == ["index", "missing"]
    assert "belongs to no plan" in report.problems[0].message


def test_a_folder_that_is_no_session_is_an_input_error(tmp_path):
    for action in (check, repair):
        for folder in (tmp_path, tmp_path / "absent"):
            with pytest.raises(InputError):
                action(folder)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_plan_is_a_problem_and_not_the_end(rig):
    (rig.session.folder / "plans.jsonl").write_text("nonsense\n")
    report = check(rig.session.folder)
    assert kinds(report) == ["index"]
    assert report.sound == 18


def test_a_shot_that_had_to_be_repeated_is_late_without_being_a_problem(rig):
    records = lines(rig.session)
    records[1] |= {"skew": 2.0, "retries": 1}
    write(rig.session, records)
    report = check(rig.session.folder)
    assert report.ok
    (warning,) = [one for one in report.warnings if one.kind == "skew"]
    assert "had to be taken again, 2 s" in warning.message
    assert max(step.skew for step in report.skews) == 2.0


POISON = {
    "black": np.zeros((40, 48, 3), np.uint8),
    "white": np.full((40, 48, 3), 255, np.uint8),
    "grey": np.full((40, 48, 3), 99, np.uint8),
    "a pixel": np.full((1, 1, 3), 99, np.uint8),
    "a row": np.full((1, 300, 3), 99, np.uint8),
    "a column": np.full((300, 2, 3), 99, np.uint8),
    "noise": np.random.default_rng(0).integers(0, 256, (40, 48, 3), dtype=np.uint8),
}


@pytest.mark.parametrize("name", POISON)
def test_pictures_that_show_nothing_are_checked_without_a_finding(tmp_path, name):
    """Three times the same picture, but for one sample, under three exposures; white ones are clipped."""
    (tmp_path / "photos").mkdir()
    for number in range(3):
        pixels = POISON[name].copy()
        pixels[0, 0, 0] = number
        (tmp_path / "photos" / f"{number}.png").write_bytes(encode_png(pixels))
    (tmp_path / "photos" / "image_list.txt").write_text("0.png 8 4 0 0\n1.png 2 4 0 0\n2.png 0.5 4 0 0\n")
    import_photos(tmp_path / "photos", tmp_path / "s")
    report = check(tmp_path / "s")
    assert report.ok
    assert report.sound == 3
    messages = [warning.message for warning in report.warnings if warning.kind != "label"]
    assert messages == (
        ["The shortest exposure still clips 100 % of its samples: add a shorter one to keep the highlights."]
        if name == "white"
        else []
    )
    assert len(report.thumbnails) == 3


def test_light_without_numbers_is_checked(tmp_path):
    (tmp_path / "photos").mkdir()
    light = np.full((40, 48, 3), np.nan, np.float32)
    light[:20] = np.inf
    write_exr(tmp_path / "photos" / "a.exr", light)
    import_photos(tmp_path / "photos", tmp_path / "s")
    report = check(tmp_path / "s")
    assert (report.sound, report.warnings) == (1, ())


@pytest.mark.parametrize("shade", [0, 255])
def test_exposures_that_are_black_or_white_all_over_are_no_duplicates(rig, shade):
    records = lines(rig.session)
    for one in records:
        if one["step"] == 0 and one["camera"] == "b":
            path = rig.session.folder / one["file"]
            path.write_bytes(encode_jpeg(np.full((24, 32, 3), shade, np.uint8)))
            one["sha256"] = store.sha256(path)
    write(rig.session, records)
    assert "duplicate" not in kinds(check(rig.session.folder))
    first = rig.session.folder / next(
        one["file"] for one in records if one["step"] == 0 and one["camera"] == "b"
    )
    first.write_bytes(encode_jpeg(np.full((24, 32, 3), [shade, 90, 200], np.uint8)))
    assert kinds(check(rig.session.folder)) == ["altered"]


def test_highlights_that_no_exposure_holds_are_a_warning():
    """In the words of the calibration's report, whose rule it is."""

    def look(step, time, clipped, picture="raw"):
        return ShotLook(
            kind="scene", picture=picture, file=f"{step}", camera="a", frame=0, step=step, clipped=clipped,
            width=640, height=480, requested=None, reported=Exposure(time=time), black=0.0, lit=0.0,
        )  # fmt: skip

    long, short = look(0, 1.0, (0.9, 0.9, 0.9)), look(1, 0.1, (0.2, 0.1, 0.0))
    (warning,) = warnings([long, short], ())
    assert warning.message == (
        "The shortest exposure still clips 10 % of its samples: add a shorter one to keep the highlights."
    )
    assert not list(warnings([long, look(1, 0.1, (0.01, 0.001, 0.0))], ()))


def test_an_import_is_spoken_of_by_the_names_of_the_user(tmp_path):
    put(tmp_path / "photos", {f"{home}/DSC_{n}.JPG": jpeg(n) for home in "ab" for n in range(2)})
    folder = tmp_path / "s"
    import_photos(tmp_path / "photos", folder, cameras="folder")
    report = check(folder)
    (first, *_, last) = sorted({shot.file for shot in Session.open(folder).shots()})
    assert set(report.sources.values()) == {f"{home}/DSC_{n}.JPG" for home in "ab" for n in range(2)}
    assert [problem.kind for problem in report.problems] == ["duplicate", "duplicate"]
    assert report.problems[1].message.startswith(f"{last} (b/DSC_1.JPG) is the same file as ")
    assert report.problems[1].message.endswith(
        ": take b/DSC_1.JPG out of the photographs and import them again into a new folder."
    )
    assert report.problems[1].file == last
    import_photos(tmp_path / "photos" / "a", tmp_path / "t")
    assert set(check(tmp_path / "t").sources.values()) == {"DSC_0.JPG", "DSC_1.JPG"}
    (folder / last).unlink()
    (folder / first).unlink()
    assert kinds(check(folder)) == ["absent", "absent"]
