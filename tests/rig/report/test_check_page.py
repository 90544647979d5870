"""check/report.html and check/check.json: they say what was found, and nothing in a session breaks them."""

import base64
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from capture.check.check import check
from capture.check.findings import CheckReport, Problem, ShotLook
from capture.imports.photos import import_photos
from imaging.errors import StorageError
from imaging.files import store
from imaging.files.photo import encode_jpeg
from imaging.optics.exposure import Exposure
from rig.report.pages.check import MOST_ROWS, check_report
from tests.capture.imports.photo_files import jpeg, put

from .pages import Page, assert_self_contained


def json_of(rig, *arguments: str) -> dict:
    return json.loads(rig(*arguments, "--json")[1])


def pixels(picture: dict[str, str | None]) -> np.ndarray:
    data = base64.b64decode((picture["src"] or "").split(",", 1)[1])
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)


def test_check_writes_every_shot_with_its_three_exposures(rig, toy: Path) -> None:
    value = json_of(rig, "check", str(toy))
    assert value["exit_code"] == 0
    assert value["report"] == str(toy / "check" / "report.html")
    stored = store.read_json(toy / "check" / "check.json")
    for key in ("looks", "exposures", "problems", "warnings", "skews", "sound"):
        assert stored[key] == value[key]
    assert "thumbnails" not in stored
    page = Page.read(toy / "check" / "report.html")
    assert_self_contained(page)
    assert len(page.all("img")) == 18
    assert page.text.count("asked") >= 18
    assert "18 of 18 shots intact" in page.text
    assert "no picture gives cause for doubt" in page.text
    (look,) = [one for one in value["looks"] if one["file"] == "raw/0001/cam0_1.dng"]
    # The simulated shutter takes 1/60 s for 1/64 s.
    assert look["reported"]["time"] == pytest.approx(1 / 60)
    assert look["estimated"]["time"] == pytest.approx(1 / 64, rel=0.02)
    assert abs(look["off"]) < 0.03


def test_the_bound_of_a_skew_that_is_unknown_is_told(rig, toy: Path) -> None:
    """Use two cameras that stamp no frames; b had opened its shutter at the latest after 0.31 s."""
    path = toy / "shots.jsonl"
    shots = [json.loads(line) for line in path.read_text().splitlines()]
    for shot in shots:
        late = 0.31 if shot["camera"] == "cam1" else 0.12
        shot |= {"skew": None, "trigger_delay": 0.0, "skew_bound": late}
    path.write_text("".join(json.dumps(shot) + "\n" for shot in shots))
    code, out, _ = rig("check", str(toy))
    assert code == 0
    assert "skew unknown, at most 310 ms: cam0, cam1 do not say when their shutters open" in out
    page = Page.read(toy / "check" / "report.html")
    assert "unknown of cam0, cam1, at most 310 ms" in page.text


def test_checking_again_changes_nothing_that_others_read(rig, toy: Path) -> None:
    before = {path: path.read_bytes() for path in toy.rglob("*") if path.is_file()}
    json_of(rig, "check", str(toy))
    json_of(rig, "check", str(toy))
    after = {path: path.read_bytes() for path in toy.rglob("*") if path.is_file()}
    assert {path for path in after if path not in before} == {
        toy / "check" / name for name in ("check.json", "report.html")
    }
    assert all(after[path] == data for path, data in before.items())


def test_a_session_that_cannot_be_written_is_checked_all_the_same(rig, toy: Path, monkeypatch) -> None:
    def refuse(path: Path, data: bytes) -> None:
        raise StorageError(f"{path} cannot be written: free the disk.")

    monkeypatch.setattr("imaging.files.store.write_bytes", refuse)
    code, out, err = rig("check", str(toy))
    assert (code, err) == (0, "")
    assert "18 of 18 shots sound" in out
    assert "no contact sheet" in out


