"""Comparison of the GPU's kernels with the processor's, before anything is trained by them.

Compilers and drivers differ from machine to machine, and a wrong gradient shows itself only as a scene that
is a little worse. Two scenes of eight decades of light, through Brown's lens and through a fisheye, are drawn
by both. Where they agree, that is kept by GPU, driver, versions and sources, in the folder of
`imaging.compute.jit.caches`.
"""

import hashlib
import platform
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch

import recon.splat
from imaging.compute.jit import caches
from imaging.errors import InputError, ReconstructionError, StorageError
from imaging.files import store
from imaging.progress import Progress, unreported
from recon.splat import Limits, Render, SplatCamera, SplatStats
from recon.splat.corrected_camera import DELTA, moved
from recon.splat.cpu.rasterizer import rasterize_cpu
from recon.splat.raster_types import RasterInputs
from recon.train.devices.training_device import device_name

COUNT, WIDTH, HEIGHT = 500, 96, 64
DIMMEST, BRIGHTEST = 1e-4, 1e4
LIMITS = {"image": 1e-5, "alpha": 1e-5, "gradients": 1e-4, "statistics": 1e-4}
"""Largest errors. Two right implementations differ by some 1e-6, and where a pixel at the edge of a Gaussian
falls on the other side of a cut-off."""
_LENSES: dict[str, dict[str, Any]] = {
    "Brown's lens": {"fx": 86.0, "fy": 91.0, "k1": -0.2, "k2": 0.06, "p1": 0.01, "p2": -0.008},
    "a fisheye": {"fx": 43.0, "fy": 45.0, "k1": 0.08, "k2": -0.03, "k3": 0.02, "k4": -0.008, "fisheye": True},
}
_DRIVERS = (Path("/proc/driver/nvidia/version"), Path("/sys/module/amdgpu/version"))
_VERSIONS = ("torch", "triton", "pytorch-triton-rocm", "numpy")

Rasterizer = Callable[[RasterInputs], Render]


@dataclass(frozen=True)
class GpuCheck:
    """Result of a comparison.

    errors: by the names of LIMITS, the larger of both scenes: of the image relative to each pixel and of
    alpha, their means; of gradients and statistics relative in L2, the largest. wrong: what is beyond the
    limits, or did not run; empty if nothing.
    """

    errors: dict[str, float]
    wrong: str = ""

    def in_words(self) -> str:
        """Say by how much the kernels differ, or what is wrong with them."""
        figures = ", ".join(f"{name} {error:.1e}" for name, error in self.errors.items())
        return self.wrong or f"its kernels agree with the processor's (errors: {figures})"


def compared(device: torch.device, count: int = COUNT, width: int = WIDTH) -> GpuCheck:
    """Draw both scenes, of `count` Gaussians, `width` px wide, by a GPU's kernels and the processor's."""
    errors: dict[str, float] = {}
    try:
        for lens, numbers in _LENSES.items():
            for name, error in _errors(device, count, width, numbers).items():
                if not error <= LIMITS[name]:  # or not a number
                    what = f"{name} through {lens} differ from the processor's by {error:.1e}"
                    return GpuCheck({}, f"{what}, where {LIMITS[name]:.0e} is the most")
                errors[name] = max(error, errors.get(name, 0.0))
    except Exception as error:  # whatever a compiler or a driver raises
        says = next(iter(str(error).strip().splitlines()), "")[:200]
        return GpuCheck({}, f"its kernels did not run ({type(error).__name__}: {says})")
    return GpuCheck(errors)


def examined(device: torch.device) -> GpuCheck:
    """Compare, whatever was kept; keep the result if all is right."""
    check, place = compared(device), _place(device)
    with suppress(StorageError):  # without a place for it, it is compared again each time
        if check.wrong:
            store.discard(place)
        else:
            store.make_folder(place.parent)
            store.write_json(place, check.errors)
    return check


def checked(device: torch.device, progress: Progress = unreported) -> GpuCheck:
    """Return what was kept of a GPU, else compare: half a minute of compilation, once on a machine."""
    with suppress(InputError):
        return GpuCheck(store.read_json(_place(device)))
    progress(f"checking the kernels of {device_name(device)}, which compiles them once", 0, 0)
    return examined(device)


def trusted(
    device: torch.device, say: Callable[[str], None], progress: Progress = unreported, *, alone: bool = True
) -> torch.device:
    """Return the device if its kernels are right, else the CPU, and say so in a sentence.

    Args:
        device: Device to train on; the CPU is returned as it is.
        say: Callback for the sentence.
        progress: Callback for the current step, the steps done, and all of them.
        alone: False for one of several processes, whose devices have to be alike.

    Returns:
        The device to use.

    Raises:
        ReconstructionError: The kernels are wrong, and the process is one of several.
    """
    if device.type == "cpu":
        return device
    check = checked(device, progress)
    if not check.wrong:
        return device
    if not alone:
        raise ReconstructionError(
            f"{device_name(device)} cannot train with others, since {check.wrong}: update its driver and "
            "torch, or train without GPUs, by CUDA_VISIBLE_DEVICES= in front of torchrun."
        )
    say(
        f"{device_name(device)} is not used, since {check.wrong}: the training runs on the processor; update "
        "the GPU's driver and torch, then check with rig doctor."
    )
    return torch.device("cpu")


