"""Twenty path-traced scenes whose views are easily taken for one another, and some that are honest."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from imaging.arrays import Array, Array32
from tests.foreign.photographs import probe
from tests.foreign.scenes import (
    Scene,
    Shape,
    box,
    floor,
    line,
    moved,
    plain,
    ring,
    spots,
    surface,
    upright,
    windows,
)

PLAIN = surface(plain(0.4))


def hall() -> Array32:
    """A light probe of a cathedral (Paul Debevec's), where RIG_DATA has it; else one that is made."""
    path = Path(os.environ.get("RIG_DATA", "")) / "radiance" / "Grace_Cathedral.hdr"
    return probe(path) if path.is_file() else windows(1)


def tiles(seed: int, across: int, down: int, difference: float = 0.0) -> np.ndarray:
    """One tile many times; difference: the share of a texture that is not repeated."""
    tile = spots(seed, 128)
    texture = np.tile(tile, (down, across, 1))
    size = texture.shape
    if difference:
        once = spots(seed + 100, max(size[:2]))[: size[0], : size[1]]
        texture = (1 - difference) * texture + difference * once
    return texture.astype(np.float32)


def column(bsdf: Shape) -> dict[str, Shape]:
    """A standing cylinder of radius 0.8 and height 2."""
    place = moved(0, 0, -1)
    return {
        "column": {
            "type": "cylinder",
            "p0": [0, 0, 0],
            "p1": [0, 0, 2],
            "radius": 0.8,
            "to_world": place,
            "bsdf": bsdf,
        }
    }


def ball(name: str, place: Array, bsdf: Shape) -> dict[str, Shape]:
    return {name: {"type": "sphere", "to_world": place, "bsdf": bsdf}}


def wall(name: str, turn: float, away: float, half: tuple[float, float], bsdf: Shape) -> dict[str, Shape]:
    """A wall that far from the middle, that faces it."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    shift = np.eye(4)
    shift[:3, 3] = away * c, away * s, 0
    sized = np.diag([half[0], half[1], 1.0, 1.0])
    return {name: {"type": "rectangle", "to_world": shift @ upright(turn + 180) @ sized, "bsdf": bsdf}}


def sides(*seeds: int, gloss: float = 0.0) -> list[Shape]:
    return [surface(spots(seed), gloss=gloss) for seed in seeds]


def room(*textures: np.ndarray) -> dict[str, Shape]:
    made = floor(PLAIN, half=4, z=-1.5)
    for number, texture in enumerate(textures):
        made |= wall(f"wall_{number}", 90.0 * number, 4, (4, 1.5), surface(texture))
    return made


AROUND = ring(20, 5.0, 1.5)
MANY = ring(28, 5.0, 1.5)


def _scenes() -> dict[str, Callable[[], Scene]]:
    def of(
        name: str,
        shapes: Callable[[], dict[str, Shape]],
        poses: Array = AROUND,
        light: Callable[[], Array32] = hall,
        width: int = 320,
    ) -> tuple[str, Callable[[], Scene]]:
        return name, lambda: Scene(name, shapes(), light(), poses, width, width * 3 // 4)

    twice = np.concatenate([ring(14, 4.5, 0.6, seed=1), ring(14, 4.5, 2.2, seed=2)])
    low = np.concatenate([ring(12, 4.5, 0.6, seed=1), ring(10, 4.5, 2.2, seed=2)])
    return dict(
        [
            of(
                "crate",
                lambda: (
                    box("box", sides(1, 2, 3, 4), surface(spots(5)), np.eye(4)) | floor(surface(spots(6)))
                ),
            ),
            of(
                "crate-alike",
                lambda: box("box", sides(1, 1, 1, 1), surface(spots(5)), np.eye(4)) | floor(PLAIN),
                MANY,
                width=400,
            ),
            of(
                "crate-alike-on-carpet",
                lambda: (
                    box("box", sides(1, 1, 1, 1), surface(spots(5)), np.eye(4)) | floor(surface(spots(6)))
                ),
                light=windows,
            ),
            of(
                "crate-opposite",
                lambda: box("box", sides(1, 2, 1, 2), surface(spots(5)), np.eye(4)) | floor(PLAIN),
            ),
            of("column-4", lambda: column(surface(tiles(7, 4, 1))) | floor(PLAIN), MANY, width=400),
            of("column-2", lambda: column(surface(tiles(8, 2, 1))) | floor(PLAIN), light=windows),
            of(
                "column-12",
                lambda: column(surface(tiles(9, 12, 4, difference=0.15))) | floor(surface(spots(6))),
            ),
            of(
                "ball",
                lambda: ball("ball", moved(0, 0, 0, size=(1.2, 1.2, 1.2)), surface(spots(10, 1024))),
                low,
            ),
            of("ball-tiled", lambda: ball("ball", np.eye(4), surface(tiles(11, 6, 3))), low),
            of("cube", lambda: {"cube": {"type": "cube", "bsdf": surface(spots(12))}}, twice, width=400),
            of(
                "four-crates",
                lambda: (
                    {
                        name: shape
                        for n, (x, y) in enumerate(((1, 1), (1, -1), (-1, -1), (-1, 1)))
                        for name, shape in box(
                            f"box{n}",
                            sides(1, 2, 3, 4),
                            surface(spots(5)),
                            moved(x, y, -0.5, turn=90 * n, size=(0.5,) * 3),
                        ).items()
                    }
                    | floor(PLAIN)
                ),
            ),
            of(
                "four-balls",
                lambda: (
                    ball("a", moved(1, 1, -0.4, size=(0.6,) * 3), surface(spots(13)))
                    | ball("b", moved(1, -1, -0.4, size=(0.6,) * 3), surface(spots(13)))
                    | ball("c", moved(-1, 1, -0.4, size=(0.6,) * 3), surface(spots(13)))
                    | ball("d", moved(-1, -1, -0.4, size=(0.6,) * 3), surface(spots(13)))
                    | floor(surface(tiles(14, 8, 8)))
                ),
                light=windows,
            ),
            of(
                "facade",
                lambda: wall("wall", 180, 0, (6, 1.5), surface(tiles(15, 12, 3))) | floor(PLAIN, 6, -1.5),
                line(18, 8, 3.0),
            ),
            of(
                "facade-weathered",
                lambda: (
                    wall("wall", 180, 0, (6, 1.5), surface(tiles(16, 12, 3, difference=0.2)))
                    | floor(PLAIN, 6, -1.5)
                ),
                line(18, 8, 3.0),
                windows,
            ),
            of("room-alike", lambda: room(*[spots(17)] * 4), ring(24, 1.5, 0.0, outwards=True), windows),
            of(
                "room-opposite",
                lambda: room(spots(18), spots(19), spots(18), spots(19)),
                ring(24, 1.5, 0.0, outwards=True),
            ),
            of(
                "varnished",
                lambda: (
                    box("box", sides(1, 2, 3, 4, gloss=0.05), surface(spots(5), gloss=0.05), np.eye(4))
                    | floor(surface(plain(0.4), gloss=0.05))
                ),
            ),
            of(
                "ball-varnished",
                lambda: ball("ball", np.eye(4), surface(tiles(20, 4, 2), gloss=0.05)) | floor(PLAIN),
            ),
            of(
                "chessboard",
                lambda: (
                    box("box", sides(1, 2, 1, 2), surface(spots(5)), moved(0, 0, -0.5, size=(0.5,) * 3))
                    | floor(surface(tiles(21, 12, 12)))
                ),
            ),
            of(
                "crate-few",
                lambda: box("box", sides(1, 1, 1, 1), surface(spots(5)), np.eye(4)) | floor(PLAIN),
                ring(12, 5.0, 1.5, seed=3),
            ),
        ]
    )


SCENES = _scenes()
DEVELOPED = ("crate-opposite", "column-2", "four-balls", "facade-weathered", "chessboard")
"""Scenes that are taken as JPEGs."""
