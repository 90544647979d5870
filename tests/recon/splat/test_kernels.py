"""The parts of the fast rasteriser one by one: lanes, exponential, sort, tile lists, threads, cache."""

import math
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from imaging.compute.jit import cache_folder, kernel
from imaging.compute.threads import share, take_number
from recon.splat import SplatCamera, rasterize, tables
from recon.splat.cpu import lanes, tiles
from recon.splat.cpu.composite import cover
from recon.train.devices.warm_up import warm_up


@kernel
def _alphas(t, opacity, out, through):
    for i in range(0, len(t), lanes.WIDTH):
        zero, low = lanes.splat(np.float32(0.0)), lanes.splat(np.float32(-60.0))
        one = lanes.splat(np.float32(1.0))
        _, a, b = cover(lanes.load(t, i), zero, one, lanes.splat(opacity), low, zero)
        lanes.store(out, i, a)
        lanes.store(through, i, b)


@pytest.mark.parametrize("opacity", [1.0, 1 - 2.0**-24, 0.999, 0.5, 1e-6])
def test_alpha_and_its_complement_keep_their_digits(opacity: float) -> None:
    """Pins the rounding of the exponential: a reordered sum would make it wrong by whole powers of two."""
    t = -np.concatenate([np.linspace(0, 60, 4000), np.geomspace(1e-9, 1, 4000)]).astype(np.float32)
    opacity = float(np.float32(opacity))
    out, through = np.empty_like(t), np.empty_like(t)
    _alphas(t, np.float32(opacity), out, through)
    exact = opacity * np.exp2(t.astype(np.float64))
    complement = (1 - opacity) - opacity * np.expm1(t.astype(np.float64) * math.log(2))
    np.testing.assert_allclose(out, exact, rtol=4e-7)
    np.testing.assert_allclose(through, complement, rtol=1.5e-6, atol=0)
    assert out.max() <= 1


@kernel
def _lane_operations(a, b, n, out):
    x, y = lanes.load(a, 0), lanes.load_first(b, 0, n)
    two = np.float32(2.0)
    lanes.store(out, 0, x + y)
    lanes.store(out, 16, (x - y) * two)
    lanes.store(out, 32, lanes.fma(x, y, two) / x)
    lanes.store(out, 48, lanes.choose(lanes.both(lanes.at_least(x, y), lanes.above(y, two)), x, y))
    lanes.store(out, 64, lanes.maximum(lanes.minus(x), y))
    lanes.store(out, 80, lanes.totals((x, y, lanes.keep_first(n, x)))[0])
    lanes.store(out, 96, lanes.lane_row() * np.float32(10.0) + lanes.lane_column())
    lanes.store_first(out, 112, n, x)
    return lanes.total(x), lanes.largest(y)


