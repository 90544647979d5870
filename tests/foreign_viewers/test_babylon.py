"""Files of `rig export` as Babylon.js draws them, against the light that they are of."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import srgb_decode, srgb_encode
from recon.exports.export import export
from recon.exports.loss import stops_between
from recon.result.scene import Scene
from tests.foreign_viewers.viewers import Viewer, needs, turn_of
from tests.foreign_viewers.wall import HEIGHT, RADIANCES, TINT, WIDTH, front, strips

pytestmark = needs("babylon")
FAINT = 1 / 1024


@pytest.fixture(scope="module")
def viewer(browser: object) -> Iterator[Viewer]:
    with Viewer(browser, "babylon", WIDTH, HEIGHT) as running:
        yield running


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
    exported = export(veiled, files / f"v.{kind}", exposure=0.0)
    shown = srgb_decode(viewer.drawn(files / f"v.{kind}", front(), turn=turn_of(kind, veiled)) / 255)
    light = veiled.render(front())
    dim = (light < 0.95).all(2)
    off = stops_between(light[dim], shown[dim], FAINT)
    assert exported.loss is not None
    assert np.median(off) < exported.loss.pixel_median + 0.015
    assert np.median(off) < 0.12
