"""Simulated sessions at toy size, calibrated from their truth, shared by the tests of this folder."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bench.support import depths, oracle
from drivers.sim.rig_settings import RIGS
from recon.data.dataset import Dataset
from recon.data.load import load
from tests.conftest import MadeOnce


@pytest.fixture(scope="session")
def toy(made_once: MadeOnce) -> Path:
    """Six RAW views of 64x48, three exposures each; not to be changed."""
    return made_once("recon-toy", lambda folder: oracle.oracle_session(folder, "toy", points=300))


@pytest.fixture(scope="session")
def toy_ldr(made_once: MadeOnce) -> Path:
    """Six views of 64x48 as JPEG, five exposures each; not to be changed."""
    return made_once("recon-toy-ldr", lambda folder: oracle.oracle_session(folder, "toy-ldr", points=300))


@pytest.fixture(scope="session")
def toy_dataset(toy: Path) -> Dataset:
    return load(toy)


@pytest.fixture(scope="session")
def toy_deep(made_once: MadeOnce) -> Path:
    """The toy session with depth maps of a scanner with 1 % of noise and holes; not to be changed."""

    def make(folder: Path) -> None:
        oracle.oracle_session(folder, "toy", points=300)
        depths.add_depths(folder, noise=0.01, holes=0.2, seed=0)

    return made_once("recon-toy-deep", make)


@pytest.fixture(scope="session")
def toy_long(made_once: MadeOnce) -> Dataset:
    """Sixteen views of the toy rig with their true calibration."""

    def make(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(RIGS, "toy-long", replace(RIGS["toy"], positions=8))
            oracle.oracle_session(folder, "toy-long", points=600)

    return load(made_once("recon-toy-long", make))


@pytest.fixture
def session_copy(toy, tmp_path) -> Path:
    """A copy of the toy session that a test may change."""
    return shutil.copytree(toy, tmp_path / "session")
