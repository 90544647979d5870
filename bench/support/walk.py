"""Photographs of full size of a scene whose geometry and poses are known: a walk around a house.

A house with balconies, stones on the ground before it, and walls behind: some 150 boxes, whose faces are
covered by leaves of all sizes, each of them cut from a photograph at its full detail and lit by itself (the
"dead leaves" of Lee, Mumford and Huang, "Occlusion Models for Natural Images", 2001), so that the pictures
have texture to the pixel, bare parts too, and every edge is a corner in one place only. One ray a pixel,
the sun and the sky as brightness of each face, shot and read noise, JPEG, and exposure times that change with
the view, as an automatic exposure does. Rings around the house at different heights, three metres to nine
before it, turned a few degrees at random.
"""

import json
import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from bench.support.walk_rays import LEVELS, TILE, cast
from imaging.arrays import AnyArray, Array, Array32, Bytes, Integers
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.optics.lens import Lens, rays

SIZE = 4000, 3000
"""px."""
FOCAL = 0.78
"""Focal length relative to the width: 28 mm on a full frame."""
RING = 66
"""Photographs once around the house."""
LARGEST_LEAF, SMALLEST_LEAF = 900.0, 60.0
"""Texels."""
COVERED = 2.5
"""Times that leaves cover a face."""
NOISE = 3e-5, 1e-6
"""Variance of the signal: by the signal, and at none."""
SHUTTERS = (400, 500, 640)


@dataclass(frozen=True, eq=False)
class House:
    """boxes: float64 [B, 8], middle, half sizes, turn about the vertical (rad) and texels a metre; light: of
    each face, float32 [B, 6]. texels: uint8 [T, 3], sRGB; at: where each face's levels begin, their heights
    and widths, int64 [B, 6, LEVELS, 3]. Faces are -x, +x, -y, +y, -z, +z; z points up.
    """

    boxes: Array
    light: Array32
    texels: Bytes
    at: Integers


def lens_of(size: tuple[int, int]) -> Lens:
    """Lens of the camera: a barrel of 4 % at the corners, its axis a little off the middle."""
    width, height = size
    return Lens(
        model="RADIAL", width=width, height=height, fx=FOCAL * width, fy=FOCAL * width,
        cx=0.503 * width, cy=0.498 * height, k1=-0.08, k2=0.02,
    )  # fmt: skip


