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


def test_focus_and_views_are_planned_with_exposures(rig, tmp_path: Path) -> None:
    path, capture = tmp_path / "RIG.toml", ("capture", str(tmp_path / "RIG.toml"), str(tmp_path / "S"))
    assert rig("init", str(path), "--sim", "toy")[0] == 0
    dry = (*capture, "--sim", "toy", "--frames", "1", "--bracket", "0", "--dry-run")
    assert json_of(rig, *dry)["focus"] == {}
    assert "State [subject] and the lenses in the rig file" in rig(*dry)[1]
    text = path.read_text().replace("# nearest", "nearest").replace("# farthest", "farthest")
    path.write_text(text.replace("# [subject]", "[subject]").replace("\n# focal_length", "\nfocal_length", 1))
    code, _, err = rig(*dry)
    assert code == 2
    assert "cam0 has focal_length and no pixel_pitch" in err
    path.write_text(path.read_text().replace("\n# pixel_pitch", "\npixel_pitch", 1))
    plans = json_of(rig, *dry)["focus"]
    assert plans["cam0"]["focus"] == pytest.approx(0.84)
    assert plans["cam0"]["f_number"] == 8
    assert "focal_length (mm) and pixel_pitch (um) are not in the file" in plans["cam1"]
    said = " ".join(rig(*dry)[1].split())
    assert "Focus cam0 at 0.84 m. f/8 blurs the nearest and the farthest by 0.61 px" in said
    assert "Focus of cam1 is not planned" in said


def test_the_lens_of_a_rig_file_is_in_the_session(rig, tmp_path: Path) -> None:
    path, folder = tmp_path / "RIG.toml", tmp_path / "S"
    assert rig("init", str(path), "--sim", "toy")[0] == 0
    text = path.read_text().replace("# focal_length", "focal_length").replace("# pixel_pitch", "pixel_pitch")
    path.write_text(text)
    done = rig("capture", str(path), str(folder), "--sim", "toy", "--frames", "1", "--bracket", "0")
    assert done[0] == 0
    for camera in json.loads((folder / "session.json").read_text())["cameras"]:
        assert (camera["focal_length"], camera["pixel_pitch"]) == (8, 3.45)
