"""Simulated sessions with their true calibration, to be changed at will."""

import shutil
from pathlib import Path

import pytest

from bench.support import oracle
from tests.conftest import MadeOnce


def _copied(made_once: MadeOnce, name: str, to: Path) -> Path:
    made = made_once(f"recon-{name}", lambda folder: oracle.oracle_session(folder, name, points=300))
    return shutil.copytree(made, to / name)


@pytest.fixture
def toy(made_once: MadeOnce, tmp_path: Path) -> Path:
    """Six RAW views of 64x48, three exposures each."""
    return _copied(made_once, "toy", tmp_path)


@pytest.fixture
def toy_ldr(made_once: MadeOnce, tmp_path: Path) -> Path:
    """Six views of 64x48 as JPEG, five exposures each."""
    return _copied(made_once, "toy-ldr", tmp_path)
