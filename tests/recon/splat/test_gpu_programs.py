"""Kernels of the GPU that run several programs: more Gaussians than a program takes, and very many tiles."""

from collections.abc import Callable
from typing import Any

import pytest
import torch

import recon.splat as splat
from recon.splat import SplatCamera, rasterize
from recon.splat.corrected_camera import DELTA
from tests.recon.splat.conftest import BACK, FISHEYE, LENS, Scene, camera, cloud
from tests.recon.splat.test_gpu import agrees, loss

pytest.importorskip("triton", reason="Triton is for Linux")

from triton.runtime import interpreter

from recon.splat.gpu import rasterize_gpu, rasterizer

MOST_INT16 = 32767
KERNELS = [
    (rasterizer.projection, "project"), (rasterizer.tiles, "match"), (rasterizer.tiles, "gather"),
    (rasterizer, "composite"), (rasterizer, "composite_backward"), (rasterizer.sums, "add_slots"),
    (rasterizer, "project_backward"),
]  # fmt: skip


class Counted:
    """A kernel that notes how many programs it ran; with `occupied` only those of tiles that have entries.

    Without entries a tile shows its background. The interpreter takes a minute for all of very many tiles.
    """

    def __init__(self, kernel: Any, programs: dict[str, int], occupied: bool) -> None:
        self.kernel, self.programs, self.occupied = kernel, programs, occupied
        self.arg_names, self.__name__ = kernel.arg_names, kernel.__name__

    def __getitem__(self, grid: tuple[int]) -> Callable[..., None]:
        self.programs[self.__name__] = grid[0]

        def launch(*arguments: Any, **options: Any) -> None:
            named = dict(zip(self.arg_names, arguments, strict=False))
            if not self.occupied or "chunks" not in named or torch.cuda.is_available():
                self.kernel[grid](*arguments, **options)
                return
            if "image" in named:
                named["image"].copy_(named["background"].expand_as(named["image"]))
                named["remaining"].fill_(1.0)
                named["pairs"].zero_()
                named["chunks"].zero_()
            tiles = {0, grid[0] - 1, *torch.nonzero(torch.diff(named["start"]))[:, 0].tolist()}
            self.launch_some(sorted(tiles), grid, arguments, options)

        return launch

    def launch_some(self, tiles: list[int], grid: tuple[int], arguments: Any, options: Any) -> None:
        builder = interpreter.interpreter_builder
        place, size = builder.set_grid_idx, builder.set_grid_dim
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(builder, "set_grid_idx", lambda x, y, z: place(tiles[x], y, z))
            patch.setattr(builder, "set_grid_dim", lambda x, y, z: size(*grid, 1, 1))
            self.kernel[(len(tiles),)](*arguments, **options)


@pytest.fixture
def programs(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How many programs each kernel of the last render and its gradient ran."""
    counts: dict[str, int] = {}
    occupied = getattr(request, "param", False)
    for module, name in KERNELS:
        monkeypatch.setattr(module, name, Counted(getattr(module, name), counts, occupied))
    return counts


def test_132_gaussians_on_32x24(device: str, programs: dict[str, int]) -> None:
    scene = Scene(**cloud(132, 11, size=0.15), camera=camera(32, 24, **LENS), background=BACK)
    agrees(scene, device)
    assert len(programs) == len(KERNELS)
    assert min(programs.values()) >= 2, programs
    assert programs["composite"] == programs["composite_backward"] == 6


def test_gradient_of_the_camera_is_summed_over_programs(
    device: str, programs: dict[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through a fisheye."""
    scene = Scene(**cloud(132, 12, size=0.01), camera=camera(16, 16, **FISHEYE), background=BACK)
    gradients = []
    for dtype, place in ((torch.float64, "cpu"), (torch.float32, device)):
        tensors = [t.to(place) for t in scene.tensors(dtype, grad=False)]
        delta = torch.full((DELTA,), 1e-3, dtype=torch.float64, requires_grad=True)
        render = rasterize(*tensors[:5], scene.camera, tensors[5], scene.limits, camera_delta=delta)
        loss(render).backward()
        assert delta.grad is not None
        gradients.append(delta.grad)
        monkeypatch.setattr(splat, "_rasterizer", lambda *_: rasterize_gpu)
    assert programs["project_backward"] == 2
    assert (gradients[1] - gradients[0]).norm() < 1e-5 * gradients[0].norm()


@pytest.mark.parametrize("programs", [True], indirect=True)
@pytest.mark.parametrize(("width", "height"), [(1, 8 * MOST_INT16 + 1), (16 * MOST_INT16 + 1, 1)])
def test_more_tiles_than_16_bits_number(
    device: str, programs: dict[str, int], width: int, height: int
) -> None:
    """Gaussians at both ends of a picture of 32,768 tiles, and in the middle of it."""
    across = width > height
    size = max(width, height)
    scene = Scene(**cloud(9, 13), camera=camera(), background=BACK)
    motion, middle = torch.eye(4).numpy(), {"cx": 0.5 * width, "cy": 0.5 * height}
    scene.camera = SplatCamera(motion, fx=size, fy=size, width=width, height=height, **middle)
    along = torch.tensor([0, 3, 17, size / 2 - 9, size / 2, size / 2 + 5, size - 18, size - 4, size - 1])
    along = (along.double() + 0.25) / size - 0.5  # at a distance of 1
    scene.means = torch.stack([along, 0 * along, 0 * along + 1], 1).float().double()
    if not across:
        scene.means = scene.means[:, [1, 0, 2]]
    scene.scales = (scene.scales * (20 / size)).float().double()  # some 2 px
    agrees(scene, device)
    assert programs["composite"] == programs["composite_backward"] == MOST_INT16 + 1
