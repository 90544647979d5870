"""Files of `rig export` as Babylon.js draws them, against the light that they are of."""

from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import srgb_encode
from recon.exports.export import export
from recon.result.scene import Scene
from tests.foreign_viewers.likeness import loss_is_shown
from tests.foreign_viewers.viewers import Viewer, needs, turn_of
from tests.foreign_viewers.wall import RADIANCES, TINT, front, strips

VIEWER = "babylon"
pytestmark = needs("babylon")


@pytest.mark.parametrize("kind", ["ply", "sog", "spz", "glb"])
def test_the_radiances_of_the_wall_are_seen(kind: str, wall: Scene, viewer: Viewer, files: Path) -> None:
    export(wall, files / f"b.{kind}", exposure=0.0)
    codes = viewer.drawn(files / f"b.{kind}", front(), turn=turn_of(kind, wall))
    upper, lower = strips(codes.astype(float))
    light = np.array(RADIANCES)[:, None] * np.ones(3)
    assert np.abs(upper - 255 * srgb_encode(light)).max() < 2
    assert np.abs(lower - 255 * srgb_encode(light * TINT))[1:].max() < 3


@pytest.mark.parametrize("kind", ["ply", "sog", "spz", "glb"])
def test_the_loss_that_is_printed_is_what_the_picture_shows(
    kind: str, veiled: Scene, viewer: Viewer, files: Path
) -> None:
    loss_is_shown(veiled, viewer, files / f"v.{kind}", turn_of(kind, veiled))
