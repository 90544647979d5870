"""Tiles that an ellipse touches, by the GPU's kernels in float32, beside every pixel in float64."""

import numpy as np
import pytest
import torch

from imaging.arrays import Array

pytest.importorskip("triton", reason="Triton is for Linux")

from recon.splat.gpu import project, tiles
from recon.splat.tables import DRAWN

WIDTH, HEIGHT, ACROSS, DOWN = 100, 60, 7, 8
COUNT = 150


def ellipses(kind: str) -> tuple[Array, Array, Array]:
    """Means [N, 2], px, roots of the inverse covariance [N, 3], and reaches [N] of random ellipses."""
    rng = np.random.default_rng(5)
    mean = rng.uniform(-20, [WIDTH + 20, HEIGHT + 20], (COUNT, 2))
    shorter, longer = {
        "tiny": (0.3, 0.4), "round": (4.0, 9.0), "needles": (0.3, 900.0), "endless needles": (0.3, 1e6),
        "huge": (1e4, 1e8), "far away": (0.3, 1e5),
    }[kind]  # fmt: skip
    angle = rng.uniform(0, np.pi, COUNT)
    angle[:8] = np.arange(8) * np.pi / 8 + 1e-7
    axis = np.stack([np.cos(angle), np.sin(angle)], 1)
    if kind == "far away":
        mean += axis * rng.uniform(-3e5, 3e5, (COUNT, 1))
    a = longer**2 * axis[:, 0] ** 2 + shorter**2 * axis[:, 1] ** 2
    b = (longer**2 - shorter**2) * axis[:, 0] * axis[:, 1]
    determinant = (longer * shorter) ** 2
    m22 = np.sqrt(a / determinant)
    return mean, np.stack([1 / np.sqrt(a), -m22 * b / a, m22], 1), rng.uniform(0.1, 30, COUNT)


def tables(mean: Array, root: Array, reach: Array, device: str) -> tuple[torch.Tensor, ...]:
    """Record, box and state as `project` writes them."""
    record = np.zeros((COUNT, project.RECORD.value), np.float32)
    numbers = np.stack([mean[:, 0], mean[:, 1], root[:, 1], root[:, 2]], 1)
    for column, number in zip((0, 2, 5, 7), numbers.T, strict=True):
        record[:, column] = number
        record[:, column + 1] = number - record[:, column].astype(np.float64)
    record[:, 4], record[:, project.PAINT.value] = root[:, 0], -reach
    half = np.sqrt(reach)[:, None] * np.stack(
        [1 / root[:, 0], np.hypot(root[:, 0], root[:, 1]) / (root[:, 0] * root[:, 2])], 1
    )
    first = np.ceil(np.maximum(mean - half - 0.5, 0))
    last = np.floor(np.minimum(mean + half - 0.5, [WIDTH - 1, HEIGHT - 1]))
    drawn = (first <= last).all(axis=1)
    box = np.where(drawn[:, None], np.stack([first[:, 0], last[:, 0], first[:, 1], last[:, 1]], 1), 0)
    state = np.where(drawn, DRAWN, 0)
    values = (record, box.astype(np.int32), state.astype(np.int8))
    return tuple(torch.from_numpy(value).to(device) for value in values)


def touched(mean: Array, root: Array, reach: Array) -> set[tuple[int, int]]:
    """Pairs of an ellipse and a tile with a pixel in it."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    pairs = set()
    for i in range(COUNT):
        dx, dy = x + 0.5 - mean[i, 0], y + 0.5 - mean[i, 1]
        inside = (root[i, 0] * dx) ** 2 + (root[i, 1] * dx + root[i, 2] * dy) ** 2 <= reach[i]
        pairs |= {(i, int(tile)) for tile in np.unique((y // 8 * ACROSS + x // 16)[inside])}
    return pairs


@pytest.mark.parametrize("kind", ["tiny", "round", "needles", "endless needles", "huge", "far away"])
def test_no_touched_tile_is_missed_and_few_others_are_listed(device: str, kind: str) -> None:
    mean, root, reach = ellipses(kind)
    record, box, state = tables(mean, root, reach, device)
    number = tiles.count(record, box, state, ACROSS)
    depth = torch.arange(COUNT, 0, -1, dtype=torch.float32).to(device)
    size = int(number.sum())
    pairs = tiles.pairs_of(number, depth, size, record, box, state, ACROSS, ACROSS * DOWN)
    ours = list(zip(pairs.owner.tolist(), pairs.tile.tolist(), strict=True))
    assert len(ours) == len(set(ours)) == size, "what is counted is written, each once"
    assert [i for i, _ in ours] == sorted((i for i, _ in ours), reverse=True), "nearest first"
    truth = touched(mean, root, reach)
    assert truth, "nothing was touched"
    assert truth <= set(ours)
    assert size <= (1.2 if kind == "far away" else 1.01) * len(truth)
