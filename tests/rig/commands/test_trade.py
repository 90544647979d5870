"""`rig trade` and its page: what is drawn, what is told, and what is refused."""

import importlib
import json
import re
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from imaging.files import store
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, Quality
from recon.trade.sweep_order import STANDARD, Session, planned
from recon.trade.trade_record import Choice, Point, Trade
from rig.report.charts.trade_charts import figures
from rig.report.pages.trade import trade_off, trade_report
from tests.rig.report.pages import Page, assert_self_contained

TINY = {"draft": Quality(10, 100, 32), "standard": Quality(20, 200, 64), "best": Quality(30, 300, 64)}


def point(
    quality: str, db: float, seconds: float, at_once: int = 1, width: int = 640, **overrides: float | str
) -> Point:
    """With as many Gaussians as it takes milliseconds where no number is fixed, of colours of degree 1."""
    choice = Choice(axis="", quality=quality, overrides=Overrides(**overrides))
    return Point(
        key=f"{quality}{overrides}", choice=choice, command=choice.command("S", "nh-3dgs", 0),
        iterations=choice.overrides.iterations or QUALITIES[choice.quality].iterations,
        gaussians=choice.overrides.gaussians or int(seconds * 1000), degree=overrides.get("degree", 1),
        refine=None if quality == "draft" else "poses", width=width, device="CPU, 2 threads", seconds=seconds,
        processor_seconds=2 * seconds, at_once=at_once, size_bytes=int(seconds * 1e5), splats_sha256="0",
        db=db, views={"0000/a": db - 1.0, "0000/b": db + 1.0 + 0.1 * bool(overrides)}, truth_db=db + 2,
    )  # fmt: skip


def made(*points: Point, **change: object) -> Trade:
    return Trade(
        created=datetime(2026, 1, 1, tzinfo=UTC), versions={}, code="c", calibration_sha256="0",
        photographs_sha256="1", depths_sha256="", method="nh-3dgs", seed=0, measure="raw_psnr", width=1280,
        points=points,
    ).model_copy(update=change)  # fmt: skip


DECIDED = {"gaussians": 20_000, "degree": 1, "refine": "poses"}
"""Decisions of the scene for `standard`, which the trainings with one thing changed are given."""
POINTS = (
    point("draft", 35.0, 5.0, width=320),
    point("standard", 38.0, 20.0),
    point("best", 38.5, 80.0),
    point("standard", 37.0, 21.0, **DECIDED | {"degree": 0}),
    point("standard", 38.2, 12.0, **DECIDED | {"gaussians": 10_000}),
)


@pytest.fixture
def session(toy: Path) -> Path:
    store.make_folder(toy / "trade")
    store.write_json(toy / "trade" / "trade.json", made(*POINTS).model_dump(mode="json"))
    return toy


def test_the_page_stands_alone_and_names_every_command(session: Path) -> None:
    page = Page.read(trade_report(session))
    assert_self_contained(page)
    for one in POINTS:
        assert one.command in page.text
    assert "35.00" in page.text
    assert "draft, in 5.0 s" in page.text
    assert len(page.all("svg")) == 6


def test_every_column_holds_what_its_heading_says() -> None:
    table = next(table for table in trade_off(made(*POINTS)).tables if table.heading == "Every training")
    first = dict(zip(table.columns, table.rows[0], strict=True))
    assert first["#dB"] == "35.00"
    assert first["#dB to the truth"] == "37.00"
    assert first["#Time"] == "5.0 s"
    assert first["#Gaussians"] == "5,000"
    assert first["Command"] == POINTS[0].command


def test_a_front_and_the_presets_are_drawn() -> None:
    drawn = list(figures(made(*POINTS)))
    assert [figure.heading for figure in drawn] == [
        f"{what} against {cost}" for what in ("Quality", "Truth") for cost in ("time", "Gaussians", "size")
    ]
    over_time = drawn[0]
    # 35 at 5 s, 38.2 at 12 s and 38.5 at 80 s: nothing is better for less.
    assert "3 lie on the front" in over_time.explanation
    (line,) = re.findall(r'class="line s4" d="([^"]*)"', over_time.drawing)
    assert line.count("L") == 2
    for name in ("draft", "standard", "best"):
        assert f"</span>{name}</li>" in over_time.drawing


def test_a_single_training_is_a_table_and_no_curve() -> None:
    assert not list(figures(made(POINTS[0])))


def test_what_a_setting_buys_is_paired_over_views() -> None:
    buys, every = trade_off(made(*POINTS)).tables
    assert [row[0] for row in buys.rows] == ["Gaussians", "SH degree"]
    gaussians, degree = buys.rows
    # +0.2 in one view, +0.3 in the other: 0.25 with an error of 0.05.
    assert gaussians[1:] == (
        "10,000",
        "20,000",
        "0.250 ± 0.050",
        "× 0.60",
        "× 0.60",
    )
    assert degree[1:4] == ("0", "1", "−0.950 ± 0.050")
    assert [row[-1] for row in every.rows] == [
        one.command for one in sorted(POINTS, key=lambda one: one.seconds)
    ]
    assert every.rows[0][-2] == "time, Gaussians, size"
    assert every.rows[2][-2] == ""


