"""The Numba rasteriser against the dense float64 oracle with the same cut-offs."""

from typing import Any

import numpy as np
import pytest
import torch

import imaging.compute.threads as threads
from imaging.errors import InputError
from recon.splat import SplatStats, rasterize
from recon.splat.cpu.rasterizer import Buffers
from tests.recon.splat.oracle import same_gradient, same_image, same_statistics

NAMES = ("means", "quats", "scales", "opacities", "colours", "background")


def loss(render: Any, seed: int = 0) -> torch.Tensor:
    """A smooth function of image and alpha, with another gradient at every pixel."""
    rng = np.random.default_rng(seed)
    image, alpha = render.image, render.alpha
    a = torch.tensor(rng.normal(size=tuple(image.shape)), dtype=image.dtype)
    b = torch.tensor(rng.normal(size=tuple(alpha.shape)), dtype=image.dtype)
    return (a * torch.log1p(image)).sum() + (b * alpha).sum()


def test_equals_oracle(scene: Any) -> None:
    """Image, gradients and statistics."""
    count = len(scene.means)
    fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
    ours, theirs = SplatStats(count), SplatStats(count)
    render, expected = scene.render(fast, ours), scene.render(truth, theirs)
    same_image(render, expected, scene.camera)
    loss(render).backward()
    loss(expected).backward()
    for name, a, b in zip(NAMES, fast, truth, strict=False):
        same_gradient(a.grad, b.grad, name, 1e-3)
    assert ((ours.weight > 0) != (theirs.weight > 0)).sum() <= 0.02 * count
    same_statistics(ours, theirs, 1e-3)


def test_statistics_add_up_over_renders(scene_of: Any) -> None:
    scene = scene_of("lens")
    statistics = []
    for seeds in ((0,), (1,), (0, 1)):
        stats = SplatStats(len(scene.means))
        for seed in seeds:
            loss(scene.render(scene.tensors(torch.float32), stats), seed).backward()
        statistics.append(stats)
    first, second, both = statistics
    assert both.tension.max() > first.tension.max()
    torch.testing.assert_close(first.tension + second.tension, both.tension, rtol=1e-6, atol=0)
    assert torch.equal(torch.maximum(first.weight, second.weight), both.weight)


def test_tension_is_of_pixels_that_pull_both_ways(scene_of: Any) -> None:
    """None of an error that all pixels share, as of a wrong exposure; much of one that alternates."""
    scene = scene_of("plain")
    tensors = [t[:1].detach() for t in scene.tensors(torch.float32)[:5]]
    tensors[3][:], tensors[4][:] = 0.5, 1.0
    tensions = []
    rows, columns = torch.meshgrid(
        torch.arange(scene.camera.height), torch.arange(scene.camera.width), indexing="ij"
    )
    chessboard = 1.0 - 2.0 * ((rows + columns) % 2)
    for error in (torch.ones_like(chessboard), chessboard):
        stats = SplatStats(1)
        given = [t.clone().requires_grad_() for t in tensors]
        image = rasterize(*given, scene.camera, None, scene.limits, stats).image
        (image * error[..., None]).sum().backward()
        tensions.append(float(stats.tension))
    assert stats.weight > 0.1
    assert tensions[0] < 0.01 * tensions[1]


def test_gradient_of_the_image_alone_and_of_alpha_alone(scene_of: Any) -> None:
    scene = scene_of("lens")
    for part in ("image", "alpha"):
        fast, truth = scene.tensors(torch.float32), scene.tensors(torch.float64)
        for tensors in (fast, truth):
            (getattr(scene.render(tensors), part) ** 2).sum().backward()
        for name, ours, theirs in zip(NAMES[:4], fast, truth, strict=False):
            assert (ours.grad.double() - theirs.grad).norm() < 1e-4 * theirs.grad.norm(), (part, name)


