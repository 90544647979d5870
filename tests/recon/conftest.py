"""Simulated sessions at toy size, calibrated from their truth, shared by the tests of this folder."""

import importlib.util
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from drivers.sim import rigs
from recon.dataset import Dataset, load


def _oracle() -> ModuleType:
    path = Path(__file__).parents[2] / "bench" / "oracle.py"
    spec = importlib.util.spec_from_file_location("oracle", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["oracle"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def oracle() -> ModuleType:
    return _oracle()


@pytest.fixture(scope="session")
def toy(oracle, tmp_path_factory) -> Path:
    """Six RAW views of 64x48, three exposures each; not to be changed."""
    return oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy", "toy", points=300)


@pytest.fixture(scope="session")
def toy_ldr(oracle, tmp_path_factory) -> Path:
    """Six views of 64x48 as JPEG, five exposures each; not to be changed."""
    return oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy-ldr", "toy-ldr", points=300)


@pytest.fixture(scope="session")
def toy_dataset(toy) -> Dataset:
    return load(toy)


@pytest.fixture(scope="session")
def toy_long(oracle, tmp_path_factory):
    """Sixteen views of the toy rig with their true calibration."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(rigs._RIGS, "toy-long", replace(rigs._RIGS["toy"], positions=8))
        folder = oracle.oracle_session(tmp_path_factory.mktemp("toy") / "toy", "toy-long", points=600)
    return load(folder)


@pytest.fixture
def session_copy(toy, tmp_path) -> Path:
    """A copy of the toy session that a test may change."""
    return shutil.copytree(toy, tmp_path / "session")