def test_a_sweep_tells_what_its_single_changes_buy(toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, quality in TINY.items():
        monkeypatch.setitem(QUALITIES, name, quality)
    wanted = ("iterations", "Gaussians", "SH degree")

    def some(session: Session, standard: Point | None) -> list[Choice]:
        return [one for one in planned(session, standard) if one == STANDARD or one.axis in wanted][:7]

    module = importlib.import_module("recon.trade.sweep")
    monkeypatch.setattr(module, "planned", some)
    monkeypatch.setattr(module, "neighbours", lambda points, session: [])
    trade = module.trade_sweep(toy, budget=1000.0)
    singles = [one for one in trade.points if one.choice.axis != "preset"]
    buys, _ = trade_off(trade).tables
    assert len(buys.rows) == len(singles) > 5
    assert {row[0] for row in buys.rows} == {"iterations", "Gaussians", "SH degree"}


def test_with_several_at_once_processor_time_is_drawn_and_said() -> None:
    alone, shared = made(*POINTS), made(*POINTS, point("standard", 36, 9.0, at_once=2, degree=1))
    assert trade_off(alone).caution == ""
    assert trade_off(shared).caution.startswith("Up to 2 trainings shared a machine")
    assert next(iter(figures(shared))).heading == "Quality against processor time"
    other = made(*POINTS, POINTS[0].model_copy(update={"device": "NVIDIA H100"}))
    assert trade_off(other).caution.startswith("Not all trainings ran on machines of one kind")
    assert next(iter(figures(other))).heading == "Quality against processor time"


def test_no_points_and_failures_are_a_page_too(session: Path) -> None:
    failed = made(failed={"rig reconstruct <S>": "too few points."})
    store.write_json(session / "trade" / "trade.json", failed.model_dump(mode="json"))
    page = Page.read(trade_report(session))
    assert_self_contained(page)
    assert "rig reconstruct <S>" in page.text


def test_the_command_sweeps_and_writes_the_page(rig, toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, quality in TINY.items():
        monkeypatch.setitem(QUALITIES, name, quality)
    monkeypatch.setattr("rig.commands.trade.started_at", time.monotonic)
    module = importlib.import_module("recon.trade.sweep")
    monkeypatch.setattr(module, "planned", lambda *given: planned(*given)[: len(TINY)])
    monkeypatch.setattr(module, "neighbours", lambda points, session: [])
    code, out, err = rig("trade", str(toy), "--budget", "12s", "--json")
    data = json.loads(out)
    assert code == 0
    assert "standard: " in err
    keys = [point["key"] for point in data["points"]]
    assert set(data["front"]) <= set(keys)
    assert Path(data["report"]).is_file()
    # What was made stays, and a time that is over makes nothing more.
    code, out, _ = rig("trade", str(toy), "--budget", "0.000001s")
    assert code == 0
    assert f"{len(keys)} training" in out
    assert data["left_out"] == 0 or "more did not fit the budget: run the same command to go on." in out
    assert f"rig reconstruct {toy} --method nh-3dgs --quality " in out


def test_a_time_without_room_for_one_training_is_said(rig, toy: Path) -> None:
    code, out, err = rig("trade", str(toy), "--budget", "0.000001s")
    assert (code, out) == (2, "")
    assert err.count("given up") <= 1
    assert f"No training of {toy} was done in time: give a longer --budget." in err


def test_no_cluster_is_said(rig, toy: Path) -> None:
    pytest.importorskip("ray")
    code, _, err = rig("trade", str(toy), "--ray", "127.0.0.1:1")
    assert code == 2
    assert "No Ray cluster answers at 127.0.0.1:1" in err


def test_an_interruption_leaves_the_page_of_what_is_done(
    rig, session: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("recon.trade.trade_sweep", stopped)
    code, out, err = rig("trade", str(session))
    assert (code, out) == (130, "")
    assert err == "stopped; run the same command again to continue.\n"
    assert (session / "trade" / "report.html").is_file()


@pytest.mark.parametrize("budget", ["35dB", "300MB", "soon", "0s"])
def test_only_a_time_is_a_budget(rig, toy: Path, budget: str) -> None:
    code, out, err = rig("trade", str(toy), "--budget", budget)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (toy / "trade").exists()


@pytest.mark.parametrize("missing", ["calibration/calibration.json", "session.json"])
def test_what_is_not_calibrated_is_refused(rig, toy: Path, missing: str) -> None:
    store.discard(toy / missing)
    code, out, err = rig("trade", str(toy))
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (toy / "trade").exists()


def test_a_failed_training_is_listed(rig, toy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trade = made(*POINTS, failed={"rig reconstruct S --set views=3": "nothing to start from."})
    store.make_folder(toy / "trade")
    store.write_json(toy / "trade" / "trade.json", trade.model_dump(mode="json"))
    monkeypatch.setattr("recon.trade.trade_sweep", lambda *arguments, **options: trade)
    code, _, err = rig("trade", str(toy))
    assert code == 3
    assert "1 training failed, the first is `rig reconstruct S --set views=3`" in err
