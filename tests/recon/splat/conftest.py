"""Small scenes for the rasteriser, by name: what each is meant to catch is said beside it."""

import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import torch

from recon.splat import Limits, Render, SplatCamera, SplatStats, rasterize
from recon.splat.raster_types import RasterInputs
from tests.recon.interpreter import quick_interpreter

if not torch.cuda.is_available():
    # Read when Triton is first imported: without a GPU its kernels are interpreted on CPU tensors.
    os.environ["TRITON_INTERPRET"] = "1"


@dataclass
class Scene:
    """Gaussians in float64 (values that float32 holds exactly), a camera and the rest of a render."""

    means: torch.Tensor
    quats: torch.Tensor
    scales: torch.Tensor
    opacities: torch.Tensor
    colours: torch.Tensor
    camera: SplatCamera
    background: torch.Tensor | None = None
    limits: Limits = field(default_factory=Limits)

    def tensors(self, dtype: torch.dtype, grad: bool = True) -> list[torch.Tensor]:
        values = [self.means, self.quats, self.scales, self.opacities, self.colours]
        if self.background is not None:
            values.append(self.background)
        return [t.to(dtype).detach().clone().requires_grad_(grad) for t in values]

    def render(self, tensors: list[torch.Tensor], stats: SplatStats | None = None) -> Render:
        background = tensors[5] if len(tensors) > 5 else None
        return rasterize(*tensors[:5], self.camera, background, self.limits, stats)

    def render_on(self, device: str, tensors: list[torch.Tensor], stats: SplatStats | None = None) -> Render:
        """Through the GPU's kernels; the tensors stay where they are, and get their gradients."""
        from recon.splat.gpu import rasterize_gpu

        moved = [tensor.to(device) for tensor in tensors]
        background = moved[5] if len(moved) > 5 else None
        return rasterize_gpu(RasterInputs(*moved[:5], self.camera, background, self.limits, stats))

    def smaller(self, count: int = 14) -> "Scene":
        """Its first Gaussians, in a picture at most 20 pixels wide: Triton's interpreter is slow."""
        old = self.camera
        factor = min(1.0, 20 / old.width)
        sizes = {name: factor * getattr(old, name) for name in ("fx", "fy", "cx", "cy")}
        width, height = math.ceil(factor * old.width), math.ceil(factor * old.height)
        names = ("means", "quats", "scales", "opacities", "colours")
        firsts = {name: getattr(self, name)[:count].clone() for name in names}
        return replace(self, **firsts, camera=replace(old, width=width, height=height, **sizes))


def pose(x: float = 0.0, y: float = 0.0, z: float = 3.0, turn: float = 0.0) -> np.ndarray:
    """cam_from_world: turned about y, then moved."""
    motion = np.eye(4)
    motion[0, 0] = motion[2, 2] = np.cos(turn)
    motion[0, 2], motion[2, 0] = np.sin(turn), -np.sin(turn)
    motion[:3, 3] = (x, y, z)
    return motion


def camera(width: int = 40, height: int = 30, **options: float) -> SplatCamera:
    return SplatCamera(
        pose(turn=options.pop("turn", 0.3), z=options.pop("z", 3.0)),
        fx=options.pop("fx", 0.9 * width),
        fy=0.95 * width,
        cx=0.48 * width,
        cy=0.53 * height,
        width=width,
        height=height,
        **options,
    )


def cloud(count: int, seed: int = 0, size: float = 0.1, spread: float = 0.7) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(seed)
    values = {
        "means": rng.normal(0, spread, (count, 3)),
        "quats": rng.normal(0, 1, (count, 4)),
        "scales": size * np.exp(0.5 * rng.normal(0, 1, (count, 3))),
        "opacities": rng.uniform(0.1, 0.99, count),
        "colours": rng.uniform(0.0, 1.0, (count, 3)),
    }
    return {name: torch.tensor(value).float().double() for name, value in values.items()}


BACK = torch.tensor([0.3, 0.2, 0.5]).double()
LENS = {"k1": -0.2, "k2": 0.06, "p1": 0.01, "p2": -0.008}
FISHEYE = {"k1": 0.08, "k2": -0.03, "k3": 0.02, "k4": -0.008, "fx": 18.0, "fisheye": True}


def _needles() -> dict[str, torch.Tensor]:
    scene = cloud(12, 3)
    scene["scales"] = torch.tensor([2.0, 1e-3, 1e-4]).double().expand(12, 3).float().double()
    return scene


