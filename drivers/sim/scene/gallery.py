"""A second scene: a gallery by day, with a window in view, things on plinths and a niche without light.

The window is the brightest there is, some 14 stops above the floor of the niche. Unlike the demo's table,
most surfaces are smooth and far, light is soft, and what is bright fills a part of the picture instead
of a spot: a method tuned to the one scene has to stand before the other.
"""

import math

from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, MOTTLE, SPOTS, TILES, WOOD

WINDOW = 12_000.0
"""Radiance of the window, so that it just fits into 1/1000 s at f/4 and ISO 100."""

_CORNER = 1.15
"""m, x and y of the corner of the room that the rig faces."""


def gallery_scene() -> Scene:
    """The scene; the rig looks at it as at the demo's."""
    build = Builder()
    _hall(build)
    _window(build)
    _plinths(build)
    _niche(build)
    ambient = 2.4e-3 * WINDOW
    return build.scene((0.85 * ambient, 0.95 * ambient, 1.1 * ambient))


def _hall(build: Builder) -> None:
    """Plaster, marble and boards."""

    def plaster() -> int:
        return build.material(
            MOTTLE, 0.5, (0.44, 0.41, 0.36), (0.56, 0.53, 0.48), (0.66, 0.64, 0.60), warp=0.6, detail=0.25
        )

    behind = plaster()
    left = build.material(
        MOTTLE, 0.18, (0.30, 0.10, 0.08), (0.42, 0.16, 0.12), (0.52, 0.24, 0.18), warp=1.0, detail=0.3
    )
    beside = plaster()
    right = build.material(
        TILES,
        (0.30, 1.0, 0.30),
        (0.46, 0.46, 0.42),
        (0.34, 0.38, 0.36),
        (0.62, 0.60, 0.54),
        edge=0.3,
        warp=0.2,
    )
    floor = build.material(
        TILES, (0.24, 0.24, 1.0), (0.10, 0.10, 0.11), (0.58, 0.56, 0.52), (0.36, 0.30, 0.26), edge=0.12
    )
    walls = (behind, left, beside, right, floor, plaster())
    build.room(walls, (_CORNER - 4.4, _CORNER - 4.4, 0.0), (_CORNER, _CORNER, 2.6))
    tapestry = build.material(
        TILES,
        (0.09, 0.09, 0.09),
        (0.08, 0.12, 0.26),
        (0.66, 0.52, 0.22),
        (0.50, 0.12, 0.10),
        edge=0.4,
        warp=0.8,
    )
    build.box(tapestry, (_CORNER - 0.01, 0.30, 1.25), (0.03, 0.62, 0.80))


def _window(build: Builder) -> None:
    """Panes of sky in the wall of high y, with bars before them, and the light that falls through."""
    sky = (0.80, 0.95, 1.10)
    pane = build.material(
        MOTTLE, 0.4, (0.8, 0.8, 0.8), (0.9, 0.9, 0.9), (1.0, 1.0, 1.0), detail=0.0,
        emission=(WINDOW * sky[0], WINDOW * sky[1], WINDOW * sky[2]),
    )  # fmt: skip
    bar = build.material(WOOD, (0.06, 0.2, 0.06), (0.12, 0.09, 0.06), (0.20, 0.15, 0.10), (0.30, 0.24, 0.17))
    x, z, wide, high = 0.42, 1.28, 0.40, 0.50
    build.box(pane, (x, _CORNER, z), (wide, 0.02, high), blocks=False)
    for across in (-wide / 2, 0.0, wide / 2):
        build.box(bar, (x + across, _CORNER - 0.02, z), (0.035, 0.06, high + 0.05))
    for up in (-high / 2, 0.06, high / 2):
        build.box(bar, (x, _CORNER - 0.02, z + up), (wide + 0.05, 0.06, 0.035))
    # A pane of radiance L and area A sends L A straight ahead; four points stand in for it.
    power = 0.6 * WINDOW * wide * high / 4
    for across in (-0.25, 0.25):
        for up in (-0.25, 0.25):
            place = (x + across * wide, _CORNER - 0.10, z + up * high)
            build.light(place, (power * sky[0], power * sky[1], power * sky[2]))
    build.light((-2.6, -1.2, 2.4), (0.03 * WINDOW, 0.026 * WINDOW, 0.02 * WINDOW))