def test_what_was_found_is_on_the_page_and_on_the_shot(rig, toy: Path) -> None:
    (toy / "raw" / "0000" / "cam0_0.dng").unlink()
    path = toy / "raw" / "0001" / "cam1_2.dng"
    path.write_bytes(path.read_bytes()[:-100])
    value = json_of(rig, "check", str(toy))
    assert value["exit_code"] == 3
    page = Page.read(toy / "check" / "report.html")
    assert_self_contained(page)
    assert len(page.all("img")) == 16
    assert page.text.count("no picture") == 2
    for problem in value["problems"]:
        assert problem["message"] in page.text
    titles = [one["title"] for one in page.all("span") if one.get("title")]
    assert sorted(titles) == sorted(problem["message"] for problem in value["problems"])


def test_a_shot_of_an_import_has_the_name_of_the_user_s_file(tmp_path: Path) -> None:
    import_photos(put(tmp_path / "photos", {"DSC_7.JPG": jpeg()}), tmp_path / "s")
    page = Page.read(check_report(tmp_path / "s", check(tmp_path / "s")))
    assert "fromDSC_7.JPG" in "".join(page.text.split())


def test_clipped_pixels_are_painted_over(toy: Path) -> None:
    report = check(toy)
    page = Page.read(check_report(toy, report))
    pictures = {(one["alt"] or ""): pixels(one) for one in page.all("img")}
    painted = {
        name: float(np.mean(np.abs(pixels - (255, 0, 150)).max(-1) < 60)) for name, pixels in pictures.items()
    }
    looks = {f"{one.camera}, frame {one.frame}, step {one.step}": one for one in report.looks}
    assert painted.keys() == looks.keys()
    assert max(painted.values()) > 0.02
    for name, share in painted.items():
        assert share <= sum(looks[name].clipped) + 0.02
        assert share > 0 or max(looks[name].clipped) < 0.03


def many(count: int, problems: int = 0) -> CheckReport:
    """A report of so many shots, of four cameras and seven exposures."""
    noise = np.random.default_rng(0).integers(0, 255, (107, 160, 3), dtype=np.uint8)
    picture = encode_jpeg(cv2.GaussianBlur(noise, (0, 0), 1.5), 72)
    looks = [
        ShotLook(
            kind="scene",
            picture="raw",
            file=f"raw/{number}.dng",
            camera=f"cam{number % 4}",
            frame=number // 28,
            step=number // 4 % 7,
            width=160,
            height=107,
            requested=Exposure(time=0.25**step),
            reported=Exposure(time=0.25**step),
            clipped=(0.0, 0.0, 0.0),
            black=0.0,
            lit=1.0,
        )
        for number, step in ((number, number // 4 % 7) for number in range(count))
    ]
    problems = [
        Problem(kind="stray", file=f"raw/x{n}", message=f"raw/x{n} is a stray.") for n in range(problems)
    ]
    return CheckReport(
        session="s",
        planned=count,
        shots=count,
        sound=count,
        exposures=(),
        problems=tuple(problems),
        looks=tuple(looks),
        thumbnails={look.file: picture for look in looks},
    )


def test_a_large_session_makes_a_page_that_a_browser_can_hold(toy: Path) -> None:
    path = check_report(toy, many(560, problems=500))
    assert path.stat().st_size < 10e6
    page = Page.read(path)
    assert_self_contained(page)
    assert len(page.all("img")) == 560
    assert all(one["loading"] == "lazy" for one in page.all("img"))
    assert "open" not in page.all("details")[-1]
    assert page.text.count("is a stray") == MOST_ROWS
    assert "300 more" in page.text


def test_nothing_from_a_session_is_ever_markup(toy: Path) -> None:
    evil = "</style><script>alert('x')</script><img src=http://x onerror=alert(1)>\"'"
    session = store.read_json(toy / "session.json")
    store.write_json(toy / "session.json", session | {"name": evil})
    report = check(toy)
    problem = Problem(kind="stray", file=evil, camera=evil, frame=0, step=0, message=evil)
    looks = tuple(look.model_copy(update={"camera": evil}) for look in report.looks)
    page = Page.read(check_report(toy, report.model_copy(update={"problems": (problem,), "looks": looks})))
    assert_self_contained(page)
    assert "<script>alert('x')" in page.text
