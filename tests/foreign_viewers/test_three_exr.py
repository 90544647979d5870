"""EXR files as three.js shows them, whose decoder is of its own, against the light that was written."""

from pathlib import Path

import numpy as np
import pytest

from imaging.choices import ExrStorage
from imaging.colour.spaces import srgb_encode
from imaging.files.exr.writing import write_exr
from tests.foreign_viewers.viewers import Viewer, needs
from tests.foreign_viewers.wall import HEIGHT, WIDTH, front

VIEWER = "three_exr"
pytestmark = needs("three")


@pytest.mark.parametrize(
    ("storage", "typical", "most"), [("float", 0.3, 1), ("half", 0.3, 1), ("dwaa", 0.5, 4)]
)
def test_light_beside_data_is_shown_within_codes(
    storage: ExrStorage, typical: float, most: float, viewer: Viewer, tmp_path: Path
) -> None:
    ramp = 2.0 ** np.linspace(-8, 1, WIDTH)[None, :, None] * np.array([1.0, 0.7, 0.4])
    light = (ramp * np.random.default_rng(0).normal(1, 0.01, (HEIGHT, WIDTH, 3))).astype(np.float32)
    light[: HEIGHT // 2, : WIDTH // 2] *= 0.5
    depth = np.full((HEIGHT, WIDTH), 4.0)
    write_exr(tmp_path / "a.exr", light, storage=storage, data={"depth": {"Z": depth}})
    off = np.abs(viewer.drawn(tmp_path / "a.exr", front()) - 255 * srgb_encode(light.clip(max=1)))
    assert np.median(off) < typical
    assert off.max() < most
