"""Subjects of foreign photographs: a room with lamps, metal, mirror and glass; objects before a light
probe.
"""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from imaging.arrays import Array, Array32

from .lit import LitScene, Panel
from .photographs import probe
from .scenes import Shape, look_at, moved, plain, ring, spots, upright, windows

GOLD: Shape = {"type": "roughconductor", "material": "Au", "alpha": 0.25}
POLISHED: Shape = {"type": "roughconductor", "material": "Au", "alpha": 0.06}
MIRROR: Shape = {"type": "twosided", "bsdf": {"type": "conductor", "material": "none"}}
GLASS: Shape = {"type": "dielectric", "int_ior": 1.5}


def room(
    name: str = "room", views: int = 28, width: int = 400, samples: int = 16, traced: int = 128
) -> LitScene:
    """A room 6 by 6 by 3, looked at across its middle: lamps 18 stops above the light under a table."""
    half, tall = 3.0, 1.5
    panels = {
        "floor": Panel(moved(0, 0, -tall, size=(half, half, 1)), spots(1, 768, 0.7), (48, 48)),
        "ceiling": Panel(_over(moved(0, 0, tall, size=(half, half, 1))), 0.6 * spots(2), (32, 32)),
    }
    for number in range(4):
        turn = 90.0 * number
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        place = moved(half * c, half * s, 0) @ upright(turn + 180) @ np.diag([half, tall, 1, 1])
        panels[f"wall_{number}"] = Panel(place, _stretched(spots(10 + number, 768, 0.7), 2, 1), (48, 24))
    panels |= _table("table", (1.75, 1.5, -0.6), (0.8, 0.7, 0.05), 0.85, 20)
    panels |= _slab("plinth", moved(-1.9, 0.9, -1.0, turn=20, size=(0.4, 0.4, 0.5)), 30, (8, 8))
    panels |= _slab("chest", moved(-1.0, -2.0, -1.1, turn=-15, size=(0.7, 0.4, 0.4)), 40, (8, 8))
    panels |= _slab("crate", moved(0.1, -0.1, -0.95, turn=35, size=(0.4, 0.3, 0.55)), 70, (8, 8))
    shapes: dict[str, Shape] = {
        "lamp_bright": _lamp(-0.6, 2.3, 0.75, 0.05, (12e3, 10e3, 7e3)),
        "lamp_warm": _lamp(-2.4, -2.3, 0.6, 0.08, (900.0, 520.0, 200.0)),
        "lamp_dim": _lamp(2.5, -1.6, -0.9, 0.1, (60.0, 70.0, 90.0)),
        "glass": _ball(1.55, 1.2, -0.25, 0.3, GLASS),
        "gold": _ball(-1.9, 0.9, -0.15, 0.35, GOLD),
        "polished": _ball(-0.9, -1.9, -0.42, 0.28, POLISHED),
        "mirror": {
            "type": "rectangle",
            "to_world": moved(0.3, -half + 0.02, 0.1) @ upright(90) @ np.diag([0.6, 0.8, 1, 1]),
            "bsdf": MIRROR,
        },
    }
    poses = np.stack([_looking_around(number, views) for number in range(views)])
    return LitScene(name, panels, shapes, poses, None, 65.0, width, width * 3 // 4, samples, traced)


def objects(
    name: str = "objects",
    views: int = 28,
    width: int = 400,
    samples: int = 16,
    traced: int = 128,
    span: float = 360.0,
) -> LitScene:
    """A crate, each side of its own, between metal and glass on a square of ground before a light probe.

    span: degrees of the way around it that the views stand on.
    """
    panels = {"floor": Panel(moved(0, 0, -1, size=(2.6, 2.6, 1)), spots(51, 768), (40, 40))}
    panels |= _slab("crate", moved(0, 0, -0.25, turn=25, size=(0.75, 0.75, 0.75)), 60, (16, 16))
    shapes = {
        "gold": _ball(1.5, -0.6, -0.55, 0.45, GOLD),
        "polished": _ball(-1.3, 1.0, -0.6, 0.4, POLISHED),
        "glass": _ball(-0.8, -1.5, -0.6, 0.4, GLASS),
    }
    # Somebody walks around, and holds the camera low and high by turns.
    low, high = (ring(views, away, up, span=span, seed=1) for away, up in ((4.5, 0.9), (4.2, 2.0)))
    poses = np.where(np.arange(views)[:, None, None] % 2, high, low)
    return LitScene(name, panels, shapes, poses, cathedral(), 50.0, width, width * 3 // 4, samples, traced)


def cathedral() -> Array32:
    """Grace Cathedral (Paul Debevec's light probe), where RIG_DATA has it; else windows that are made up."""
    path = Path(os.environ.get("RIG_DATA", "")) / "radiance" / "Grace_Cathedral.hdr"
    return probe(path) if path.is_file() else windows(1)


def _lamp(x: float, y: float, z: float, radius: float, light: Sequence[float]) -> Shape:
    bsdf: Shape = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    emitter: Shape = {"type": "area", "radiance": {"type": "rgb", "value": list(light)}}
    return _ball(x, y, z, radius, bsdf) | {"emitter": emitter}


def _ball(x: float, y: float, z: float, radius: float, bsdf: Shape) -> Shape:
    return {"type": "sphere", "to_world": moved(x, y, z, size=(radius,) * 3), "bsdf": bsdf}


def _slab(name: str, place: Array, seed: int, texels: tuple[int, int]) -> dict[str, Panel]:
    """A block, two units across before `place`, of panels that face outwards; each has its own texture."""
    panels = {}
    for number in range(4):
        turn = 90.0 * number
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        side = place @ moved(c, s, 0) @ upright(turn)
        panels[f"{name}_{number}"] = Panel(side, spots(seed + number, 256), texels)
    panels[f"{name}_top"] = Panel(place @ moved(0, 0, 1), spots(seed + 4, 256), texels)
    return panels


def _table(
    name: str, centre: tuple[float, float, float], half: tuple[float, float, float], legs: float, seed: int
) -> dict[str, Panel]:
    """A board on four legs, dark beneath."""
    x, y, z = centre
    panels = _slab(f"{name}_board", moved(x, y, z, size=half), seed, (16, 2))
    below = moved(x, y, z - half[2], size=(half[0], half[1], 1))
    panels[f"{name}_board_top"] = Panel(
        moved(x, y, z + half[2], size=(*half[:2], 1)), spots(seed + 4, 256), (16, 16)
    )
    panels[f"{name}_below"] = Panel(_over(below), spots(seed + 5, 256), (8, 8))
    for number, (right, back) in enumerate(((1, 1), (1, -1), (-1, -1), (-1, 1))):
        foot = moved(
            x + right * (half[0] - 0.06),
            y + back * (half[1] - 0.06),
            z - half[2] - legs / 2,
            size=(0.05, 0.05, legs / 2),
        )
        for side, panel in _slab(f"{name}_leg{number}", foot, seed + 5, (2, 8)).items():
            if not side.endswith("top"):
                panels[side] = Panel(panel.place, plain(0.3), panel.texels)
    return panels


def _looking_around(number: int, count: int) -> Array:
    """One of so many poses around the middle, across it to the other side, now level, now a little down."""
    rng = np.random.default_rng([count, number])
    turn = 2 * np.pi * number / count + rng.normal(0, 0.03)
    ahead = np.array([np.cos(turn), np.sin(turn), (0.0, -0.2)[number % 2] + rng.normal(0, 0.02)])
    centre = -(1.6 + rng.normal(0, 0.05)) * ahead * (1, 1, 0) + (0, 0, (0.0, 0.3)[number % 2])
    return look_at(centre, centre + ahead)


def _over(place: Array) -> Array:
    """The same rectangle, facing the other way."""
    return np.asarray(place @ np.diag([1.0, -1.0, -1.0, 1.0]))


def _stretched(texture: Array32, across: int, up: int) -> Array32:
    """A part of the texture in the proportions of what it covers."""
    rows, columns = texture.shape[:2]
    return np.ascontiguousarray(
        texture[: rows * up // max(across, up), : columns * across // max(across, up)]
    )
