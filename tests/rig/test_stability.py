"""The extremes: within their limits, no worse than what was accepted, and told as they are."""

import json
from pathlib import Path

import pytest

from imaging.files import store
from imaging.stress_case import StressCase
from rig.stability import extremes

ACCEPTED = Path(__file__).parents[2] / "bench" / "results" / "stability_accepted.json"
FACTOR, SHARE = 4.0, 0.01
"""Between machines and libraries an error may grow by this factor, or to this share of its limit."""


@pytest.fixture(scope="module")
def rows() -> list[StressCase]:
    return list(extremes(quick=True))


def test_every_extreme_is_within_its_limit(rows: list[StressCase]) -> None:
    assert [row for row in rows if not row.ok] == []


def test_no_extreme_is_worse_than_the_accepted_one(rows: list[StressCase]) -> None:
    known = {(row["part"], row["case"], row["what"]): row for row in store.read_json(ACCEPTED)["extremes"]}
    assert {(row.part, row.case, row.what) for row in rows} == set(known), (
        "accept: bench/recon/stability.py --write"
    )
    assert [row for row in rows if _worse(row, known[row.part, row.case, row.what]["error"])] == []


def _worse(row: StressCase, accepted: float) -> bool:
    return row.error is None or row.error > max(FACTOR * accepted, SHARE * row.limit)


def test_a_regression_would_be_seen() -> None:
    assert _worse(made(float("nan")), 1.0)
    assert _worse(made(1.0, limit=0.0), 0.0)
    assert _worse(made(5e-4), 1e-4)
    assert not _worse(made(3e-4), 1e-4)
    assert not _worse(made(5e-6), 1e-8)
    assert not _worse(made(0.0, limit=0.0), 0.0)


def test_the_cases_are_different_ones(rows: list[StressCase]) -> None:
    assert len({(row.part, row.case, row.what) for row in rows}) == len(rows)
    assert {row.part for row in rows} == {"calibration", "splatting", "methods"}


def made(error: float, limit: float = 1e-3) -> StressCase:
    return StressCase.of("splatting", "a card", "pixels", "float64", error, limit)


def test_the_doctor_shows_them_in_one_table(rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.stability.extremes", lambda quick, progress: iter([made(1e-5)]))
    code, out, err = rig("doctor", "--stability")
    assert (code, err) == (0, "")
    (row,) = [line.split() for line in out.splitlines() if "a card" in line]
    assert row == ["a", "card", "pixels", "float64", "1.0e-05", "1e-03", "yes"]
    assert "All 1 results are within their limits." in out
    data = json.loads(rig("doctor", "--stability", "--json")[1])
    assert data["in_order"]
    assert data["extremes"][0]["error"] == 1e-5


@pytest.mark.parametrize("error", [1e-2, float("nan"), float("inf")])
def test_the_doctor_fails_on_a_failure(rig, monkeypatch: pytest.MonkeyPatch, error: float) -> None:
    rows = [made(1e-5), made(error)]
    monkeypatch.setattr("rig.stability.extremes", lambda quick, progress: iter(rows))
    code, out, err = rig("doctor", "--stability")
    assert code == 1
    assert err == "1 of 2 results are outside their limits: a card, pixels.\n"
    assert "NO" in out
    assert not json.loads(rig("doctor", "--stability", "--json")[1])["in_order"]