@pytest.mark.parametrize("name", ["many", "needles", "big", "200x9"])
def test_thread_count_changes_no_bit(scene_of: Any, name: str) -> None:
    scene = scene_of(name)
    before, results = threads.thread_count(), []
    try:
        for count in (1, 2, 3):
            threads.set_threads(count)
            stats = SplatStats(len(scene.means))
            tensors = scene.tensors(torch.float32)
            render = scene.render(tensors, stats)
            loss(render).backward()
            arrays = [render.image, render.alpha, *(t.grad for t in tensors)]
            outputs = [a.detach().numpy().tobytes() for a in arrays if a is not None]
            results.append([*outputs, *(a.numpy().tobytes() for a in (stats.tension, stats.weight))])
    finally:
        threads.set_threads(before)
    assert results[0] == results[1] == results[2]


def test_same_call_gives_the_same_bits(scene_of: Any) -> None:
    scene = scene_of("many")
    renders = [scene.render(scene.tensors(torch.float32, grad=False)).image.numpy() for _ in range(2)]
    assert renders[0].tobytes() == renders[1].tobytes()


def test_several_renders_alive_at_once(scene_of: Any) -> None:
    """Their tables must not be shared: a batch of views is rendered before one backward pass."""
    first, second = scene_of("lens"), scene_of("many")
    alone = []
    for scene in (first, second):
        tensors = scene.tensors(torch.float32)
        loss(scene.render(tensors)).backward()
        alone.append([t.grad for t in tensors])
    a, b = first.tensors(torch.float32), second.tensors(torch.float32)
    (loss(first.render(a)) + loss(second.render(b))).backward()
    for expected, tensors in zip(alone, (a, b), strict=True):
        assert all(torch.equal(x, t.grad) for x, t in zip(expected, tensors, strict=True))


def test_backward_twice_gives_the_gradient_twice(scene_of: Any) -> None:
    scene = scene_of("background")
    tensors = scene.tensors(torch.float32)
    value = loss(scene.render(tensors))
    value.backward(retain_graph=True)
    once = [t.grad.clone() for t in tensors]
    value.backward()
    assert all(torch.equal(2 * x, t.grad) for x, t in zip(once, tensors, strict=True))


def test_strided_and_partly_constant_inputs(scene_of: Any) -> None:
    scene = scene_of("plain")
    plain = scene.tensors(torch.float32)
    loss(scene.render(plain)).backward()
    tensors = scene.tensors(torch.float32, grad=False)
    wide = torch.zeros(len(tensors[0]), 6)
    wide[:, ::2] = tensors[0]
    wide.requires_grad_()
    loss(scene.render([wide[:, ::2], *tensors[1:]])).backward()
    assert torch.equal(wide.grad[:, ::2], plain[0].grad)


def test_no_gradient_keeps_no_memory(scene_of: Any) -> None:
    scene = scene_of("plain")
    with torch.no_grad():
        render = scene.render(scene.tensors(torch.float32))
    assert not render.image.requires_grad
    assert torch.equal(render.image, scene.render(scene.tensors(torch.float32)).image)


def test_wrong_shapes_and_dtypes_are_named(scene_of: Any) -> None:
    scene = scene_of("plain")
    tensors = scene.tensors(torch.float32, grad=False)
    with pytest.raises(InputError, match="quats has shape"):
        scene.render([tensors[0], tensors[1][:, :3], *tensors[2:]])
    with pytest.raises(InputError, match=r"opacities is torch\.float64"):
        scene.render([*tensors[:3], tensors[3].double(), tensors[4]])
    with pytest.raises(InputError, match="stats counts 3"):
        scene.render(tensors, SplatStats(3))
    with pytest.raises(InputError, match="stats is on meta and means on cpu"):
        scene.render(tensors, SplatStats(len(tensors[0]), torch.device("meta")))


def test_what_was_not_drawn_counts_nothing(scene_of: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ignore what its places in the tables held before."""
    make = Buffers.array

    def soiled(buffers: Buffers, name: str, shape: Any, dtype: Any) -> Any:
        array = make(buffers, name, shape, dtype)
        if array.dtype.kind == "f":
            array.fill(np.nan)
        return array

    monkeypatch.setattr(Buffers, "array", soiled)
    scene = scene_of("plain")
    scene.means[::2, 2] = -50.0
    stats = SplatStats(len(scene.means))
    loss(scene.render(scene.tensors(torch.float32), stats)).backward()
    for name in ("tension", "radius", "weight"):
        values = getattr(stats, name)
        assert torch.isfinite(values).all(), name
        assert not values[::2].any(), name
    assert stats.radius[1::2].any()