def _plinths(build: Builder) -> None:
    """Four plinths: a bust, a glazed jar, a stack of stones, a column."""
    stone = build.material(
        MOTTLE, 0.05, (0.42, 0.40, 0.36), (0.55, 0.53, 0.49), (0.68, 0.66, 0.62), warp=1.0, detail=0.35
    )
    slate = build.material(
        BRICKS,
        (1e6, 0.16, 0.09),
        (0.08, 0.09, 0.10),
        (0.22, 0.23, 0.25),
        (0.34, 0.34, 0.34),
        edge=0.1,
        detail=0.3,
    )
    tops = ((-0.02, -0.05, 0.52), (-0.48, 0.14, 0.40), (0.44, -0.34, 0.34), (-0.10, 0.62, 0.62))
    for number, (x, y, top) in enumerate(tops):
        build.box(slate if number % 2 else stone, (x, y, top / 2), (0.30, 0.30, top), turn=12.0 * number)
    bronze = build.material(
        MOTTLE, 0.045, (0.10, 0.06, 0.03), (0.22, 0.13, 0.06), (0.34, 0.26, 0.12),
        warp=1.0, gloss=0.12, sharpness=80.0,
    )  # fmt: skip
    x, y, top = tops[0]
    build.cylinder(bronze, (x, y, top + 0.04), 0.10, 0.08)
    build.cylinder(bronze, (x, y, top + 0.12), 0.045, 0.10)
    build.sphere(bronze, (x, y, top + 0.25), 0.105)
    build.sphere(bronze, (x - 0.085, y - 0.06, top + 0.24), 0.03)
    jar = build.material(
        TILES, 0.05, (0.10, 0.22, 0.42), (0.78, 0.76, 0.68), (0.16, 0.34, 0.30), edge=0.5, warp=0.6,
        gloss=0.06, sharpness=200.0,
    )  # fmt: skip
    x, y, top = tops[1]
    build.sphere(jar, (x, y, top + 0.12), 0.12)
    build.cylinder(jar, (x, y, top + 0.26), 0.05, 0.06)
    x, y, top = tops[2]
    for number, (radius, up) in enumerate(((0.11, 0.08), (0.085, 0.22), (0.06, 0.34))):
        pebble = build.material(
            SPOTS,
            0.04,
            (0.50, 0.46, 0.40),
            (0.30 - 0.06 * number, 0.24, 0.20),
            (0.20, 0.22 + 0.05 * number, 0.26),
        )
        build.sphere(pebble, (x + 0.015 * number, y, top + up), radius)
    column = build.material(
        WOOD, (0.05, 0.05, 0.30), (0.50, 0.44, 0.34), (0.64, 0.58, 0.46), (0.40, 0.34, 0.26), edge=0.3
    )
    x, y, top = tops[3]
    build.cylinder(column, (x, y, top + 0.25), 0.07, 0.50)


def _niche(build: Builder) -> None:
    """A cupboard beside the plinths, open towards the rig, into which no lamp shines."""
    board = build.material(
        WOOD, (0.07, 0.20, 0.10), (0.20, 0.12, 0.07), (0.32, 0.20, 0.11), (0.44, 0.31, 0.19), edge=0.3
    )
    x, y, turn, wide, deep, high, thick = 0.52, 0.30, -40.0, 0.50, 0.34, 0.62, 0.02
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))

    def place(u: float, v: float, z: float) -> tuple[float, float, float]:
        return x + cos * u - sin * v, y + sin * u + cos * v, z

    build.box(board, place(0, 0, thick / 2), (wide, deep, thick), turn=turn)
    build.box(board, place(0, 0, high - thick / 2), (wide, deep, thick), turn=turn)
    # The other boards stand a little back, so that no two faces lie in one plane.
    inside = high - 2 * thick
    for side in (-1.0, 1.0):
        across = side * (wide / 2 - thick / 2 - 0.002)
        build.box(board, place(across, 0, high / 2), (thick, deep - 0.004, inside), turn=turn)
    back = deep / 2 - thick / 2 - 0.002
    build.box(board, place(0, back, high / 2), (wide - 2 * thick - 0.004, thick, inside), turn=turn)
    matt = build.material(
        TILES, 0.06, (0.06, 0.06, 0.08), (0.30, 0.24, 0.16), (0.14, 0.20, 0.18), edge=0.5, warp=0.5
    )
    build.sphere(matt, place(-0.10, 0.03, thick + 0.09), 0.09)
    build.cylinder(matt, place(0.11, 0.04, thick + 0.14), 0.06, 0.28)
    # The zone ends within the boards: a surface on its edge would be neither in nor out.
    inner = (wide - thick, deep, high - thick)
    build.dim_zone(place(0, 0, high / 2), inner, (0, 1, 0), reach=0.20, stops=1.6, turn=turn)
