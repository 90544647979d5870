"""Files of `rig export` as Spark draws them, splats for three.js, against the light that they are of."""

from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import srgb_encode
from recon.exports.canvas import SPARK
from recon.exports.export import export
from recon.result.scene import Scene
from tests.foreign_viewers.likeness import canvas_is_shown, loss_is_shown
from tests.foreign_viewers.viewers import Viewer, needs
from tests.foreign_viewers.wall import RADIANCES, TINT, front, strips

VIEWER = "spark"
pytestmark = needs("spark")
TURNS = {"ply": None, "sog": None, "spz": np.diag([1.0, -1.0, -1.0, 1.0])}
"""From the scene's axes to those of a file, which Spark keeps: SPZ has those of OpenGL."""


@pytest.mark.parametrize("kind", TURNS)
def test_the_radiances_of_the_wall_are_seen(kind: str, wall: Scene, viewer: Viewer, files: Path) -> None:
    export(wall, files / f"s.{kind}", exposure=0.0)
    upper, lower = strips(viewer.drawn(files / f"s.{kind}", front(), turn=TURNS[kind]).astype(float))
    light = np.array(RADIANCES)[:, None] * np.ones(3)
    assert np.abs(upper - 255 * srgb_encode(light)).max() < 4
    assert np.abs(lower - 255 * srgb_encode(light * TINT))[1:].max() < 4


@pytest.mark.parametrize("kind", ["ply", "spz"])
def test_the_loss_that_is_printed_is_what_the_picture_shows(
    kind: str, veiled: Scene, viewer: Viewer, files: Path
) -> None:
    loss_is_shown(veiled, viewer, files / f"t.{kind}", TURNS[kind])


def test_the_canvas_is_what_the_loss_is_measured_on(veiled: Scene, viewer: Viewer, files: Path) -> None:
    canvas_is_shown(veiled, viewer, files / "w.ply", SPARK)
