"""`rig doctor --camera`: the examination of one camera as people and programs see it."""

import json
from pathlib import Path

import pytest

from drivers.conformance import EXAMINATIONS

from .refusals import assert_refused

NAMES = [ask.__name__ for ask in EXAMINATIONS]


def test_a_camera_is_examined_and_the_report_can_be_sent(rig) -> None:
    code, out, _ = rig("doctor", "--camera", "SIM-RAW-001", "--sim", "toy", "--json")
    report = json.loads(out)
    assert code == 0
    assert report["in_order"]
    assert report["camera"]["serial"] == "SIM-RAW-001"
    assert [(one["name"], one["verdict"]) for one in report["examinations"]] == [
        (name, "passed") for name in NAMES
    ]
    assert report["versions"]["hdr-rig"]


def test_what_fails_is_named(rig) -> None:
    code, out, err = rig("doctor", "--camera", "SIM-LDR-001", "--sim", "toy-ldr")
    assert code != 0
    assert "failed  frames" in out
    assert "skipped light" in out
    assert f"1 examination of {len(NAMES)} failed: frames." in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--camera", "4711", "--sim", "toy"], "(SIM-RAW-001, SIM-RAW-002 found)"),
        (["--sim", "toy"], "--sim needs --camera"),
        (["--camera", "4711", "--stability"], "separate examinations"),
        (["--camera", "4711", "--sim", "none"], "none"),
    ],
)
def test_what_cannot_be_examined(rig, arguments: list[str], says: str, tmp_path: Path) -> None:
    assert says in assert_refused(rig, ["doctor", *arguments], tmp_path)
