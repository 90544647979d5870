"""Files of `rig export` as Spark draws them, splats for three.js, against the light that they are of."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imaging.colour.spaces import srgb_decode, srgb_encode
from recon.exports.canvas import SPARK, canvas
from recon.exports.export import export
from recon.exports.loss import stops_between
from recon.exports.splats import as_splats
from recon.result.scene import Scene
from recon.scene.ply_file import read_ply
from tests.foreign_viewers.viewers import Viewer, needs
from tests.foreign_viewers.wall import HEIGHT, RADIANCES, TINT, WIDTH, front, strips

pytestmark = needs("spark")
FAINT = 1 / 1024
TURNS = {"ply": None, "sog": None, "spz": np.diag([1.0, -1.0, -1.0, 1.0])}
"""From the scene's axes to those of a file, which Spark keeps: SPZ has those of OpenGL."""


@pytest.fixture(scope="module")
def viewer(browser: object) -> Iterator[Viewer]:
    with Viewer(browser, "spark", WIDTH, HEIGHT) as running:
        yield running


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
    exported = export(veiled, files / f"t.{kind}", exposure=0.0)
    shown = srgb_decode(viewer.drawn(files / f"t.{kind}", front(), turn=TURNS[kind]) / 255)
    light = veiled.render(front())
    dim = (light < 0.95).all(2)
    off = stops_between(light[dim], shown[dim], FAINT)
    assert exported.loss is not None
    assert np.median(off) < exported.loss.pixel_median + 0.015
    assert np.median(off) < 0.12


def test_the_canvas_is_what_the_loss_is_measured_on(veiled: Scene, viewer: Viewer, files: Path) -> None:
    export(veiled, files / "w.ply", exposure=0.0)
    world, offset = veiled.record.world, veiled.record.offset
    splats = as_splats(read_ply(files / "w.ply"), world, offset, linear=False, factor=1.0)
    painted = 255 * canvas(splats, world.camera(front()), SPARK)
    off = np.abs(viewer.drawn(files / "w.ply", front()) - painted)
    assert np.median(off) < 1
    assert off.mean() < 1.5
