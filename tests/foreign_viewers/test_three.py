"""Files of `rig export` as three.js's own splats are drawn, against the light that they are of."""

from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import srgb_encode
from recon.exports.export import export
from recon.exports.request import FormatName
from recon.result.scene import Scene
from tests.foreign_viewers.viewers import Viewer, needs, turn_of
from tests.foreign_viewers.wall import RADIANCES, TINT, front, strips

VIEWER = "three"
pytestmark = needs("three")
LIGHT = np.array(RADIANCES)[:, None] * np.ones(3)


@pytest.mark.parametrize("format", ["ply", "spz", "spz4", "glb"])
def test_the_radiances_of_the_wall_are_seen_where_codes_are_output_as_they_are(
    format: FormatName, wall: Scene, viewer: Viewer, files: Path
) -> None:
    kind = format.removesuffix("4")
    export(wall, files / f"h.{kind}", format, exposure=0.0)
    codes = viewer.drawn(files / f"h.{kind}", front(), turn=turn_of(kind, wall), tones="codes")
    upper, lower = strips(codes.astype(float))
    assert np.abs(upper - 255 * srgb_encode(LIGHT)).max() < 1.5
    assert np.abs(lower - 255 * srgb_encode(LIGHT * TINT))[1:].max() < 2.5


@pytest.mark.parametrize("kind", ["ply", "glb"])
def test_linear_light_is_what_three_takes_colours_for(
    kind: str, wall: Scene, viewer: Viewer, files: Path
) -> None:
    """In steps of 8 bits of light, which are coarse in the dark, and up to white."""
    export(wall, files / f"j.{kind}", exposure=0.0, linear=True)
    upper, _ = strips(viewer.drawn(files / f"j.{kind}", front(), turn=turn_of(kind, wall)).astype(float))
    stepped = np.round(255 * LIGHT.clip(max=1)) / 255
    assert np.abs(upper - 255 * srgb_encode(stepped)).max() < 1.5


def test_display_values_are_seen_bright(wall: Scene, viewer: Viewer, files: Path) -> None:
    """The warning in docs/export.md: their codes count as light, and are encoded once more."""
    export(wall, files / "k.ply", exposure=0.0)
    upper, _ = strips(viewer.drawn(files / "k.ply", front()).astype(float))
    assert np.abs(upper - 255 * srgb_encode(srgb_encode(LIGHT.clip(max=1)))).max() < 2
    assert upper[0].min() > 80
