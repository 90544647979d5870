"""Shared parts of the extremes: the rasteriser's scenes, planes that fill the image, and both executions."""

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera, rasterize


def _scenes() -> ModuleType:
    path = Path(__file__).parents[1] / "splat" / "conftest.py"
    spec = importlib.util.spec_from_file_location("splat_scenes", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["splat_scenes"] = module
    spec.loader.exec_module(module)
    return module


_SCENES = _scenes()
one_torch_thread = _SCENES.one_torch_thread
scene_of = _SCENES.scene_of
Scene = _SCENES.Scene
CAMERA = SplatCamera(np.eye(4), fx=20, fy=20, cx=16.5, cy=16.5, width=40, height=36)
"""The centre of pixel (16, 16), the first of a tile, lies on its axis: there distances are exactly 0."""


@pytest.fixture(params=[torch.float32, torch.float64], ids=["kernels", "oracle"])
def dtype(request: pytest.FixtureRequest) -> torch.dtype:
    return request.param


@pytest.fixture
def axial_camera() -> SplatCamera:
    return CAMERA


@pytest.fixture
def sheets() -> Callable[..., Render]:
    """Gaussians so wide that the image sees them as planes of one opacity."""

    def draw(
        depths: list[float], opacities: list[float], light: list[float], dtype: torch.dtype, **options: Any
    ) -> Render:
        n = len(depths)
        means = torch.tensor([[0.0, 0.0, z] for z in depths], dtype=dtype)
        quats = torch.tensor([[1.0, 0, 0, 0]] * n, dtype=dtype)
        scales = torch.tensor([[1e6, 1e6, 1e-3]] * n, dtype=dtype)
        colours = torch.tensor([[x] * 3 for x in light], dtype=dtype)
        alphas = torch.tensor(opacities, dtype=dtype)
        return rasterize(means, quats, scales, alphas, colours, CAMERA, **options)

    return draw


@pytest.fixture
def dot() -> Callable[..., list[torch.Tensor]]:
    """One round Gaussian on the axis: the tensors of a render."""

    def make(
        dtype: torch.dtype, depth: float = 2.0, scale: float = 0.1, opacity: float = 0.5, light: float = 1.0
    ) -> list[torch.Tensor]:
        values = [[[0.0, 0.0, depth]], [[1.0, 0.0, 0.0, 0.0]], [[scale] * 3], [opacity], [[light] * 3]]
        return [torch.tensor(value, dtype=dtype).requires_grad_() for value in values]

    return make


@pytest.fixture
def decades() -> Any:
    """A scene whose image rises by twelve decades from left to right, in several layers."""
    rng, n = np.random.default_rng(11), 500
    place = rng.uniform(-1, 1, n)
    values = {
        "means": np.stack([place, rng.uniform(-0.3, 0.3, n), rng.uniform(-0.2, 0.2, n)], axis=1),
        "quats": rng.normal(0, 1, (n, 4)),
        "scales": 0.02 * np.exp(0.3 * rng.normal(0, 1, (n, 3))),
        "opacities": rng.uniform(0.1, 1.0, n),
        "colours": 10 ** (6 * place + rng.uniform(-1, 1, n))[:, None] * rng.uniform(0.2, 1, (n, 3)),
    }
    tensors = {name: torch.tensor(value).float().double() for name, value in values.items()}
    motion = np.eye(4)
    motion[2, 3] = 2.0
    camera = SplatCamera(motion, fx=90, fy=90, cx=48, cy=14, width=96, height=28)
    return Scene(**tensors, camera=camera, limits=Limits(luminance_reference=1e-6, t_min=1e-14))
