"""Pictures of a room with a painted wall and floor, by a pinhole of known focal length."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

WIDTH, HEIGHT, FOCAL = 320, 240, 260.0
rng = np.random.default_rng(6)


def painted() -> np.ndarray:
    """Tiles of random greys, 0..255, in two sizes one over the other."""
    fine, coarse = (
        np.kron(rng.integers(0, 256, (600 // size,) * 2), np.ones((size, size))) for size in (6, 15)
    )
    return np.asarray(gaussian_filter(np.where(coarse > 160, coarse, fine), 0.8))


PAINT = [painted(), painted()]


def picture(motion: np.ndarray) -> np.ndarray:
    """Pixels of a wall 5 m ahead, and of a floor 1.2 m below, by their rays."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5 - WIDTH / 2, np.arange(HEIGHT) + 0.5 - HEIGHT / 2)
    rays = np.stack([u / FOCAL, v / FOCAL, np.ones_like(u)], -1) @ motion[:3, :3]
    centre = -motion[:3, :3].T @ motion[:3, 3]
    with np.errstate(divide="ignore"):
        wall, floor = (5 - centre[2]) / rays[..., 2], (1.2 - centre[1]) / rays[..., 1]
    on_floor = (floor > 0) & (floor < wall)
    hit = centre + rays * np.where(on_floor, floor, wall)[..., None]
    across = np.where(on_floor, hit[..., 2], hit[..., 1])
    places = np.stack([40 * across + 250, 40 * hit[..., 0] + 200])
    sides = [map_coordinates(paint, places, order=1, mode="wrap") for paint in PAINT]
    return np.rint(np.where(on_floor, sides[1], sides[0])).astype(np.uint8)
