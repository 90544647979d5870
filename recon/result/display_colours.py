"""Colours for viewers, which blend display values: what a display shows of the light, exposed and in sRGB."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array
from imaging.colour import srgb_encode
from imaging.progress import Progress
from recon.result.display import displayed
from recon.scene.appearance import PlainHarmonics, Rate
from recon.scene.gaussians import GEOMETRY, Gaussians, Renderer
from recon.scene.harmonics import COEFFICIENTS
from recon.scene.ply import fitted_harmonics
from recon.splat import Limits, SplatCamera
from recon.splat.torch_threads import torch_on_one_thread
from recon.train.adam import Adam

Pair = tuple[SplatCamera, Tensor]

MOST_VIEWS = 32
"""Most views that colours are fitted to, evenly chosen."""
MOST_STEPS = 100
DC_RATE, REST_RATE = Rate(0.15, 0.015), Rate(0.03, 0.003)
"""The demo's draft comes to 34.0 dB; with two fifths of them to 32.9, with twice as much to 31.6."""


def steps_after(iterations: int) -> int:
    """Return how long to fit colours after a training: short ones are not outlasted by it."""
    return min(MOST_STEPS, iterations // 3)


@dataclass(frozen=True)
class DisplayColours:
    """Harmonics of display colours: float64 [N, (degree + 1)^2, 3], those of 3DGS, of sRGB codes in 0..1.

    db: PSNR of viewers' drawings with them, against the light exposed, clipped and encoded, over the views
    that they were not fitted to; over all without such views.
    """

    harmonics: Array
    db: float


def display_colours(
    gaussians: Gaussians,
    splats: Gaussians,
    renderer: Renderer,
    degree: int,
    exposure: float,
    steps: int,
    *,
    fitted: Sequence[SplatCamera],
    judged: Sequence[SplatCamera],
    progress: Progress,
) -> DisplayColours:
    """Fit display colours to Gaussians of linear light; `exposure` times the drawing of `renderer` is shown,
    1 as white.

    splats: those that viewers draw in place of `gaussians`, which are among them; the others represent the
    environment that viewers do not support.

    Blending display values is another thing than showing blended light: a lamp behind a veil is clipped
    before it is dimmed. So the harmonics of each Gaussian's own display values, least squares over all
    directions, are only the start of a short fit, which brings the drawing of viewers near to the light of
    `fitted`; places, sizes and opacities stay what they are. The same scene gives the same colours.
    """
    device = gaussians.parameters["means"].device

    def codes(directions: Tensor) -> Array:
        with torch.no_grad():
            light = renderer.appearance.colours(splats.parameters, directions.to(device), degree)
        return np.asarray(srgb_encode(np.clip(light.double().cpu().numpy() * exposure, 0, 1)))

    start = torch.from_numpy(fitted_harmonics(codes, len(splats), degree)).float().to(device)
    count = start.shape[1]
    constant, rest = start[:, :1].clone(), start.new_zeros(len(start), COEFFICIENTS - 1, 3)
    rest[:, : count - 1] = start[:, 1:]
    model = Gaussians({name: splats.parameters[name].detach() for name in GEOMETRY})
    model.parameters |= {"sh_dc": constant, "sh_rest": rest}
    viewer = Renderer(PlainHarmonics(), Limits.gsplat())
    with torch_on_one_thread():
        pairs = [_shown(gaussians, renderer, degree, exposure, camera) for camera in _evenly(fitted)]
        _fit(model, viewer, degree, pairs, steps, progress)
        others = (_shown(gaussians, renderer, degree, exposure, camera) for camera in _evenly(judged))
        error = float(
            np.mean([_error(model, viewer, degree, pair) for pair in (others if judged else pairs)])
        )
    harmonics = torch.cat([constant, rest[:, : count - 1]], 1).detach().double().cpu().numpy()
    return DisplayColours(harmonics, -10 * math.log10(max(error, 1e-10)))


@torch.no_grad()
def _shown(
    gaussians: Gaussians, renderer: Renderer, degree: int, exposure: float, camera: SplatCamera
) -> Pair:
    """A camera and what a display shows of the light that it sees, [H, W, 3], uint8."""
    light = renderer(gaussians, camera, degree=degree).image
    return camera, torch.from_numpy(displayed(light.cpu().numpy(), exposure)).to(light.device)


def _fit(
    model: Gaussians, viewer: Renderer, degree: int, pairs: Sequence[Pair], steps: int, progress: Progress
) -> None:
    """Bring what `viewer` draws of `model` nearer to pictures; in place."""
    rates = {"sh_dc": DC_RATE, "sh_rest": REST_RATE}
    groups = [{"name": name, "params": [model.parameters[name].requires_grad_(True)]} for name in rates]
    optimizer = Adam(groups, eps=1e-15)
    order = np.random.Generator(np.random.PCG64(0)).permutation(len(pairs))
    for step in range(steps):
        progress("fitting display colours", step, steps)
        for group in optimizer.param_groups:
            group["lr"] = rates[group["name"]].at(step / steps)
        camera, shown = pairs[order[step % len(pairs)]]
        optimizer.zero_grad()
        image = viewer(model, camera, degree=degree).image
        (image.clamp(0, 1) - shown / 255).square().mean().backward()
        optimizer.step()


@torch.no_grad()
def _error(model: Gaussians, viewer: Renderer, degree: int, pair: Pair) -> float:
    """Mean square of the distance from a picture."""
    camera, shown = pair
    image = viewer(model, camera, degree=degree).image.clamp(0, 1)
    return float((image - shown / 255).square().mean(dtype=torch.float64))


def _evenly(cameras: Sequence[SplatCamera]) -> list[SplatCamera]:
    count = min(len(cameras), MOST_VIEWS)
    return [cameras[round(place)] for place in np.linspace(0, len(cameras) - 1, count)]
