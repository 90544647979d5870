"""A relief under a light dome: the same things in the light of one known lamp after another.

World axes: metres, z up; the relief faces -y, from where camera and lamps look at it. Axes of lamps are those
of normal maps, x right, y up, z towards the camera, about the middle of the relief. The things rise from
their plane by at most 19 mm, a fortieth of the distance to the lamps.
"""

import math

from drivers.sim.scene.scene import Builder, Scene
from drivers.sim.scene.texture import BRICKS, MOTTLE, SPOTS, TILES, WOOD

RADIUS = 0.8
"""Radius of the dome, m."""
RINGS = ((12, 28.0), (8, 48.0), (4, 68.0))
"""Lamps on a ring, and its height above the plane of the relief, degrees."""
INTENSITY = 1400.0
"""Radiant intensity, at which white fits into 1/60 s at f/4 and ISO 100."""
ROOM = 2.0
"""Radiance of what light there is without a lamp."""
INDICATOR = 1e6
"""Radiance of a pilot lamp on the relief that all exposures clip."""
_INDICATOR_AT = (0.16, 0.001, -0.115)


def lamp_places() -> list[tuple[float, float, float]]:
    """Places of the lamps in their axes, m."""
    return [
        (
            RADIUS * math.cos(math.radians(height)) * math.cos(turn),
            RADIUS * math.cos(math.radians(height)) * math.sin(turn),
            RADIUS * math.sin(math.radians(height)),
        )
        for count, height in RINGS
        for turn in (2 * math.pi * (number + height / 90.0) / count for number in range(count))
    ]


def brightness(lamp: int) -> float:
    """Relative intensity of a lamp: no two are alike."""
    return 1.0 + 0.15 * math.sin(2.4 * lamp)


def dome_scene(lamp: int, factor: float = 1.0) -> Scene:
    """The scene in the light of a lamp, without any beyond the last one.

    factor: by which the lamp is brighter than it should be.
    """
    build = Builder()
    _relief(build)
    places = lamp_places()
    if lamp < len(places):
        x, y, z = places[lamp]
        intensity = INTENSITY * brightness(lamp) * factor
        build.light((x, -z, y), (intensity, 0.92 * intensity, 0.8 * intensity), 0.005)
    return build.scene((ROOM, ROOM, ROOM))


def _relief(build: Builder) -> None:
    """A panel, and what rises from it."""
    panel = build.material(
        TILES, (0.05, 1.0, 0.05), (0.55, 0.50, 0.42), (0.20, 0.30, 0.40), (0.48, 0.20, 0.14), edge=0.3,
        warp=0.4,
    )  # fmt: skip
    build.box(panel, (0.0, 0.01, 0.0), (0.46, 0.02, 0.34))
    mottled = build.material(
        MOTTLE, 0.03, (0.20, 0.30, 0.22), (0.40, 0.48, 0.36), (0.66, 0.66, 0.52), warp=1.0
    )
    build.sphere(mottled, (-0.12, 0.052, 0.06), 0.07)
    glazed = build.material(
        SPOTS, 0.035, (0.60, 0.56, 0.48), (0.50, 0.14, 0.10), (0.10, 0.22, 0.38), gloss=0.05, sharpness=120.0
    )
    build.sphere(glazed, (0.02, 0.052, 0.06), 0.07)
    bricks = build.material(
        BRICKS, (0.04, 0.04, 0.022), (0.20, 0.08, 0.05), (0.48, 0.24, 0.15), (0.60, 0.52, 0.44), edge=0.1
    )
    build.box(bricks, (0.15, 0.052, 0.06), (0.1, 0.1, 0.12), turn=45.0)
    wood = build.material(
        WOOD, (0.02, 0.06, 0.03), (0.24, 0.13, 0.07), (0.46, 0.29, 0.15), (0.62, 0.46, 0.28), edge=0.3
    )
    build.cylinder(wood, (-0.13, 0.032, -0.08), 0.05, 0.10)
    build.box(mottled, (0.0, 0.0, -0.08), (0.06, 0.036, 0.06))
    soot = build.material(MOTTLE, 0.03, (2e-5, 2e-5, 2e-5))
    build.box(soot, (0.10, 0.0, -0.08), (0.06, 0.002, 0.06))
    white = build.material(MOTTLE, 0.03, (0.9, 0.9, 0.9), detail=0.0)
    build.box(white, (0.16, 0.0, -0.07), (0.04, 0.002, 0.04))
    pilot = build.material(MOTTLE, 1.0, (1.0, 1.0, 1.0), detail=0.0, emission=(INDICATOR,) * 3)
    build.sphere(pilot, _INDICATOR_AT, 0.006, blocks=False)
