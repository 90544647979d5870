"""Made scenes, shared by the tests of this folder."""

from pathlib import Path

import pytest

from recon.result.scene import Scene, open_scene
from tests.conftest import MadeOnce
from tests.recon.exports.made_scene import write_made


@pytest.fixture(scope="session")
def made(made_once: MadeOnce) -> Path:
    """18 stops, the same from everywhere, nothing far away; not to be changed."""
    return made_once("export-made", write_made)


@pytest.fixture(scope="session")
def made_sky(made_once: MadeOnce) -> Path:
    """With light from far away, in metres of a survey; not to be changed."""
    return made_once("export-sky", lambda folder: write_made(folder, sky=True, survey=True))


@pytest.fixture(scope="session")
def made_shiny(made_once: MadeOnce) -> Path:
    """Colours depend on the direction, by harmonics of degree 2; not to be changed."""
    return made_once("export-shiny", lambda folder: write_made(folder, degree=2, seed=1))


@pytest.fixture
def scene(made: Path) -> Scene:
    return open_scene(made)
