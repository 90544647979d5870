"""The demo scene: a laid table in the corner of a room at night, under one bare lamp.

The lamp is a ball of radiance 1 (times `LAMP`); everything else follows from its size and distance,
plus a little cold light from a window and a dim ambient. The open crate and the floor under the
table are in deep shadow, so the scene spans some 17 stops.
"""

import math

from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, MOTTLE, SPOTS, TILES, WOOD

LAMP = 16_000.0
"""Radiance of the lamp, so that it just fits into 1/1000 s at f/4 and ISO 100."""

TARGET = (0.0, 0.0, 0.60)
"""Point at which the rig aims: the middle of the table top, m."""

_TOP = 0.50  # height of the table top, m
_LAMP_AT, _LAMP_RADIUS = (-0.10, 0.02, 1.06), 0.10


def demo_scene() -> Scene:
    """The scene that every simulated rig looks at."""
    build = Builder()
    _room(build)
    _table(build)
    _things(build)
    _crate(build)
    _lights(build)
    ambient = 3.2e-4 * LAMP
    return build.scene((0.80 * ambient, 0.95 * ambient, 1.25 * ambient))


def _room(build: Builder) -> None:
    def plain() -> int:
        return build.material(MOTTLE, 0.4, (0.4, 0.4, 0.38), (0.5, 0.5, 0.48), (0.6, 0.6, 0.58))

    behind = plain()
    brick = build.material(
        BRICKS,
        (1e6, 0.24, 0.12),
        (0.18, 0.07, 0.045),
        (0.50, 0.25, 0.16),
        (0.70, 0.58, 0.48),
        edge=0.09,
        detail=0.3,
    )
    beside = plain()
    sage = build.material(
        MOTTLE, 0.12, (0.13, 0.19, 0.14), (0.34, 0.42, 0.33), (0.62, 0.66, 0.54), warp=1.0, detail=0.3
    )
    floor = build.material(
        WOOD, (0.16, 0.55, 1.0), (0.20, 0.11, 0.06), (0.38, 0.23, 0.12), (0.55, 0.38, 0.22), edge=0.2
    )
    corner = 1.15
    walls = (behind, brick, beside, sage, floor, plain())
    build.room(walls, (corner - 4.4, corner - 4.4, 0.0), (corner, corner, 2.6))
    picture = build.material(
        TILES,
        (0.13, 1.0, 0.11),
        (0.06, 0.10, 0.30),
        (0.75, 0.30, 0.10),
        (0.85, 0.80, 0.60),
        edge=0.35,
        warp=0.7,
    )
    print_ = build.material(
        SPOTS, (1.0, 0.15, 0.15), (0.75, 0.72, 0.62), (0.62, 0.12, 0.10), (0.08, 0.22, 0.38), detail=0.1
    )
    frame = build.material(WOOD, (0.06, 0.2, 0.06), (0.05, 0.03, 0.02), (0.09, 0.06, 0.04), (0.14, 0.1, 0.07))
    build.box(frame, (-0.12, corner, 1.16), (0.68, 0.04, 0.52))
    build.box(picture, (-0.12, corner - 0.01, 1.16), (0.60, 0.05, 0.44))
    build.box(frame, (corner, 0.10, 1.18), (0.04, 0.52, 0.60))
    build.box(print_, (corner - 0.01, 0.10, 1.18), (0.05, 0.44, 0.52))
    rug = build.material(
        TILES,
        (0.11, 0.11, 1.0),
        (0.35, 0.05, 0.05),
        (0.60, 0.35, 0.14),
        (0.10, 0.14, 0.26),
        edge=0.45,
        warp=0.5,
    )
    build.box(rug, (-0.15, -0.15, 0.005), (1.9, 1.5, 0.03), turn=8.0, blocks=False)


def _table(build: Builder) -> None:
    wood = build.material(
        WOOD, (0.12, 0.30, 1.0), (0.30, 0.15, 0.07), (0.50, 0.29, 0.14), (0.68, 0.47, 0.27), edge=0.2
    )
    build.box(wood, (0.0, 0.0, _TOP - 0.02), (1.25, 0.95, 0.04))
    for x in (-0.56, 0.56):
        for y in (-0.41, 0.41):
            build.box(wood, (x, y, _TOP / 2 - 0.02), (0.06, 0.06, _TOP - 0.04))
    cloth = build.material(
        TILES,
        (0.07, 0.07, 1.0),
        (0.70, 0.66, 0.55),
        (0.16, 0.30, 0.42),
        (0.60, 0.16, 0.12),
        edge=0.5,
        warp=0.4,
    )
    build.box(cloth, (-0.12, -0.10, _TOP + 0.003), (0.62, 0.44, 0.006), turn=-12.0)
    chest = build.material(
        TILES, (0.09, 0.09, 0.09), (0.10, 0.08, 0.05), (0.30, 0.26, 0.18), (0.55, 0.50, 0.40), edge=0.5
    )
    build.box(chest, (0.10, -0.06, 0.13), (0.40, 0.30, 0.22), turn=20.0)
    build.dim_zone((0.0, 0.0, 0.23), (1.25, 0.95, 0.50), (3, 3, 0), reach=0.30, stops=1.5)


