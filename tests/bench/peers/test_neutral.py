"""The renderer that scenes of all trainers are drawn by, and the figures that are taken of them."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.peers.neutral import PlySplats, basis, measured
from imaging import metrics
from recon.scene.appearance import PlainHarmonics
from recon.scene.gaussians import Gaussians, Renderer
from recon.scene.harmonics import basis as own_basis
from recon.scene.ply import plain_harmonics, write_ply
from recon.splat import Limits, SplatCamera

CAMERA = SplatCamera(np.eye(4), 60.0, 60.0, 32.0, 24.0, 64, 48)


def directions(count: int) -> torch.Tensor:
    towards = torch.from_numpy(np.random.default_rng(0).standard_normal((count, 3)))
    return towards / towards.norm(dim=1, keepdim=True)


def test_harmonics_up_to_degree_three_are_orthonormal_and_begin_as_ours():
    values = basis(directions(200_000))
    gram = 4 * np.pi * (values.T @ values).numpy() / len(values)
    np.testing.assert_allclose(gram, np.eye(16), atol=0.03)
    np.testing.assert_allclose(basis(directions(50))[:, :9], own_basis(directions(50), 2), rtol=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_file_is_drawn_as_its_scene(tmp_path, degree):
    rng = np.random.default_rng(degree)

    def tensor(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.standard_normal(shape).astype(np.float32))

    means = tensor(40, 3)
    means[:, 2] += 4
    gaussians = Gaussians(
        {
            "means": means,
            "log_scales": 0.3 * tensor(40, 3) - 1.5,
            "quats": tensor(40, 4),
            "opacity_logits": tensor(40),
            "sh_dc": tensor(40, 1, 3),
            "sh_rest": 0.3 * tensor(40, 8, 3),
        }
    )
    write_ply(tmp_path / "s.ply", gaussians, plain_harmonics(gaussians, PlainHarmonics(), degree), [])
    splats = PlySplats.read(tmp_path / "s.ply")
    assert len(splats) == 40
    with torch.no_grad():
        drawn = Renderer(PlainHarmonics(), Limits.gsplat())(gaussians, CAMERA, degree=degree)
    behind = (0.25, 0.5, 0.75)
    expected = drawn.image + (1 - drawn.alpha)[..., None] * torch.tensor(behind)
    np.testing.assert_allclose(splats.drawn(CAMERA, behind), expected, atol=2e-5)


def test_figures_are_of_what_is_seen_and_forgive_one_gain_a_channel():
    rng = np.random.default_rng(1)
    true = rng.uniform(0.1, 0.9, (24, 32, 3))
    visible = np.ones((24, 32), bool)
    visible[:8] = False
    view = SimpleNamespace(valid=visible)
    shown = true * [0.9, 1.0, 1.05]
    shown[:8] = 0.0
    figures = measured([view], [true], lambda _: shown)
    assert figures.psnr == pytest.approx(metrics.psnr(shown[8:].clip(0, 1), true[8:]))
    assert figures.gained > 100 > figures.psnr
