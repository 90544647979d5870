"""InstantHDR's measure of light against its definition, written with torch as its code is."""

import math

import numpy as np
import pytest
import torch

from recon.measure.protocols.hdr_pretrain import score, shown

rng = np.random.default_rng(2)
TRUTH = np.exp(rng.normal(0, 2, (24, 32, 3))).astype(np.float32)
OURS = (TRUTH * np.exp(rng.normal(0, 0.1, TRUTH.shape))).astype(np.float32)


def by_torch(light: np.ndarray) -> torch.Tensor:
    x = torch.from_numpy(light).double()
    x = x / x.flatten().quantile(0.99).clamp(min=1e-6)
    return torch.log(x.clamp(0, 1) * 5000.0 + 1.0) / math.log(5001.0)


def test_light_is_shown_as_by_definition():
    np.testing.assert_allclose(shown(TRUTH), by_torch(TRUTH).numpy(), atol=1e-12)
    error = float(((by_torch(OURS) - by_torch(TRUTH)) ** 2).mean())
    assert score(OURS, TRUTH)["hdr_psnr_p99"] == pytest.approx(-10 * math.log10(error), abs=1e-9)


def test_no_scale_matters_and_a_lamp_hardly():
    figures = score(OURS, TRUTH)
    assert score(37 * OURS, TRUTH / 5) == pytest.approx(figures, abs=1e-4)
    lamp = OURS.copy()
    lamp[3, 4] *= 1000
    assert score(lamp, TRUTH)["hdr_psnr_p99"] > 30  # over the maximum it would be 11


def test_black_is_black():
    assert shown(np.zeros((12, 12, 3), np.float32)).max() == 0
