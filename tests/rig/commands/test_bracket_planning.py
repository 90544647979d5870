"""`rig capture --bracket auto` and the table of `--dry-run`."""

import json
from pathlib import Path

import pytest


def json_of(rig, *arguments: str) -> dict:
    code, out, err = rig(*arguments, "--json")
    assert (code, err) == (0, "")
    return json.loads(out)


def test_the_dry_run_of_an_automatic_bracket_is_what_is_then_shot(rig, tmp_path: Path) -> None:
    folder = tmp_path / "S"
    auto = ("capture", "--sim", "toy", str(folder), "--frames", "1", "--bracket", "auto", "--slowest", "1/8")
    planned = json_of(rig, *auto, "--dry-run")
    assert not folder.exists()
    taken = json_of(rig, *auto)
    assert taken["taken"] == planned["shots"] == 2 * len(planned["bracket"])
    plan = json.loads((folder / "plans.jsonl").read_text())
    assert plan["bracket"] == [one["exposure"] for one in planned["exposures"]]
    assert plan["reason"] == planned["reason"]
    assert planned["not_reached"]
    assert all(line in plan["reason"] for line in planned["not_reached"])


def test_every_exposure_has_its_worth_by_camera_and_for_the_rig(rig, tmp_path: Path) -> None:
    value = json_of(rig, "capture", "--sim", "toy", str(tmp_path / "S"), "--dry-run", "--bracket", "auto")
    assert (value["not_reached"], value["metered"]["failed"]) == ([], {})
    assert len(value["metered"]["ranges"]) == 2 * 3
    rows = [one["worth"] for one in value["exposures"]]
    for row in rows:
        assert set(row) == {"cam0", "cam1", "rig"}
        assert row["rig"]["snr_db"] == min(row["cam0"]["snr_db"], row["cam1"]["snr_db"])
        assert row["rig"]["headroom_stops"] == min(row[c]["headroom_stops"] for c in ("cam0", "cam1"))
    # The longest shows the dark end, the shortest the bright one.
    assert rows[-1]["rig"]["snr_db"] >= 20
    assert rows[0]["rig"]["headroom_stops"] >= 0
    snr = [row["rig"]["snr_db"] for row in rows]
    assert snr == sorted(snr)


def test_a_given_bracket_has_the_same_table(rig, tmp_path: Path) -> None:
    folder = str(tmp_path / "S")
    arguments = ("capture", "--sim", "toy", folder, "--frames", "1", "--dry-run", "--bracket", "-4,0")
    value = json_of(rig, *arguments)
    code, out, _ = rig(*arguments)
    assert code == 0
    for one in value["exposures"]:
        worth = one["worth"]["rig"]
        cell = f"{worth['snr_db']:6.1f} {worth['headroom_stops']:+7.1f}"
        assert sum(line.endswith(cell) for line in out.splitlines()) == 1
    stops = (
        value["exposures"][1]["worth"]["rig"]["headroom_stops"]
        - value["exposures"][0]["worth"]["rig"]["headroom_stops"]
    )
    assert stops == pytest.approx(-4, abs=0.2)


def test_cameras_that_develop_their_photographs_are_planned_for_with_the_assumption_told(
    rig, tmp_path
) -> None:
    folder = tmp_path / "S"
    auto = ("capture", "--sim", "toy-ldr", str(folder), "--frames", "1", "--bracket", "auto", "--snr", "15")
    value = json_of(rig, *auto, "--dry-run")
    assert "of cam0, cam1 the codes 10 to 245 are taken as usable" in value["reason"]
    assert value["not_reached"] == []
    assert 2 <= len(value["bracket"]) <= 5
    taken = json_of(rig, *auto)
    assert taken["taken"] == value["shots"] == 2 * len(value["bracket"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--snr", "30"], "--snr only limits a bracket that is planned"),
        (["--bracket", "0,3", "--slowest", "1/4"], "--slowest only limits"),
        (["--bracket", "auto", "--slowest", "fast"], "write a shutter time as 1/30, 0.5 or 2s"),
        (["--bracket", "auto", "--slowest", "1/0"], "write a shutter time"),
        (["--bracket", "auto", "--slowest", "1/20000"], "no exposure is 1/20000 s or shorter"),
        (["--bracket", "auto", "--total", "1/9000"], "no bracket fits into 0.000111111 s in all"),
        (["--bracket", "auto", "--highest-iso", "50"], "no ISO is 50 or lower"),
    ],
)
def test_limits_that_cannot_be_kept_are_said(rig, tmp_path, arguments: list[str], words: str) -> None:
    code, out, err = rig("capture", "--sim", "toy", str(tmp_path / "S"), "--frames", "1", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_shutter_times_are_read_as_cameras_show_them() -> None:
    from rig.options.common import shutter

    assert [shutter(text) for text in ("1/30", "0.5", "2s", " 1/8 s ")] == [1 / 30, 0.5, 2.0, 1 / 8]
