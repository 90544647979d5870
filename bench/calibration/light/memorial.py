"""Stanford memorial church: Debevec and Malik's exposures, and their radiance map.

The map's file is found in the wild with every byte 10 and 13 turned into both of them, as a transfer of
text does. Rows whose run lengths then have a single reading are read; bytes lost in them are NaN.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from imaging.arrays import Array, Bytes, Floats, Integers, Mask
from imaging.files.photo import read_photo

LOST = -1
HEIGHT, WIDTH = 768, 512
MARK = bytes([2, 2, WIDTH >> 8, WIDTH & 255])


@dataclass(frozen=True, eq=False)
class Series:
    """codes: uint8 [H, W, 3] of each exposure, ascending in times [N], s; valid: bool [H, W]."""

    codes: list[Bytes]
    times: Array
    valid: Mask


def series(folder: Path) -> Series:
    """The exposures; pure blue borders, which alignment left, are not valid, nor are pixels near them."""
    lines = [line.split() for line in (folder / "image_list.txt").read_text().splitlines()]
    listed = sorted((float(line[1]), line[0]) for line in lines if line and line[0].endswith(".png"))
    codes = [np.rint(255 * read_photo(folder / name).pixels).astype(np.uint8) for _, name in listed]
    blue = np.any([(code == (0, 0, 255)).all(-1) for code in codes], axis=0)
    near = cv2.dilate(blue.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return Series(codes, np.array([time for time, _ in listed]), ~near)


def radiance(path: Path) -> Array:
    """The authors' map, float64 [H, W, 3]; NaN where the file is ambiguous."""
    data = path.read_bytes()
    damaged = b"\r\n" in data[:200]
    body = data[data.index(MARK) :]
    image = np.full((HEIGHT, WIDTH, 3), np.nan)
    for row, part in enumerate(body.split(MARK)[1 : HEIGHT + 1]):
        planes = _row(_tokens(part, damaged))
        if planes is None:
            continue
        rgb, exponent = planes[:3].T, planes[3][:, None]
        light = np.ldexp(rgb + 0.5, exponent - 136)
        image[row] = np.where((rgb > 0) & (exponent > 0), light, np.nan)
    return image


def _tokens(data: bytes, damaged: bool) -> tuple[int, ...]:
    if not damaged:
        return tuple(data)
    pieces = data.split(b"\r\n")
    return tuple(token for piece in pieces for token in (*piece, LOST))[:-1]


def _row(tokens: tuple[int, ...]) -> Integers | None:
    """The four planes [4, W] of a run-length encoded row; None unless it can be read in just one way."""

    @cache
    def ways(place: int, x: int) -> tuple[int, tuple[int, int] | None]:
        """Count the readings of the rest, and the run (length, next place) that begins one of them."""
        if x == 4 * WIDTH:
            return int(place == len(tokens)), None
        total, first = 0, None
        for count in () if place >= len(tokens) else (10, 13) if tokens[place] == LOST else (tokens[place],):
            run = count - 128 if count > 128 else count
            after = place + (2 if count > 128 else 1 + run)
            if run and after <= len(tokens) and x // WIDTH == (x + run - 1) // WIDTH:
                more = ways(after, x + run)[0]
                total, first = total + more, (run, after) if more else first
        return total, first

    place, x, out = 0, 0, np.empty(4 * WIDTH, np.int64)
    while x < 4 * WIDTH:
        count, step = ways(place, x)
        if count != 1 or step is None:
            return None
        run, after = step
        same = tokens[place] > 128
        out[x : x + run] = tokens[place + 1] if same else tokens[place + 1 : after]
        place, x = after, x + run
    return out.reshape(4, WIDTH)


def stops(image: Floats, goal: Floats, valid: Mask) -> float:
    """Median absolute log2 difference of two maps, after one scale for all of both."""
    used = valid[..., None] & (image > 0) & (goal > 0)
    logs = np.log2(image[used].astype(np.float64) / goal[used])
    return float(np.median(np.abs(logs - np.median(logs))))
