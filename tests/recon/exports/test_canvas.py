"""Canvases of viewers, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from recon.data.world import SAME
from recon.exports.canvas import PLAYCANVAS, SPARK, Manner, canvas, manners_of
from recon.exports.splats import Splats
from recon.scene.harmonics import C0
from recon.splat import SplatCamera

FOCAL, SIZE = 40.0, 33
CAMERA = SplatCamera(np.eye(4), fx=FOCAL, fy=FOCAL, cx=SIZE / 2, cy=SIZE / 2, width=SIZE, height=SIZE)
WIDE = 4.0
"""Deviation of the discs, px."""


def discs(*layers: tuple[float, float, float]) -> Splats:
    """Round ones that face the camera: opacity, code, and distance of each."""
    opacities, codes, away = np.array(layers).T
    count = len(layers)
    return Splats(
        means=away[:, None] * [0.0, 0.0, 1.0],
        scales=np.column_stack([WIDE / FOCAL * away] * 2 + [np.full(count, 1e-6)]),
        quats=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        opacities=opacities,
        harmonics=((codes - 0.5) / C0)[:, None, None].repeat(3, 2),
        linear=False,
        factor=1.0,
        world=SAME,
        offset=(0.0, 0.0, 0.0),
    )


@pytest.mark.parametrize("manner", [PLAYCANVAS, SPARK])
def test_a_disc_has_the_falloff_of_the_viewers_shader(manner: Manner) -> None:
    """PlayCanvas's is stretched to end at 0 after sqrt(8) deviations, Spark's is thinned by its blur."""
    image = canvas(discs((0.9, 0.7, 2.0)), CAMERA, manner)
    steps = np.arange(SIZE) - SIZE // 2
    squared = (steps[:, None] ** 2 + steps**2) / (WIDE**2 + manner.blur)
    falloff = np.exp(-squared / 2)
    if manner is PLAYCANVAS:
        falloff = (falloff - math.exp(-4)) / (1 - math.exp(-4))
    else:
        falloff = falloff * WIDE**2 / (WIDE**2 + 0.3)
    expected = np.where(squared <= 8, 0.7 * 0.9 * falloff, 0)
    np.testing.assert_allclose(
        255 * image[..., 0], 255 * expected, atol=0.75
    )  # an alpha below the least is nothing
    np.testing.assert_allclose(255 * image, np.round(255 * image), atol=1e-9)


def test_many_faint_layers_are_rounded_one_by_one() -> None:
    """Of 0.4 of a code nothing remains, of 0.6 ten codes; unrounded they would be 10 and 16."""
    for share, code in ((0.4, 0), (0.6, 10)):
        layers = [(0.01, share / 255 / 0.01, 1 + 0.01 * number) for number in range(30)]
        image = canvas(discs(*layers), CAMERA, replace(SPARK, thinned=False, least=0))
        assert round(255 * image[SIZE // 2, SIZE // 2, 0]) == code


def test_spark_orders_layers_by_distance_and_playcanvas_along_the_axis() -> None:
    """Aside, what is nearer along the axis may be farther away."""
    scene = discs((1.0, 1.0, 2.0), (1.0, 0.0, 1.9))
    scene.means[1, :2] = 0.9, 0.0
    scene.scales[:, :2] = 10.0
    assert np.linalg.norm(scene.means[1]) > 2.0 > scene.means[1, 2]
    middle = SIZE // 2, SIZE // 2, 0
    assert canvas(scene, CAMERA, PLAYCANVAS)[middle] < 0.01
    assert canvas(scene, CAMERA, SPARK)[middle] > 0.99


def test_codes_end_where_the_file_has_its_end() -> None:
    bright = replace(discs((1.0, 3.0, 2.0)), end=4.0)
    assert canvas(bright, CAMERA, PLAYCANVAS).max() == pytest.approx(3, abs=0.01)
    assert canvas(replace(bright, end=1.0), CAMERA, SPARK).max() <= 1
    assert manners_of(4.0) == (PLAYCANVAS,)
    assert len(manners_of(1.0)) == 2