def test_lanes_do_what_they_say() -> None:
    rng = np.random.default_rng(0)
    a = rng.uniform(1, 5, 16).astype(np.float32)
    b = rng.uniform(1, 5, 5).astype(np.float32)
    out = np.full(128, -7, np.float32)
    total, largest = _lane_operations(a, b, 5, out)
    y = np.concatenate([b, np.zeros(11, np.float32)])
    first = a[:5].astype(np.float64).sum()
    rows = out.reshape(8, 16)
    np.testing.assert_allclose(rows[0], a + y)
    np.testing.assert_allclose(rows[1], (a - y) * 2)
    np.testing.assert_allclose(rows[2], (a * y + 2) / a, rtol=1e-6)
    np.testing.assert_array_equal(rows[3], np.where((a >= y) & (y > 2), a, y))
    np.testing.assert_array_equal(rows[4], np.maximum(-a, y))
    np.testing.assert_allclose(rows[5], [a.sum(), y.sum(), first, *[0] * 13], rtol=1e-6)
    np.testing.assert_array_equal(rows[6], [10 * (i // 8) + i % 8 for i in range(16)])
    np.testing.assert_array_equal(rows[7], [*a[:5], *[-7] * 11])
    assert total == pytest.approx(a.sum(), rel=1e-6)
    assert largest == y.max()


def test_depth_order_is_stable() -> None:
    rng = np.random.default_rng(0)
    depth = rng.choice(rng.uniform(0.01, 1e6, 300), 5000).astype(np.float32)
    state = rng.integers(0, 3, 5000).astype(np.uint8)
    order = tiles.depth_order(depth.view(np.uint32), state)
    drawn = np.flatnonzero(state == 1)
    np.testing.assert_array_equal(order, drawn[np.argsort(depth[drawn], kind="stable")])


def test_every_touched_pixel_is_listed_and_no_far_one() -> None:
    """Against brute force: the blocks of an ellipse are those where a pixel centre lies in it, almost."""
    rng = np.random.default_rng(1)
    width, height = 150, 70
    missed = extra = listed = 0
    for _ in range(400):
        mean = rng.uniform([-30, -30], [180, 100])
        a, c = np.exp(rng.uniform(-1, 8, 2))
        b = rng.uniform(-0.99, 0.99) * math.sqrt(a * c)
        reach = rng.uniform(0.1, 20)
        determinant = a * c - b * b
        m11, m21, m22 = 1 / math.sqrt(a), -b / math.sqrt(a * determinant), math.sqrt(a / determinant)
        rx, ry = math.sqrt(reach * a), math.sqrt(reach * c)
        box = np.array(
            [
                max(0, math.ceil(mean[0] - rx - 0.5)),
                min(width - 1, math.floor(mean[0] + rx - 0.5)),
                max(0, math.ceil(mean[1] - ry - 0.5)),
                min(height - 1, math.floor(mean[1] + ry - 0.5)),
            ],
            np.int32,
        )
        x, y = np.meshgrid(np.arange(width) + 0.5 - mean[0], np.arange(height) + 0.5 - mean[1])
        inside = (m11 * x) ** 2 + (m21 * x + m22 * y) ** 2 <= reach
        padded = np.zeros((80, 160), bool)
        padded[:height, :width] = inside
        expected = padded.reshape(10, 8, 20, 8).any(axis=(1, 3))
        blocks = np.zeros((10, 20), bool)
        if box[0] <= box[1] and box[2] <= box[3]:
            shape = np.zeros((1, 8))
            shape[0, :5] = (*mean, m11, m21, m22)
            paint = shape.view(np.float32)
            paint[0, tables.PAINT] = -reach
            none = np.zeros(1, np.float32)
            projected = tables.Projected(shape, paint, box[None], none, none, np.ones(1, np.uint8))
            start, number = np.zeros(2, np.int64), np.zeros(1, np.int32)
            tile, bits = np.empty(101, np.int32), np.empty(101, np.uint8)
            share(tiles.emit, 0, projected, 10, tables.Entries(start, number, start, tile, bits))
            n = number[0]
            assert len(set(tile[:n])) == n
            for t, mask in zip(tile[:n], bits[:n], strict=True):
                for block in range(4):
                    if mask >> block & 1:
                        blocks[2 * (t // 10) + (block >> 1), 2 * (t % 10) + (block & 1)] = True
        missed += (expected & ~blocks).sum()
        extra += (blocks & ~expected).sum()
        listed += blocks.sum()
    assert missed == 0
    assert extra < 0.06 * listed  # an ellipse may pass between pixel centres


@kernel
def _squares(counter, out, who):
    n = take_number(counter)
    while n < len(out):
        out[n] = n * n
        n = take_number(counter)


def test_tasks_are_done_once_each() -> None:
    before = threads.thread_count()
    try:
        for count in (1, 2, 5):
            threads.set_threads(count)
            for _ in range(20):
                out = np.full(1000, -1.0)
                share(_squares, 1e6, out, 0)
                np.testing.assert_array_equal(out, np.arange(1000.0) ** 2)
    finally:
        threads.set_threads(before)


def test_error_in_a_helper_reaches_the_caller() -> None:
    caller = threading.get_ident()
    begun = threading.Event()

    def broken(counter: Any) -> None:
        if threading.get_ident() != caller:
            begun.set()
            raise ArithmeticError("helper")
        begun.wait(10)

    before = threads.thread_count()
    threads.set_threads(2)
    try:
        with pytest.raises(ArithmeticError, match="helper"):
            share(broken, 1e6)
    finally:
        threads.set_threads(before)


def test_two_python_threads_may_render(scene_of: Any) -> None:
    scene = scene_of("many")
    expected = scene.render(scene.tensors(torch.float32, grad=False)).image
    images: list[torch.Tensor] = []

    def work() -> None:
        for _ in range(10):
            images.append(scene.render(scene.tensors(torch.float32, grad=False)).image)

    workers = [threading.Thread(target=work) for _ in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(images) == 20
    assert all(torch.equal(image, expected) for image in images)


def test_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder().parent == tmp_path / "xdg" / "hdr-rig" / "numba"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder().parent == tmp_path / "home" / ".cache" / "hdr-rig" / "numba"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "given"))
    assert cache_folder().parent == tmp_path / "given"
    assert len(cache_folder().name) == 16


def test_kernels_compile_without_a_place_for_the_cache(tmp_path: Path) -> None:
    """A home that cannot be written to costs time, never a traceback."""
    blocked = tmp_path / "file"
    blocked.write_text("")
    code = (
        "import numpy as np\n"
        "from recon.splat.cpu import tiles\n"
        "print(tiles.number_slots(np.ones(3, np.int32), np.empty(4, np.int64)))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(blocked / "no")}
    result = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120
    )
    assert result.stdout.strip() == "3", result.stderr


def test_warm_up_says_what_it_does() -> None:
    said: list[tuple[str, int, int]] = []
    warm_up(lambda message, done, total: said.append((message, done, total)), fisheye=True)
    assert [(done, total) for _, done, total in said] == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert all(message.strip() for message, _, _ in said)


def test_kernels_are_strict_about_nan() -> None:
    assert not {"fast", "nnan", "ninf", "reassoc"} & set(tiles.number_slots.targetoptions["fastmath"])
    assert isinstance(numba.config.CACHE_DIR, str)


def test_lens_from_calibration() -> None:
    from imaging.optics.lens import Lens
    from imaging.optics.pose import Pose

    lens = Lens(model="OPENCV", width=8, height=6, fx=5, fy=6, cx=4, cy=3, k1=0.1, k2=0.2, p1=0.3, p2=0.4)
    camera = SplatCamera.of(lens, Pose(quaternion=(1, 0, 0, 0), translation=(1, 2, 3)))
    assert (camera.fx, camera.fy, camera.k1, camera.k2, camera.p1, camera.p2) == (5, 6, 0.1, 0.2, 0.3, 0.4)
    assert camera.cam_from_world[:3, 3].tolist() == [1, 2, 3]
    tensors = [torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0, 3), torch.zeros(0), torch.zeros(0, 3)]
    assert rasterize(*tensors, camera).image.shape == (6, 8, 3)
