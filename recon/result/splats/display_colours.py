"""Colours for viewers, which blend display values: what a display shows of the light, exposed and in sRGB."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from imaging.arrays import Array
from imaging.colour.spaces import srgb_encode
from imaging.progress import Progress
from recon.result.display import displayed
from recon.result.splats.viewers import viewers_of
from recon.scene.appearance import Rate
from recon.scene.gaussians import GEOMETRY, Gaussians, Renderer
from recon.scene.harmonics import C0, COEFFICIENTS
from recon.scene.ply import fitted_harmonics
from recon.splat import SplatCamera
from recon.splat.torch_threads import torch_on_one_thread
from recon.train.adam import Adam

Pair = tuple[SplatCamera, Tensor]

MOST_VIEWS = 32
"""Most views that colours are fitted to, evenly chosen."""
MOST_STEPS = 100
DC_RATE, REST_RATE = Rate(0.15, 0.015), Rate(0.03, 0.003)
"""Rates of the constant coefficients, and of the others in MOST_STEPS steps; fewer steps are longer."""
_OVER_WHITE = 0.3
"""Weight of the logarithm of a code above 1, for codes that do not end there, beside the code below."""


def steps_after(iterations: int) -> int:
    """Return how long to fit colours after a training: short ones are not outlasted by it."""
    return min(MOST_STEPS, iterations // 3)


@dataclass(frozen=True)
class DisplayColours:
    """Harmonics of display colours: float64 [N, (degree + 1)^2, 3], those of 3DGS, of sRGB codes in 0..1.

    db: PSNR of viewers' drawings with them, against the light exposed, clipped and encoded, over the views
    that they were not fitted to and the viewers; over all views without such ones.
    """

    harmonics: Array
    db: float


@dataclass(frozen=True)
class LitScene:
    """Linear light that display colours stand for.

    Attributes:
        gaussians: Of the scene.
        renderer: Draws them.
        degree: Of the harmonics.
        exposure: Factor of the drawn light, of which 1 is shown as white.
        end: Largest code of a Gaussian; above 1 the formula of sRGB goes on, for viewers that decode colours
            before they map tones.
    """

    gaussians: Gaussians
    renderer: Renderer
    degree: int
    exposure: float
    end: float = 1.0


def display_colours(
    scene: LitScene,
    splats: Gaussians,
    steps: int,
    *,
    fitted: Sequence[SplatCamera],
    judged: Sequence[SplatCamera],
    progress: Progress,
) -> DisplayColours:
    """Fit display colours to Gaussians of linear light.

    Blending display values is another thing than showing blended light: a lamp behind a veil is clipped
    before it is dimmed. So the harmonics of each Gaussian's own display values, least squares over all
    directions, are only the start of a short fit, which brings the drawings of viewers, in turn, near to the
    light of `fitted`; places, sizes and opacities stay what they are. Some viewers clip each Gaussian, so
    constants stay within 0..end. The same scene gives the same colours.

    Args:
        scene: Light that is to be shown.
        splats: Gaussians that viewers draw in place of the scene's, which are among them; the others
            represent the environment that viewers do not support.
        steps: Of the fit.
        fitted: Cameras whose drawings are brought near to the light.
        judged: Cameras whose drawings are compared with it.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        Harmonics of the display colours, and how near they come.
    """
    degree, end, renderer = scene.degree, scene.end, scene.renderer
    device = scene.gaussians.parameters["means"].device

    def codes(directions: Tensor) -> Array:
        with torch.no_grad():
            light = renderer.appearance.colours(splats.parameters, directions.to(device), degree)
        return np.asarray(srgb_encode(light.double().cpu().numpy() * scene.exposure, end=end))

    start = torch.from_numpy(fitted_harmonics(codes, len(splats), degree)).float().to(device)
    count = start.shape[1]
    constant, rest = start[:, :1].clone(), start.new_zeros(len(start), COEFFICIENTS - 1, 3)
    rest[:, : count - 1] = start[:, 1:]
    model = Gaussians({name: splats.parameters[name].detach() for name in GEOMETRY})
    model.parameters |= {"sh_dc": constant, "sh_rest": rest}
    viewers = viewers_of(len(splats), end)

    def shown(cameras: Sequence[SplatCamera]) -> list[Pair]:
        return [_shown(scene, camera) for camera in _evenly(cameras)]

    with torch_on_one_thread():
        pairs = shown(fitted)
        _fit(model, viewers, degree, pairs, steps, progress, end)
        judges = shown(judged) if judged else pairs
        error = np.mean([_error(model, viewer, degree, pair) for pair in judges for viewer in viewers])
    harmonics = torch.cat([constant, rest[:, : count - 1]], 1).detach().double().cpu().numpy()
    return DisplayColours(harmonics, -10 * math.log10(max(float(error), 1e-10)))


@torch.no_grad()
def _shown(scene: LitScene, camera: SplatCamera) -> Pair:
    """A camera and the codes of the light that it sees, [H, W, 3]: uint8 of what a display shows, or float32
    up to `scene.end`.
    """
    light = scene.renderer(scene.gaussians, camera, degree=scene.degree).image
    values, exposure, end = light.cpu().numpy(), scene.exposure, scene.end
    codes = displayed(values, exposure) if end == 1 else srgb_encode(values * np.float32(exposure), end=end)
    return camera, torch.from_numpy(codes).to(light.device)


def _fit(
    model: Gaussians,
    viewers: Sequence[Renderer],
    degree: int,
    pairs: Sequence[Pair],
    steps: int,
    progress: Progress,
    end: float,
) -> None:
    """Bring what `viewers` draw of `model` nearer to pictures; in place."""
    rates = {"sh_dc": DC_RATE, "sh_rest": REST_RATE}
    groups = [{"name": name, "params": [model.parameters[name].requires_grad_(True)]} for name in rates]
    optimizer = Adam(groups, eps=1e-15)
    order = np.random.Generator(np.random.PCG64(0)).permutation(len(pairs))
    longer = math.sqrt(MOST_STEPS / max(steps, 1))
    for step in range(steps):
        progress("fitting display colours", step, steps)
        for group in optimizer.param_groups:
            group["lr"] = longer * rates[group["name"]].at(step / steps)
        turn, place = divmod(step, len(pairs))
        camera, shown = pairs[order[place]]
        # Viewers move on with each turn, since an even number of pictures would meet the same viewer always.
        viewer = viewers[(place + turn) % len(viewers)]
        optimizer.zero_grad()
        image = viewer(model, camera, degree=degree).image
        off = image.clamp(0, 1) - shown / 255 if end == 1 else _weighed(image) - _weighed(shown)
        off.square().mean().backward()
        optimizer.step()
        with torch.no_grad():
            model.parameters["sh_dc"].clamp_(-0.5 / C0, (end - 0.5) / C0)


def _weighed(codes: Tensor) -> Tensor:
    """Codes below 1, and above it a logarithm, of which less matters."""
    return torch.where(codes <= 1, codes, 1 + _OVER_WHITE * codes.clamp_min(1).log())


@torch.no_grad()
def _error(model: Gaussians, viewer: Renderer, degree: int, pair: Pair) -> float:
    """Mean square of the distance from a picture."""
    camera, shown = pair
    codes = shown / 255 if shown.dtype == torch.uint8 else shown.clamp(0, 1)
    image = viewer(model, camera, degree=degree).image.clamp(0, 1)
    return float((image - codes).square().mean(dtype=torch.float64))


def _evenly(cameras: Sequence[SplatCamera]) -> list[SplatCamera]:
    count = min(len(cameras), MOST_VIEWS)
    return [cameras[round(place)] for place in np.linspace(0, len(cameras) - 1, count)]
