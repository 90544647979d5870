"""Files of `rig export` as PlayCanvas's engine draws them, against the light that they are of."""

from pathlib import Path

import numpy as np
import pytest

from imaging.arrays import Array
from imaging.colour.spaces import srgb_decode, srgb_encode
from recon.exports.canvas import PLAYCANVAS
from recon.exports.export import export
from recon.result.scene import Scene
from tests.foreign_viewers.likeness import canvas_is_shown, loss_is_shown
from tests.foreign_viewers.viewers import Viewer, needs, turn_of
from tests.foreign_viewers.wall import RADIANCES, TINT, front, strips

VIEWER = "playcanvas"
pytestmark = needs("playcanvas")


def aces(light: Array) -> Array:
    """The tone map of that name in PlayCanvas (Narkowicz 2015)."""
    return (light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)).clip(0, 1)


@pytest.mark.parametrize(
    ("name", "options"), [("a.sog", {}), ("b.sog", {"linear": False}), ("a.ply", {}), ("a.glb", {})]
)
def test_the_radiances_of_the_wall_are_seen(
    name: str, options: dict[str, bool], wall: Scene, viewer: Viewer, files: Path
) -> None:
    """Within a code of 8 bits and the steps of 11 bits that the engine has of colours."""
    export(wall, files / name, exposure=0.0, **options)
    upper, lower = strips(viewer.drawn(files / name, front(), turn=turn_of(name, wall)).astype(float))
    light = np.array(RADIANCES)[:, None] * np.ones(3)
    assert np.abs(upper - 255 * srgb_encode(light)).max() < 2.5
    assert np.abs(lower - 255 * srgb_encode(light * TINT))[1:].max() < 2.5


def test_light_above_white_reaches_the_tone_map(wall: Scene, viewer: Viewer, files: Path) -> None:
    """Of SOG alone; what ends at 1 is 230 of 255 in ACES, however bright it was."""
    export(wall, files / "c.sog", exposure=0.0)
    export(wall, files / "d.sog", exposure=0.0, linear=False)
    truth = 255 * srgb_encode(aces(np.array(RADIANCES)))
    upper, _ = strips(viewer.drawn(files / "c.sog", front(), tones="aces").astype(float))
    assert np.abs(upper - truth[:, None]).max() < 3
    upper, _ = strips(viewer.drawn(files / "d.sog", front(), tones="aces").astype(float))
    assert np.abs(upper[-2:] - 230).max() < 3
    assert truth[-1] > 245


def test_linear_light_is_seen_dark(wall: Scene, viewer: Viewer, files: Path) -> None:
    """The warning of `--linear`: colours count as codes."""
    exported = export(wall, files / "e.sog", exposure=0.0, linear=True)
    upper, _ = strips(viewer.drawn(files / "e.sog", front()).astype(float))
    middle = srgb_decode(upper[RADIANCES.index(0.18), 1] / 255)
    assert np.log2(middle / 0.18) == pytest.approx(-2.7, abs=0.15)
    assert any("2.7 stops too dark" in note for note in exported.notes)


@pytest.mark.parametrize("name", ["v.sog", "v.ply", "v.glb"])
def test_the_loss_that_is_printed_is_what_the_picture_shows(
    name: str, veiled: Scene, viewer: Viewer, files: Path
) -> None:
    loss_is_shown(veiled, viewer, files / name, turn_of(name, veiled))


def test_the_canvas_is_what_the_loss_is_measured_on(veiled: Scene, viewer: Viewer, files: Path) -> None:
    canvas_is_shown(veiled, viewer, files / "w.ply", PLAYCANVAS)