def _same_place() -> dict[str, torch.Tensor]:
    """Equal depths: the order of the input decides."""
    scene = cloud(30, 4)
    scene["means"] = torch.zeros(30, 3).double()
    return scene


def _opaque() -> dict[str, torch.Tensor]:
    scene = cloud(40, 5, size=0.3)
    scene["opacities"] = torch.ones(40).double()
    return scene


def _near() -> dict[str, torch.Tensor]:
    """Around the near plane and beside the camera, where the Jacobian is clamped."""
    scene = cloud(30, 6, size=0.05)
    scene["means"] = torch.tensor(np.random.default_rng(6).uniform(-0.5, 0.5, (30, 3))).float().double()
    return scene


def _bright() -> dict[str, torch.Tensor]:
    """Twelve decades of radiance in one image."""
    scene = cloud(80, 7, size=0.15)
    rng = np.random.default_rng(7)
    scene["colours"] = torch.tensor(10 ** rng.uniform(-6, 6, (80, 3))).float().double()
    return scene


def _behind() -> dict[str, torch.Tensor]:
    scene = cloud(20, 8)
    scene["means"][:, 2] -= 50
    return scene


def _inside() -> dict[str, torch.Tensor]:
    """The camera stands in the middle of the first Gaussian."""
    scene = cloud(20, 8)
    scene["means"][0] = torch.tensor([0.05, 0.0, -2.9])
    scene["scales"][0] = 2.0
    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    "plain": lambda: Scene(**cloud(60), camera=camera()),
    "background": lambda: Scene(**cloud(60, 1), camera=camera(), background=BACK),
    "lens": lambda: Scene(**cloud(60, 2), camera=camera(**LENS), background=BACK),
    "strong lens": lambda: Scene(**cloud(60, 2, spread=1.2), camera=camera(k1=-0.4, fx=20), background=BACK),
    "small": lambda: Scene(**cloud(200, 3, size=0.004), camera=camera()),
    "big": lambda: Scene(**cloud(30, 4, size=1.0), camera=camera(), background=BACK),
    "many": lambda: Scene(**cloud(700, 9, size=0.1), camera=camera(56, 40, **LENS)),
    "needles": lambda: Scene(**_needles(), camera=camera(), background=BACK),
    "same place": lambda: Scene(**_same_place(), camera=camera(), background=BACK),
    "opaque": lambda: Scene(**_opaque(), camera=camera(), background=BACK),
    "near": lambda: Scene(**_near(), camera=camera(z=0.3), background=BACK),
    "near lens": lambda: Scene(**_near(), camera=camera(z=0.3, **LENS)),
    "bright": lambda: Scene(**_bright(), camera=camera(), limits=Limits(luminance_reference=1e-6)),
    "fisheye": lambda: Scene(**cloud(60, 2), camera=camera(**FISHEYE), background=BACK),
    "near fisheye": lambda: Scene(**_near(), camera=camera(z=0.3, **FISHEYE)),
    "3dgs": lambda: Scene(**cloud(60, 1), camera=camera(), background=BACK, limits=Limits.gsplat()),
    "1x1": lambda: Scene(**cloud(20, 1), camera=camera(1, 1, fx=20.0), background=BACK),
    "17x3": lambda: Scene(**cloud(40, 1), camera=camera(17, 3), background=BACK),
    "200x9": lambda: Scene(**cloud(40, 1), camera=camera(200, 9), background=BACK),
    "none": lambda: Scene(**cloud(0), camera=camera(), background=BACK),
    "one": lambda: Scene(**cloud(1, 2), camera=camera(), background=BACK),
    "behind": lambda: Scene(**_behind(), camera=camera(), background=BACK),
    "inside": lambda: Scene(**_inside(), camera=camera(turn=0.0), background=BACK),
}


@pytest.fixture(autouse=True)
def one_torch_thread() -> Iterator[None]:
    """The oracle's operations are too small to share: threads only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> str:
    """Device of the GPU's kernels: a GPU if there is one, else interpreted on the CPU."""
    if torch.cuda.is_available():
        return "cuda"
    quick_interpreter(monkeypatch)
    return "cpu"


@pytest.fixture(params=list(SCENES))
def scene(request: pytest.FixtureRequest) -> Scene:
    return SCENES[request.param]()


@pytest.fixture
def scene_of() -> Callable[[str], Scene]:
    return lambda name: SCENES[name]()