def _things(build: Builder) -> None:
    glazed = build.material(
        MOTTLE,
        0.06,
        (0.02, 0.06, 0.16),
        (0.04, 0.16, 0.32),
        (0.10, 0.34, 0.46),
        warp=1.0,
        gloss=0.10,
        sharpness=220.0,
    )
    build.sphere(glazed, (-0.02, -0.16, _TOP + 0.116), 0.11)
    ball = build.material(
        TILES, 0.075, (0.80, 0.30, 0.06), (0.85, 0.72, 0.45), (0.12, 0.34, 0.30), edge=0.4, warp=0.3
    )
    build.sphere(ball, (-0.36, 0.10, _TOP + 0.10), 0.10)
    mug = build.material(
        SPOTS, 0.06, (0.72, 0.70, 0.66), (0.25, 0.10, 0.35), (0.75, 0.45, 0.08), gloss=0.04, sharpness=60.0
    )
    build.cylinder(mug, (-0.40, -0.24, _TOP + 0.065), 0.05, 0.13)
    marble = build.material(
        MOTTLE, 0.035, (0.05, 0.20, 0.06), (0.20, 0.45, 0.12), (0.55, 0.70, 0.30), gloss=0.08, sharpness=150.0
    )
    build.sphere(marble, (0.21, -0.33, _TOP + 0.055), 0.055)
    covers = (
        ((0.10, 0.22, 0.34), (0.24, 0.42, 0.52), (0.62, 0.66, 0.60)),
        ((0.42, 0.08, 0.07), (0.62, 0.26, 0.16), (0.78, 0.62, 0.42)),
        ((0.14, 0.26, 0.12), (0.34, 0.44, 0.18), (0.66, 0.64, 0.38)),
    )
    height = _TOP
    for number, colours in enumerate(covers):
        cover = build.material(TILES, 0.055, *colours, edge=0.6, warp=0.6)
        thick = (0.05, 0.04, 0.045)[number]
        build.box(
            cover,
            (-0.20 + 0.01 * number, 0.32, height + thick / 2),
            (0.30 - 0.03 * number, 0.21 - 0.015 * number, thick),
            turn=(14.0, -4.0, 25.0)[number],
        )
        height += thick
    vase = build.material(
        TILES, (0.06, 0.06, 0.05), (0.10, 0.30, 0.32), (0.70, 0.66, 0.50), (0.72, 0.36, 0.12), edge=0.5
    )
    build.cylinder(vase, (0.10, 0.30, _TOP + 0.15), 0.065, 0.30)


def _crate(build: Builder) -> None:
    """A crate on its side: open towards the rig, black inside but for what lies in it."""
    wood = build.material(
        WOOD, (0.06, 0.16, 0.09), (0.26, 0.16, 0.09), (0.42, 0.28, 0.16), (0.60, 0.44, 0.28), edge=0.3
    )
    x, y, turn, size, deep, board = 0.40, 0.08, -30.0, 0.36, 0.30, 0.018
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def place(u: float, v: float, z: float) -> tuple[float, float, float]:
        return x + cos * u - sin * v, y + sin * u + cos * v, _TOP + z

    middle = size / 2
    build.box(wood, place(0, 0, board / 2), (size, deep, board), turn=turn)
    build.box(wood, place(0, 0, size - board / 2), (size, deep, board), turn=turn)
    # The other boards stand a little back, so that no two faces lie in one plane.
    high, back = size - 2 * board, deep / 2 - board / 2 - 0.002
    for side in (-1.0, 1.0):
        across = side * (middle - board / 2 - 0.002)
        build.box(wood, place(across, 0, middle), (board, deep - 0.004, high), turn=turn)
    build.box(wood, place(0, back, middle), (size - 2 * board - 0.004, board, high), turn=turn)
    dark = build.material(
        TILES, 0.06, (0.05, 0.05, 0.06), (0.16, 0.14, 0.12), (0.42, 0.34, 0.24), edge=0.5, warp=0.4
    )
    build.sphere(dark, place(-0.06, 0.02, board + 0.07), 0.07)
    build.box(dark, place(0.09, 0.05, board + 0.10), (0.09, 0.09, 0.20), turn=turn + 15.0)
    # The zone ends within the boards: a surface on its edge would be neither in nor out.
    inner = (size - board, deep, size - board)
    build.dim_zone(place(0, 0, middle), inner, (0, 1, 0), reach=0.22, stops=1.0, turn=turn)


def _lights(build: Builder) -> None:
    colour = (1.0, 0.82, 0.58)
    paper = build.material(
        MOTTLE,
        (0.05, 0.05, 0.025),
        (0.72, 0.72, 0.72),
        (0.84, 0.84, 0.84),
        (1.0, 1.0, 1.0),
        detail=0.0,
        emission=(LAMP * colour[0], LAMP * colour[1], LAMP * colour[2]),
    )
    build.sphere(paper, _LAMP_AT, _LAMP_RADIUS, blocks=False)
    cord = build.material(MOTTLE, 0.05, (0.10, 0.10, 0.10), (0.14, 0.14, 0.14), (0.18, 0.18, 0.18))
    x, y, z = _LAMP_AT
    build.cylinder(cord, (x, y, (z + _LAMP_RADIUS + 2.6) / 2), 0.012, 2.6 - z - _LAMP_RADIUS, blocks=False)
    # A ball of radiance L and radius r seen from afar has the intensity L pi r^2.
    area = math.pi * _LAMP_RADIUS**2 * 0.85 * LAMP
    build.light(_LAMP_AT, (area * colour[0], area * colour[1], area * colour[2]), _LAMP_RADIUS)
    window = 6.0e-3 * LAMP
    build.light((-2.2, 0.2, 2.2), (0.55 * window, 0.75 * window, 1.0 * window))
