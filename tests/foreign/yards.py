"""Yards against the sun: a wall and a house before a bright sky, and a dark room behind a door."""

import numpy as np

from imaging.arrays import Array, Array32

from .lit import LitScene, Panel
from .scenes import look_at, moved, spots, upright

GROUND = -1.0
WALL = 4.0
"""Place of the wall along x, and of the front of the house a little before it."""
FRONT = 2.6
SUN = 3e4
"""Radiance of its disc; the sky's is about 1."""


LOW, HIGH = (62.0, 15.0), (102.0, 23.0)
"""Azimuth and elevation of the two suns, degrees."""


def low_sun(
    name: str = "low-sun", views: int = 24, width: int = 160, samples: int = 9, traced: int = 128
) -> LitScene:
    """The sun just above a high wall, which hides it from some of the views; a shallow room."""
    poses = _along(views, 0)
    return _yard(name, LOW, 2.0, 2.2, 0, poses, width, samples, traced)


def high_sun(
    name: str = "high-sun", views: int = 24, width: int = 160, samples: int = 9, traced: int = 128
) -> LitScene:
    """The sun over the roof of the house, before a low wall; a deep room."""
    poses = _along(views, 1)
    return _yard(name, HIGH, 0.4, 4.5, 100, poses, width, samples, traced)