def _place(device: torch.device) -> Path:
    """File of a result: another for each GPU, driver, version and source."""
    digest = hashlib.sha256(f"{device_name(device)} {platform.platform()}".encode())
    for name in _VERSIONS:
        with suppress(PackageNotFoundError):
            digest.update(f"{name} {version(name)}".encode())
    for path in _DRIVERS:
        with suppress(OSError):
            digest.update(path.read_bytes())
    for source in (Path(__file__), *sorted(Path(recon.splat.__file__).parent.rglob("*.py"))):
        digest.update(source.read_bytes())
    return caches() / "gpu" / f"{digest.hexdigest()[:16]}.json"


def _errors(device: torch.device, count: int, width: int, lens: dict[str, Any]) -> dict[str, float]:
    """Errors of a scene by the names of LIMITS."""
    from recon.splat.gpu import rasterize_gpu  # here, so that a machine without a GPU needs no Triton

    ours, theirs = (
        _drawn(rasterizer, place, count, width, lens)
        for rasterizer, place in ((rasterize_gpu, device), (rasterize_cpu, torch.device("cpu")))
    )
    image, light = ours.pop("image"), theirs.pop("image")
    alpha = (ours.pop("alpha") - theirs.pop("alpha")).abs().mean()
    relative = {
        name: float((one - theirs[name]).norm() / theirs[name].norm().clamp_min(1e-30))
        for name, one in ours.items()
    }
    statistics = [relative.pop(name) for name in ("tension", "radius", "weight")]
    return {
        "image": float(((image - light).abs() / (light.abs() + DIMMEST)).mean()),
        "alpha": float(alpha),
        "gradients": _largest(relative.values()),
        "statistics": _largest(statistics),
    }


def _drawn(
    rasterizer: Rasterizer, device: torch.device, count: int, width: int, lens: dict[str, Any]
) -> dict[str, torch.Tensor]:
    """Image, alpha, gradients and statistics of a scene, float64 on the CPU, by name.

    Through a fisheye the camera has a gradient too. The gradients are of a loss with another weight at each
    pixel, of colours and sizes by their logarithms, so that the darkest count as much as the brightest.
    """
    rng = np.random.default_rng(5)
    values = {
        "means": rng.normal(0, 0.7, (count, 3)),
        "quats": rng.normal(0, 1, (count, 4)),
        "scales": 0.1 * np.exp(0.5 * rng.normal(0, 1, (count, 3))),
        "opacities": np.minimum(rng.uniform(0.1, 1.1, count), 1.0),
        "colours": np.exp(rng.uniform(np.log(DIMMEST), np.log(BRIGHTEST), (count, 3))),
    }
    leaves = {
        name: torch.tensor(value, dtype=torch.float32).to(device).requires_grad_()
        for name, value in values.items()
    }
    motion = np.array([[0.96, 0, 0.28, 0], [0, 1, 0, 0], [-0.28, 0, 0.96, 3], [0, 0, 0, 1]])
    size, height = width / WIDTH, round(width * HEIGHT / WIDTH)
    places = {"fx": lens["fx"] * size, "fy": lens["fy"] * size, "cx": 47.0 * size, "cy": 33.0 * size}
    camera = SplatCamera(motion, width=width, height=height, **lens | places)
    view, delta = None, torch.full((DELTA,), 1e-3, dtype=torch.float64, requires_grad=True)
    if "fisheye" in lens:
        camera, view = moved(camera, delta)
    stats, limits = SplatStats(count, device), Limits.for_scene(DIMMEST, BRIGHTEST)
    means, quats, scales, opacities, colours = leaves.values()
    render = rasterizer(
        RasterInputs(means, quats, scales, opacities, colours, camera, None, limits, stats, view)
    )
    pull = torch.tensor(rng.normal(size=(height, width, 4)), dtype=torch.float32).to(device)
    loss = (pull[..., :3] * torch.log(render.image + DIMMEST)).sum() + (pull[..., 3] * render.alpha).sum()
    loss.backward()  # type: ignore[no-untyped-call]
    results = {"image": render.image, "alpha": render.alpha}
    results |= {name: getattr(stats, name) for name in ("tension", "radius", "weight")}
    for name, leaf in leaves.items():
        assert leaf.grad is not None
        results[f"gradient of {name}"] = leaf.grad * (leaf if name in ("scales", "colours") else 1.0)
    if delta.grad is not None:
        results["gradient of the camera"] = delta.grad
    return {name: tensor.detach().cpu().double() for name, tensor in results.items()}


def _largest(errors: Iterable[float]) -> float:
    return float(np.max(list(errors)))  # NaN if one of them is
