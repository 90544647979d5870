"""`rig capture --bracket auto` and the table of `--dry-run`."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from capture.bracket.metering.meter import Metering
from capture.bracket.planner import Target
from capture.bracket.raw_noise import RawNoise
from capture.record.forecast import Forecast
from capture.record.shooting import Rehearsal
from imaging.optics.exposure import Exposure
from imaging.sensor.noise import SensorNoise
from imaging.session.records import PlanRecord
from rig.cameras import rehearsal

from .test_capture import json_of

NOISE = RawNoise(SensorNoise(gain=1.0, read_noise=3.0), 3839.0)
NOTHING = Forecast(0.0, 0.0, 0, 0, {}, 0, "nothing", 0)


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
        cells = [
            f"{one['worth'][name]['snr_db']:6.1f} {one['worth'][name]['headroom_stops']:+7.1f}"
            for name in ("rig", "cam0", "cam1")
        ]
        assert sum(line.endswith("  ".join(cells)) for line in out.splitlines()) == 1
    stops = (
        value["exposures"][1]["worth"]["rig"]["headroom_stops"]
        - value["exposures"][0]["worth"]["rig"]["headroom_stops"]
    )
    assert stops == pytest.approx(-4, abs=0.2)


def worth_lines(targets: list[Target], times: list[float]) -> list[str]:
    """The lines that a dry run says of a bracket; the first two are the head."""
    exposures = tuple(Exposure(time=time) for time in times)
    plan = PlanRecord.model_construct(bracket=exposures)
    metering = Metering(tuple(targets), exposures, {})
    done = Rehearsal(record=plan, size=None, metering=metering, forecast=NOTHING)
    return rehearsal._worth(done)[1]


def test_the_worst_of_cameras_that_are_too_many_for_a_line_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    few = [Target(f"cam{n}", "G", NOISE, 0.001 * (n + 1), 10.0 * (n + 1)) for n in range(4)]
    many = [Target(f"cam{n}", "G", NOISE, 0.001 * (n + 1), 10.0 * (n + 1)) for n in range(12)]
    head, _, row, _ = worth_lines(few, [1 / 60])
    assert head.split() == ["rig", "cam0", "cam1", "cam2", "cam3"]
    head, row, _ = worth_lines(many, [1 / 60])
    assert head.split() == ["exposure", "SNR", "dB", "worst", "headroom", "worst"]
    assert (row.split()[3], row.split()[5]) == ("cam0", "cam11")
    assert max(len(head), len(row)) <= 100


def test_an_end_that_the_meter_did_not_find_is_a_bound() -> None:
    whole = Target("cam0", "G", NOISE, 0.001, 1.0)
    dark = Target("cam1", "G", NOISE, 0.001, 2.0, no_darker=False)
    snr = f"{NOISE.snr(0.001, Exposure(time=1 / 60)):.1f}"
    _, _, row, last = worth_lines([whole, dark], [1 / 60])
    assert row.split()[2::2] == [f"<{snr}", snr, f"<{snr}"]
    assert "; more than 11.0 stops lie between them (cam1 G); < is the most that it may be" in last
    wide = replace(whole, bright=8.0, no_brighter=True)
    assert "; at least 13.0 stops lie between them (cam0 G); < " in worth_lines([wide, dark], [1 / 60])[-1]
    assert "; 10.0 stops lie between them (cam0 G)." in worth_lines([whole], [1 / 60])[-1]
    bright = Target("cam1", "G", NOISE, 0.001, 2.0, no_brighter=False)
    assert "<+" in worth_lines([bright], [1 / 60])[2]


def test_a_dry_run_of_a_resumed_capture_counts_what_is_missing(rig, tmp_path: Path) -> None:
    folder = tmp_path / "S"
    capture = ("capture", "--sim", "toy", str(folder), "--frames", "1", "--bracket", "-4,0")
    assert rig(*capture)[0] == 0
    shots = (folder / "shots.jsonl").read_text().splitlines(keepends=True)
    (folder / "shots.jsonl").write_text("".join(shots[:3]))
    code, out, _ = rig(*capture, "--resume", "--dry-run")
    assert code == 0
    assert "\n1 of 4 shots still to take\n" in out
    code, out, err = rig(*capture, "--dry-run")
    assert (code, out) == (2, "")
    assert "is not empty: name a new folder, or --resume the session in it." in err


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