def house(photographs: Sequence[Path], seed: int = 0) -> House:
    """The scene, covered with pieces of photographs."""
    rng = np.random.default_rng(seed)
    boxes = np.array(_boxes(rng))
    sources = [cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB) for path in photographs]
    pieces: list[Bytes] = []
    at = np.zeros((len(boxes), 6, LEVELS, 3), np.int64)
    begin = 0
    for number, box in enumerate(boxes):
        for face in range(6):
            axis = face // 2
            across, up = (side for side in range(3) if side != axis)
            width, height = (max(round(2 * box[3 + side] * box[7]), 2) for side in (across, up))
            hidden = face == 4  # nothing is seen from below
            level = _leaves(2 if hidden else height, 2 if hidden else width, sources, rng)
            for step in range(LEVELS):
                at[number, face, step] = begin, *level.shape[:2]
                pieces.append(level.reshape(-1, 3))
                begin += len(pieces[-1])
                half = max(level.shape[1] // 2, 1), max(level.shape[0] // 2, 1)
                level = cv2.resize(level, half, interpolation=cv2.INTER_AREA)
    turns = boxes[:, 6, None] + np.radians([180, 0, 270, 90])
    light = np.empty((len(boxes), 6), np.float32)
    light[:, :4] = 0.35 + 0.55 * np.maximum(np.cos(turns - 0.6), 0)
    light[:, 4:] = 0.2, 0.85
    return House(boxes, light, np.concatenate(pieces), at)


def _boxes(rng: np.random.Generator) -> list[list[float]]:
    """The ground, the house, what stands out of its walls, stones, and walls far behind."""
    boxes = [[0, 0, -0.5, 10, 10, 0.5, 0, 250], [0, 0, -0.56, 40, 40, 0.5, 0, 60]]
    wide, deep, high = 3.5, 2.5, 2.4
    boxes.append([0, 0, high, wide, deep, high, 0, 330])
    for _ in range(48):
        side = rng.integers(4)
        out, along, up = rng.uniform(0.05, 0.5), rng.uniform(-0.9, 0.9), rng.uniform(0.3, 2 * high - 0.3)
        half = rng.uniform(0.12, 0.6, 2)
        sign = 1 if side % 2 else -1
        if side < 2:
            boxes.append([sign * wide, along * deep, up, out, half[0], half[1], 0, 330])
        else:
            boxes.append([along * wide, sign * deep, up, half[0], out, half[1], 0, 330])
    for _ in range(70):
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(4.2, 7.0)
        half = 0.12 + 0.25 * rng.random(3) ** 2
        boxes.append([
            distance * np.cos(angle), distance * np.sin(angle), half[2], *half, rng.uniform(0, np.pi), 330,
        ])  # fmt: skip
    for number in range(24):
        angle, distance, tall = 2 * np.pi * number / 24, rng.uniform(17, 22), rng.uniform(1.5, 4)
        at = distance * np.cos(angle), distance * np.sin(angle)
        boxes.append([*at, tall, 0.5, rng.uniform(2, 3.2), tall, angle + rng.normal(0, 0.2), 130])
    return boxes


def _leaves(height: int, width: int, sources: Sequence[Bytes], rng: np.random.Generator) -> Bytes:
    """A face covered by leaves, the later above the earlier."""
    face = np.full((height, width, 3), rng.integers(60, 200, 3), np.uint8)
    largest = min(LARGEST_LEAF, 0.6 * max(height, width))
    smallest = min(SMALLEST_LEAF, largest / 2)
    left = COVERED * height * width
    while left > 0:
        radius = float(smallest * (largest / smallest) ** rng.random())
        corners = int(rng.integers(3, 8))
        angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
        reach = radius * rng.uniform(0.5, 1, corners)
        x, y = rng.uniform(0, width), rng.uniform(0, height)
        outline = np.stack([x + reach * np.cos(angles), y + reach * np.sin(angles)], axis=1)
        left -= 0.6 * radius**2
        first = np.maximum(np.floor(outline.min(0)), 0).astype(int)
        last = np.minimum(np.ceil(outline.max(0)) + 1, (width, height)).astype(int)
        if (last - first < 2).any():
            continue
        wide, tall = (last - first).tolist()
        source = sources[int(rng.integers(len(sources)))]
        tall, wide = min(tall, source.shape[0]), min(wide, source.shape[1])
        top, side = (
            int(rng.integers(source.shape[0] - tall + 1)),
            int(rng.integers(source.shape[1] - wide + 1)),
        )
        piece = source[top : top + tall, side : side + wide][:: rng.choice([-1, 1]), :: rng.choice([-1, 1])]
        mask = np.zeros((tall, wide), np.uint8)
        cv2.fillPoly(mask, [np.rint(outline - first).astype(np.int32)], 1)
        tint = rng.uniform(0.6, 1.3) * rng.uniform(0.9, 1.1, 3)
        lit = np.minimum(np.arange(256) * tint[:, None], 255).astype(np.uint8)
        within = mask.astype(bool)
        part = face[first[1] : last[1], first[0] : last[0]]
        part[within] = np.stack([lit[band][piece[within][:, band]] for band in range(3)], axis=1)
    return face


def poses(count: int, seed: int = 1) -> Array:
    """cam_from_world [count, 4, 4]: rings around the house, one after another, as steady as a hand is."""
    rng = np.random.default_rng(seed)
    matrices = np.zeros((count, 4, 4))
    for number in range(count):
        ring = number // RING
        angle = 2 * np.pi * number / RING + rng.normal(0, 0.01)
        distance = (9.0, 7.6, 10.5)[ring % 3] + 0.5 * np.sin(3 * angle) + rng.normal(0, 0.05)
        centre = np.array([distance * np.cos(angle), distance * np.sin(angle), 1.5 + 0.5 * ring])
        centre[2] += rng.normal(0, 0.05)
        aim = np.array([0.0, 0.0, 1.6]) + rng.normal(0, 0.5, 3)
        ahead = (aim - centre) / np.linalg.norm(aim - centre)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        roll = rng.normal(0, 0.03)
        down = np.cross(ahead, right)
        c, s = np.cos(roll), np.sin(roll)
        axes = np.stack([c * right + s * down, c * down - s * right, ahead])
        matrices[number, :3, :3], matrices[number, :3, 3], matrices[number, 3, 3] = (
            axes,
            -axes @ centre,
            1,
        )
    return matrices


def take(scene: House, count: int, folder: Path, size: tuple[int, int] = SIZE) -> None:
    """Take the photographs, `0000.jpg` and so on, and write `truth.json` beside the folder's name."""
    folder.mkdir(parents=True, exist_ok=True)
    lens = lens_of(size)
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    directions = np.empty((size[1], size[0], 2), np.float32)
    for top in range(0, size[1], 100):
        part = rays(lens, np.stack([x[top : top + 100], y[top : top + 100]], axis=-1))
        directions[top : top + 100] = part[..., :2] / part[..., 2:]
    every = poses(count)

    def one(number: int) -> None:
        path = folder / f"{number:04d}.jpg"
        if path.exists():
            return
        shutter = SHUTTERS[number * 7 % len(SHUTTERS)]
        shown = _visible(scene, every[number], lens)
        pixels = np.empty((size[1], size[0], 3), np.uint8)
        cast(directions, every[number], lens.fx, scene.boxes, scene.light, scene.texels, scene.at, *shown,
              _LINEAR, _CODES, SHUTTERS[1] / shutter, *NOISE, np.uint64(number + 1), pixels)  # fmt: skip
        exif = Image.Exif()
        exif[0x010F], exif[0x0110] = "Bench", "Walk 12"
        inner = exif.get_ifd(0x8769)
        inner.update({0x829A: IFDRational(1, shutter), 0x829D: 2.8, 0x8827: 100, 0x920A: 4.0})
        inner[0xA405] = round(36 * FOCAL)
        inner[0x9003] = f"2024:06:01 12:{number // 60:02d}:{number % 60:02d}"
        part = folder / f"{number:04d}.part"
        Image.fromarray(pixels).save(part, "JPEG", quality=93, exif=exif)
        part.rename(path)

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(one, range(count)))
    truth = {f"{number:04d}.jpg": pose.tolist() for number, pose in enumerate(every)}
    folder.with_suffix(".json").write_text(json.dumps(truth))


