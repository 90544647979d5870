"""A third scene: a court by day, seen all round from one place in it, as the lamps of a film are lit by it.

The sun, a disc of half a degree, is far too bright for any exposure; the brightest lamp just fits into the
shortest one, and the back of the shed is some 18 stops darker than that lamp.
"""

import math

from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, MOTTLE, SPOTS, TILES, WOOD

EYE = (0.0, 0.0, 1.6)
"""Place of the camera's entrance pupil, m."""
SKY, LAMP, SUN = 4_000.0, 110_000.0, 1e8
"""Radiance of the sky where there is no cloud, of the lamp, and of the sun."""
SUN_RADIUS = math.radians(0.2665)
"""Angular radius of its disc from the eye."""
SUN_AT = (math.radians(48.0), math.radians(62.0))
"""Its height and its direction from +x towards +y."""
_DISTANCE = 5.0
"""m, of what stands for the sun."""


def court_scene() -> Scene:
    """The scene. World axes: metres, z up."""
    build = Builder()
    _walls(build)
    _things(build)
    _shed(build)
    _lights(build)
    ambient = 0.5 * SKY
    return build.scene((0.9 * ambient, 0.97 * ambient, 1.1 * ambient))


def _walls(build: Builder) -> None:
    """Four walls, a pavement, and a sky with clouds."""
    bricks = build.material(
        BRICKS, (0.5, 0.5, 0.22), (0.20, 0.09, 0.06), (0.40, 0.20, 0.13), (0.50, 0.44, 0.38), edge=0.08
    )
    build.material(TILES, (0.6, 0.6, 0.6), (0.28, 0.32, 0.20), (0.52, 0.48, 0.30), (0.16, 0.20, 0.14),
                   edge=0.3, warp=0.4)  # fmt: skip
    build.material(MOTTLE, 0.35, (0.30, 0.26, 0.20), (0.56, 0.50, 0.42), (0.70, 0.66, 0.60), warp=1.0,
                   detail=0.3)  # fmt: skip
    build.material(SPOTS, 0.5, (0.44, 0.46, 0.50), (0.30, 0.20, 0.16), (0.14, 0.20, 0.28))
    floor = build.material(
        TILES, (0.45, 0.45, 1.0), (0.12, 0.11, 0.10), (0.44, 0.42, 0.38), (0.28, 0.24, 0.22), edge=0.2
    )
    sky = build.material(MOTTLE, 2.0, (0.55, 0.75, 1.0), (0.75, 0.85, 1.0), (1.0, 1.0, 1.0), warp=1.0,
                         detail=0.15, emission=(SKY, SKY, SKY))  # fmt: skip
    build.room((bricks, bricks + 1, bricks + 2, bricks + 3, floor, sky), (-4.5, -5.0, 0.0), (5.0, 4.5, 6.0))


def _things(build: Builder) -> None:
    """Boxes and balls, which cast shadows."""
    planks = build.material(
        WOOD, (0.16, 0.6, 0.16), (0.24, 0.15, 0.08), (0.40, 0.27, 0.15), (0.52, 0.38, 0.24), edge=0.3
    )
    stone = build.material(
        MOTTLE, 0.14, (0.42, 0.40, 0.36), (0.55, 0.53, 0.49), (0.68, 0.66, 0.62), warp=1.0, detail=0.35
    )
    build.box(planks, (2.6, -1.8, 0.6), (1.2, 1.2, 1.2), turn=25.0)
    build.box(stone, (-2.4, -2.6, 0.9), (0.8, 0.8, 1.8), turn=-15.0)
    build.sphere(stone, (-2.4, -2.6, 2.1), 0.32)
    build.cylinder(stone, (-3.2, 0.9, 1.5), 0.28, 3.0)
    build.box(planks, (3.4, 1.6, 0.4), (0.9, 1.4, 0.8), turn=10.0)


def _shed(build: Builder) -> None:
    """A shed in the shadow of the far wall, open towards the eye, into which light falls from ahead alone."""
    board = build.material(
        WOOD, (0.22, 0.7, 0.3), (0.18, 0.11, 0.07), (0.30, 0.20, 0.12), (0.42, 0.31, 0.20), edge=0.3
    )
    wide, deep, high, thick = 1.8, 1.6, 2.4, 0.06
    x, y = -0.8, 3.4
    build.box(board, (x, y, high - thick / 2), (wide, deep, thick))
    for side in (-1.0, 1.0):
        build.box(board, (x + side * (wide - thick) / 2, y, high / 2), (thick, deep - 0.01, high - 0.01))
    build.box(board, (x, y + (deep - thick) / 2 - 0.01, high / 2), (wide - 0.01, thick, high - 0.02))
    inner = (wide - thick, deep, 2 * high - thick)  # ends within the boards
    build.dim_zone((x, y, 0.0), inner, (0, 1, 0), reach=1.1, stops=10.0)


def _lights(build: Builder) -> None:
    """The sun, and a globe lamp on a pole."""
    height, turn = SUN_AT
    ahead = (math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height))
    place = (
        EYE[0] + _DISTANCE * ahead[0],
        EYE[1] + _DISTANCE * ahead[1],
        EYE[2] + _DISTANCE * ahead[2],
    )
    radius = _DISTANCE * math.sin(SUN_RADIUS)
    white = (1.0, 1.0, 1.0)
    sun = build.material(MOTTLE, 1.0, white, detail=0.0, emission=(SUN, SUN, SUN))
    build.sphere(sun, place, radius, blocks=False)
    intensity = SUN * math.pi * radius**2
    build.light(place, (intensity, intensity, intensity), radius)
    lamp = build.material(MOTTLE, 1.0, white, detail=0.0, emission=(LAMP, 0.85 * LAMP, 0.6 * LAMP))
    build.sphere(lamp, (1.9, -3.2, 2.2), 0.2, blocks=False)
    pole = build.material(MOTTLE, 0.1, (0.06, 0.06, 0.07), (0.10, 0.10, 0.11), (0.14, 0.14, 0.15))
    build.cylinder(pole, (1.9, -3.2, 1.0), 0.04, 2.0)
    glow = 0.02 * LAMP
    build.light((1.9, -3.2, 2.2), (glow, 0.85 * glow, 0.6 * glow), 0.2)
