"""What `rig check` prints of many shots, and after a repair; what `rig capture` forecasts of a full disk."""

import json
from pathlib import Path

from capture.record.forecast import Forecast
from rig.cameras.forecast_in_words import forecast_line


def test_a_problem_of_many_shots_is_one_line_and_each_is_in_the_record(rig, toy: Path) -> None:
    index = toy / "shots.jsonl"
    lines = index.read_text().splitlines(keepends=True)
    index.write_text("".join(line for line in lines if '"camera": "cam0"' in line))
    for file in (toy / "raw").rglob("cam1_*"):
        file.unlink()
    lost = sum('"camera": "cam1"' in line for line in lines)
    assert lost > 2
    _, out, _ = rig("check", str(toy))
    assert out.count(" is missing: ") == 1
    assert f"  cam1: {lost} shots, such as: The shot of cam1, frame 0, step 0 is missing: " in out
    kinds = [problem["kind"] for problem in json.loads((toy / "check/check.json").read_text())["problems"]]
    assert kinds.count("missing") == lost


def test_a_repair_does_not_advise_itself_and_restores_names(rig, toy: Path) -> None:
    (toy / "raw/0000/notes.txt").write_text("mine")
    (toy / "raw/0000/cam0_1.dng").rename(toy / "raw/0000/foo.dng")
    with (toy / "shots.jsonl").open("a") as index:
        index.write("garbage\n")
    code, out, err = rig("check", str(toy), "--repair")
    assert code == 3
    assert "  renamed: raw/0000/foo.dng is raw/0000/cam0_1.dng, and is called so again\n" in out
    assert out.count("notes.txt") == 1
    assert "is not JSON\n" in out
    assert "--repair" not in out + err


def test_a_disk_that_is_too_small_ends_the_capture_where_it_is_full() -> None:
    forecast = Forecast(9.0, 9.0, 1, 24, {"a": 4000}, 96_000, "test shots", 54_000)
    assert (
        "only 54 kB are free, so it stops after about 13 shots unless you free space; --resume then goes on."
    ) in forecast_line(forecast)
