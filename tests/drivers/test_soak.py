"""Twenty cycles of bench/soak.py, which runs a thousand."""

import importlib
from pathlib import Path

import pytest


def test_opening_and_closing_piles_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "bench"))
    run = importlib.import_module("soak").soak(20)
    assert run["descriptors_added"] <= 0
    assert run["objects_added"] <= 20  # less than one a cycle
    assert run["handles_open"] == 0
