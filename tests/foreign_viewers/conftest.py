"""Walls of known radiances, shared by the tests of this folder."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from recon.result.scene import Scene, open_scene
from tests.conftest import MadeOnce
from tests.foreign_viewers.viewers import Viewer
from tests.foreign_viewers.wall import HEIGHT, WIDTH, write_wall


@pytest.fixture(scope="session")
def wall(made_once: MadeOnce) -> Scene:
    return open_scene(made_once("viewers-wall", lambda folder: write_wall(folder)))


@pytest.fixture(scope="session")
def veiled(made_once: MadeOnce) -> Scene:
    return open_scene(made_once("viewers-veiled", lambda folder: write_wall(folder, veil=True)))


@pytest.fixture(scope="module")
def viewer(browser: object, request: pytest.FixtureRequest) -> Iterator[Viewer]:
    """A tab with the viewer that the file of tests names."""
    with Viewer(browser, request.module.VIEWER, WIDTH, HEIGHT) as running:
        yield running


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for files that viewers open."""
    return tmp_path_factory.mktemp("viewers")