def photographs(work: Path, count: int, size: tuple[int, int] = SIZE) -> Path:
    """The folder of that many photographs, made if need be; their truth is in the file of the same name."""
    folder = work / (f"walk-{count}" if size == SIZE else f"walk-{count}-{size[0]}")
    if not folder.with_suffix(".json").is_file():
        data = Path(os.environ["RIG_DATA"])
        sources = [
            *sorted(data.glob("sceaux/*.[jJ][pP][gG]"))[::3],
            *sorted(data.glob("monstree/*.jpg"))[::5],
        ]
        take(house(sources), count, folder, size)
    return folder


_LINEAR = srgb_decode(np.arange(256) / 255).astype(np.float32)
_CODES = np.rint(255 * srgb_encode(np.arange(8192) / 8191)).astype(np.uint8)


def _visible(scene: House, pose: Array, lens: Lens) -> tuple[AnyArray, AnyArray]:
    """Visibility of boxes in each tile: numbers, and the beginning of each tile's, [tiles + 1]."""
    rows, columns = math.ceil(lens.height / TILE), math.ceil(lens.width / TILE)
    shown = np.zeros((len(scene.boxes), rows, columns), bool)
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    for number, box in enumerate(scene.boxes):
        c, s = np.cos(box[6]), np.sin(box[6])
        corners = (signs * box[3:6]) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + box[:3]
        local = corners @ pose[:3, :3].T + pose[:3, 3]
        if (local[:, 2] < 0.2).all():
            continue
        if (local[:, 2] < 0.2).any():
            shown[number] = True
            continue
        # A barrel draws in what lies outside: no distortion, and without it, bound where a box is seen.
        flat = local[:, :2] / local[:, 2:] * lens.fx
        bounds = np.concatenate([flat, 0.85 * flat]) + np.array([lens.cx, lens.cy])
        first = np.floor(bounds.min(0) / TILE).astype(int) - 1
        last = np.floor(bounds.max(0) / TILE).astype(int) + 2
        shown[number, max(first[1], 0) : max(last[1], 0), max(first[0], 0) : max(last[0], 0)] = True
    tiles = shown.reshape(len(scene.boxes), -1).T
    return np.nonzero(tiles)[1], np.concatenate([[0], np.cumsum(tiles.sum(1))])