def _yard(
    name: str,
    sun: tuple[float, float],
    top: float,
    deep: float,
    seed: int,
    poses: Array,
    width: int,
    samples: int,
    traced: int,
) -> LitScene:
    """Ground, a wall up to `top`, a house whose room is so deep; sun: azimuth and elevation, degrees."""
    panels = {
        "ground": Panel(moved(0, 0, GROUND, size=(5.5, 5.5, 1)), _plaster(seed + 1, 256), (40, 40)),
        "wall": _standing(WALL, (-0.2, 5.5), (GROUND, top), seed + 2, (32, 16)),
    }
    panels |= _house(deep, seed + 10)
    block = moved(0.9, 1.2, GROUND + 0.4, turn=30, size=(0.4, 0.4, 0.4))
    for number in range(4):
        turn = np.radians(90.0 * number)
        side = block @ moved(np.cos(turn), np.sin(turn), 0) @ upright(90.0 * number)
        panels[f"block_{number}"] = Panel(side, _plaster(seed + 30 + number, 32), (8, 8))
    panels["block_top"] = Panel(block @ moved(0, 0, 1), _plaster(seed + 34, 32), (8, 8))
    return LitScene(name, panels, {}, poses, sky(*sun), 65.0, width, width * 3 // 4, samples, traced)


def sky(azimuth: float, elevation: float, rows: int = 256) -> Array32:
    """A light probe [rows, 2 rows, 3] of `sky_light`."""
    across = 2 * np.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    down = np.pi * (np.arange(rows) + 0.5) / rows
    x, y = np.sin(down)[:, None] * np.sin(across), np.sin(down)[:, None] * np.cos(across)
    directions = np.stack([x, y, np.broadcast_to(np.cos(down)[:, None], x.shape)], -1)
    return sky_light(directions, azimuth, elevation)


def sky_light(directions: Array, azimuth: float, elevation: float) -> Array32:
    """Radiance [..., 3] from unit directions [..., 3]: a sky of about 1, and the sun in its halo.

    azimuth: of the sun, degrees from y towards x; elevation: degrees.
    """
    turn, up = np.radians(azimuth), np.radians(elevation)
    sun = np.array([np.cos(up) * np.sin(turn), np.cos(up) * np.cos(turn), np.sin(up)])
    away = np.degrees(np.arccos(np.clip(directions @ sun, -1, 1)))[..., None]
    height = directions[..., 2:]
    blue, haze = np.array([0.45, 0.7, 1.2]), np.array([1.0, 1.0, 0.95])
    light = np.where(height > 0, blue + (haze - blue) * np.exp(-5 * np.maximum(height, 0)), 0.25)
    warm = np.array([1.0, 0.9, 0.75])
    light = light + warm * (400 * np.exp(-away / 1.5) + 12 * np.exp(-away / 9))
    return np.where(away < 1.2, SUN * warm, light).astype(np.float32)


def _plaster(seed: int, part: int = 96) -> Array32:
    """So many of 256 pixels of blots, which are then as large as pictures of this size can show."""
    return np.ascontiguousarray(spots(seed, 256, 0.8)[:part, :part])


def _along(views: int, seed: int) -> Array:
    """Poses [views, 4, 4] across the yard, low and high by turns, as of somebody who walks along it."""
    rng = np.random.default_rng([seed, views])
    poses = []
    for number, y in enumerate(np.linspace(-2.6, 2.6, views)):
        centre = np.array([-2.4 + (0.0, 1.1)[number % 3 == 0], y, (0.1, 0.9)[number % 2]])
        centre += rng.normal(0, 0.08, 3)
        poses.append(look_at(centre, [3.5, 0.35 * y - 0.4 + rng.normal(0, 0.1), 0.45 + rng.normal(0, 0.05)]))
    return np.stack(poses)


def _standing(
    x: float,
    y: tuple[float, float],
    z: tuple[float, float],
    seed: int,
    texels: tuple[int, int],
    turn: float = 180.0,
) -> Panel:
    """A panel across x, y[0] to y[1] and z[0] to z[1]; turn: 180 faces the cameras, 0 away from them."""
    size = np.diag([(y[1] - y[0]) / 2, (z[1] - z[0]) / 2, 1, 1])
    place = moved(x, sum(y) / 2, sum(z) / 2) @ upright(turn) @ size
    return Panel(place, _plaster(seed), texels)


def _beside(
    y: float,
    x: tuple[float, float],
    z: tuple[float, float],
    seed: int,
    texels: tuple[int, int],
    turn: float,
) -> Panel:
    """The same across y from x[0] to x[1]; turn: 90 faces along y, -90 against it."""
    size = np.diag([(x[1] - x[0]) / 2, (z[1] - z[0]) / 2, 1, 1])
    return Panel(moved(sum(x) / 2, y, sum(z) / 2) @ upright(turn) @ size, _plaster(seed), texels)


def _house(deep: float, seed: int) -> dict[str, Panel]:
    """A house of `left` to `right`, its front broken by a door, and the inside of its only room."""
    left, right, roof, door, lintel, thin = -3.4, -0.3, 1.5, (-2.2, -1.3), 0.9, 0.02
    back = FRONT + deep
    panels = {}
    for side, x, turn in (("front", FRONT, 180.0), ("inner", FRONT + thin, 0.0)):
        seed_of_side = seed if side == "front" else seed + 3
        panels[f"{side}_left"] = _standing(x, (left, door[0]), (GROUND, roof), seed_of_side, (10, 16), turn)
        panels[f"{side}_right"] = _standing(
            x, (door[1], right), (GROUND, roof), seed_of_side + 1, (10, 16), turn
        )
        panels[f"{side}_lintel"] = _standing(x, door, (lintel, roof), seed_of_side + 2, (8, 6), turn)
    upper, inside = (GROUND, roof), (left + thin, right - thin)
    panels |= {
        "side_left": _beside(left, (FRONT, back), upper, seed + 6, (16, 16), -90.0),
        "side_right": _beside(right, (FRONT, back), upper, seed + 7, (16, 16), 90.0),
        "behind": _standing(back, (left, right), upper, seed + 8, (8, 8), 0.0),
        "room_left": _beside(left + thin, (FRONT, back), upper, seed + 9, (24, 16), 90.0),
        "room_right": _beside(right - thin, (FRONT, back), upper, seed + 10, (24, 16), -90.0),
        "room_back": _standing(back - thin, inside, upper, seed + 11, (24, 20), 180.0),
    }
    middle, half = ((FRONT + back) / 2, (left + right) / 2), (deep / 2, (right - left) / 2)
    over = np.diag([1.0, -1.0, -1.0, 1.0])
    panels["roof"] = Panel(moved(*middle, roof, size=(*half, 1)), _plaster(seed + 12), (8, 8))
    panels["room_ceiling"] = Panel(
        moved(*middle, roof - thin, size=(*half, 1)) @ over, _plaster(seed + 13), (16, 16)
    )
    panels["room_floor"] = Panel(
        moved(*middle, GROUND + thin, size=(*half, 1)), _plaster(seed + 14), (20, 20)
    )
    return panels
