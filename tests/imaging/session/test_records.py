"""Records are strict about fields, versions and names, and say what is wrong in one sentence."""

from datetime import datetime
from typing import Any

import pytest
from pydantic import ValidationError

from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.record import parse
from imaging.session.records import CameraRecord, PlanRecord, Rung, SessionRecord, ShotRecord

SESSION: dict[str, Any] = {
    "schema_version": 1,
    "name": "demo",
    "created": "2024-05-06T07:08:09",
    "origin": "sim:demo",
    "cameras": [{"name": "c0", "serial": "S0", "kind": "raw"}],
}
SHOT: dict[str, Any] = {
    "kind": "scene",
    "plan": "p1",
    "camera": "c0",
    "frame": 3,
    "step": 1,
    "file": "raw/0003/c0_1.dng",
    "sha256": "00",
    "width": 64,
    "height": 48,
}


def test_a_record_comes_back_from_json() -> None:
    session = parse(SessionRecord, SESSION, "session.json")
    assert session.created == datetime(2024, 5, 6, 7, 8, 9)
    assert parse(SessionRecord, session.model_dump(mode="json"), "session.json") == session
    shot = parse(ShotRecord, {**SHOT, "reported": {"time": 0.5}}, "shots.jsonl")
    assert parse(ShotRecord, shot.model_dump(mode="json", exclude_none=True), "shots.jsonl") == shot
    assert shot.identity == ("p1", "c0", 3, 1)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"colour": "red"}, "colour: extra inputs are not permitted"),
        ({"name": 7}, "name: input should be a valid string"),
        ({"cameras": [{"name": "c0", "serial": "S", "kind": "film"}]}, r"cameras\.0\.kind"),
        ({"cameras": [{"name": "../c0", "serial": "S", "kind": "raw"}]}, r"cameras\.0\.name"),
        ({"created": "yesterday"}, "created"),
        ({"cameras": SESSION["cameras"] * 2}, "cameras: value error, two cameras have the same name"),
    ],
)
def test_a_wrong_field_is_named(change: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as error:
        parse(SessionRecord, {**SESSION, **change}, "session.json")
    text = str(error.value)
    assert text.startswith("session.json: ")
    assert text.endswith("; correct or restore the file.")
    assert "\n" not in text


@pytest.mark.parametrize("version", [0, 2, "1", None, 1.5])
def test_an_unknown_version_is_named(version: object) -> None:
    with pytest.raises(
        InputError, match=r"has schema version .*: open it with the version of rig that wrote it"
    ):
        parse(SessionRecord, {**SESSION, "schema_version": version}, "session.json")


@pytest.mark.parametrize("value", [None, [], "text", 3, {}])
def test_what_is_no_record_is_refused(value: object) -> None:
    with pytest.raises(InputError, match=r"session\.json"):
        parse(SessionRecord, value, "session.json")


@pytest.mark.parametrize("name", ["c0", "Left-2", "a.b_c", "0"])
def test_names_for_files(name: str) -> None:
    assert CameraRecord(name=name, serial="", kind="raw").name == name


@pytest.mark.parametrize(
    "name", ["", ".", "..", "a/b", "a\\b", "-x", ".hidden", "a..b", "a b", "é", "a\n", "a\0"]
)
def test_names_that_could_do_harm(name: str) -> None:
    with pytest.raises(ValidationError):
        CameraRecord(name=name, serial="", kind="raw")
    with pytest.raises(ValidationError):
        ShotRecord(**{**SHOT, "plan": name})
    with pytest.raises(ValidationError):
        PlanRecord(
            plan="p",
            kind="scene",
            created=datetime(2024, 1, 1),
            bracket=(),
            frames=(),
            cameras=(name,),
            reason="",
        )


@pytest.mark.parametrize(
    "change", [{"frame": -1}, {"step": -1}, {"width": 0}, {"retries": -1}, {"skew": float("nan")}]
)
def test_numbers_that_cannot_be(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        ShotRecord(**{**SHOT, **change})


def test_the_best_known_exposure_counts() -> None:
    asked, reported, estimated = Exposure(time=1.0), Exposure(time=1.1), Exposure(time=1.05)
    assert ShotRecord(**SHOT).exposure is None
    assert ShotRecord(**SHOT, requested=asked).exposure == asked
    assert ShotRecord(**SHOT, requested=asked, reported=reported).exposure == reported
    assert ShotRecord(**SHOT, requested=asked, reported=reported, estimated=estimated).exposure == estimated


def test_records_do_not_change() -> None:
    shot = ShotRecord(**SHOT)
    with pytest.raises(ValidationError):
        shot.frame = 4


@pytest.mark.parametrize(
    ("gain", "error", "taken"), [(2.0, 1.0, True), (1.0, 1.0, False), (-1.0, 0.5, False)]
)
def test_a_rung_is_taken_above_one_standard_error(gain: float, error: float, taken: bool) -> None:
    rung = Rung.judged("vignetting", gain, error, "nats", "why")
    assert rung.taken is taken
    assert (rung.gain, rung.standard_error, rung.unit) == (gain, error, "nats")


@pytest.mark.parametrize(("errors", "taken"), [(1.0, True), (2.0, False)])
def test_a_rung_has_to_gain_as_many_standard_errors_as_are_asked(errors, taken):
    assert Rung.judged("lens", 0.15, 0.1, "dB", "tried", errors=errors).taken == taken
