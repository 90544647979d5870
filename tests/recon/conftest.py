"""Simulated sessions at toy size, calibrated from their truth, shared by the tests of this folder."""

import importlib.util
import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

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


@pytest.fixture
def session_copy(toy, tmp_path) -> Path:
    """A copy of the toy session that a test may change."""
    return shutil.copytree(toy, tmp_path / "session")
