"""A scene on a turntable in a light tent: things that turn, before walls that do not.

World axes are those of the things: z is the axis of the table, and turning them means turning the room the
other way. The light comes from everywhere, and from a flame that turns with the things and is too small to
light the walls, so that no shadow moves over them.
"""

import math

from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, MOTTLE, SPOTS, TILES, WOOD

MIDDLE = (0.0, 0.0, 0.11)
"""Place that the cameras look at, m."""
LIGHT, FLAME = 700.0, 16_000.0
"""Radiance of the tent, in which white fits into 1/60 s at f/4 and ISO 100, and of the flame."""
_RADIUS, _FLAME_RADIUS = 0.27, 0.01  # m


def turntable_scene(turn: float = 0.0, *, room: bool = True) -> Scene:
    """The scene with the table at a turn.

    turn: degrees by which the table stands further than at first, counterclockwise from above. room: False
    for the things alone.
    """
    build = Builder()
    _things(build)
    if room:
        _room(build, -turn)
    return build.scene((LIGHT, LIGHT, LIGHT))


def _things(build: Builder) -> None:
    """The table, and what stands on it."""
    plate = build.material(
        TILES, (0.045, 0.045, 1.0), (0.62, 0.58, 0.50), (0.14, 0.24, 0.36), (0.55, 0.20, 0.12), edge=0.3,
        warp=0.4, detail=0.3,
    )  # fmt: skip
    build.cylinder(plate, (0.0, 0.0, -0.012), _RADIUS, 0.024)
    bricks = build.material(
        BRICKS, (0.04, 0.04, 0.022), (0.20, 0.08, 0.05), (0.48, 0.24, 0.15), (0.60, 0.52, 0.44), edge=0.1,
        detail=0.3,
    )  # fmt: skip
    build.box(bricks, (0.07, 0.05, 0.12), (0.15, 0.13, 0.24), turn=25.0)
    wood = build.material(
        WOOD, (0.02, 0.06, 0.03), (0.24, 0.13, 0.07), (0.46, 0.29, 0.15), (0.62, 0.46, 0.28), edge=0.3,
        detail=0.3,
    )  # fmt: skip
    build.box(wood, (-0.12, -0.08, 0.05), (0.13, 0.10, 0.10), turn=-15.0)
    mottled = build.material(
        MOTTLE, 0.03, (0.12, 0.20, 0.15), (0.34, 0.42, 0.32), (0.64, 0.66, 0.52), warp=1.0, detail=0.4
    )
    build.sphere(mottled, (0.06, -0.15, 0.06), 0.06)
    spots = build.material(
        SPOTS, 0.035, (0.74, 0.70, 0.60), (0.60, 0.14, 0.10), (0.10, 0.22, 0.38), detail=0.2
    )
    build.cylinder(spots, (-0.11, 0.12, 0.09), 0.055, 0.18)
    build.box(spots, (0.07, 0.05, 0.29), (0.08, 0.09, 0.10), turn=-10.0)
    flame = build.material(
        MOTTLE, 1.0, (1.0, 1.0, 1.0), detail=0.0, emission=(FLAME, 0.8 * FLAME, 0.5 * FLAME)
    )
    build.sphere(flame, (-0.11, 0.12, 0.195), _FLAME_RADIUS, blocks=False)
    glow = math.pi * _FLAME_RADIUS**2 * FLAME
    build.light((-0.11, 0.12, 0.195), (glow, 0.8 * glow, 0.5 * glow), _FLAME_RADIUS)


def _room(build: Builder, turn: float) -> None:
    """Walls, a floor and a picture, all turned about the axis."""
    first = build.material(
        BRICKS, (0.3, 0.3, 0.12), (0.18, 0.09, 0.06), (0.42, 0.24, 0.16), (0.56, 0.50, 0.42), edge=0.1
    )
    for cell in (0.16, 0.22):
        build.material(SPOTS, cell, (0.50, 0.52, 0.56), (0.30, 0.18, 0.14), (0.12, 0.20, 0.30), detail=0.3)
    build.material(
        MOTTLE, 0.2, (0.24, 0.22, 0.18), (0.46, 0.42, 0.34), (0.66, 0.62, 0.56), warp=1.0, detail=0.3
    )
    build.material(
        TILES, (0.25, 0.25, 1.0), (0.12, 0.11, 0.10), (0.44, 0.42, 0.38), (0.28, 0.24, 0.22), edge=0.2
    )
    build.material(MOTTLE, 0.5, (0.7, 0.7, 0.7), (0.75, 0.75, 0.75), (0.8, 0.8, 0.8))
    walls = (first, first + 1, first + 2, first + 3, first + 4, first + 5)
    build.room(walls, (-1.7, -1.7, -0.9), (1.7, 1.7, 1.9), turn=turn)
