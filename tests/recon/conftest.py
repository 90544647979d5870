"""Simulated sessions at toy size, calibrated from their truth, shared by the tests of this folder."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from bench.support import oracle
from drivers.sim import rigs
from recon.data.dataset import Dataset, load


@pytest.fixture(scope="session")
def toy(tmp_path_factory) -> Path:
    """Six RAW views of 64x48, three exposures each; not to be changed."""
    return oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy", "toy", points=300)


@pytest.fixture(scope="session")
def toy_ldr(tmp_path_factory) -> Path:
    """Six views of 64x48 as JPEG, five exposures each; not to be changed."""
    return oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy-ldr", "toy-ldr", points=300)


@pytest.fixture(scope="session")
def toy_dataset(toy) -> Dataset:
    return load(toy)


@pytest.fixture(scope="session")
def toy_long(tmp_path_factory):
    """Sixteen views of the toy rig with their true calibration."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(rigs._RIGS, "toy-long", replace(rigs._RIGS["toy"], positions=8))
        folder = oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy", "toy-long", points=600)
    return load(folder)


@pytest.fixture
def session_copy(toy, tmp_path) -> Path:
    """A copy of the toy session that a test may change."""
    return shutil.copytree(toy, tmp_path / "session")
