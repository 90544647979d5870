"""Linear light as a display shows it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import torch

from imaging.arrays import AnyArray, Array32, Bytes
from imaging.colour.spaces import srgb_encode
from imaging.plates.middle_grey import MIDDLE_GREY, exposure_factor
from imaging.session.bands import false_colour
from imaging.session.records import Band
from imaging.session.session import Session
from recon.data.dataset import Dataset
from recon.observe.photographs import ToneCurve
from recon.scene.gaussians import Renderer
from recon.scene.sampling import Sampling
from recon.splat import SplatCamera
from recon.train.training import Training

Shown = Callable[[Array32, float], Bytes]
"""Linear Rec.709 [H, W, 3] times a factor as a display shows it, uint8 of the same shape."""
MOST_VIEWS = 8
"""Most views that determine the exposure of a scene."""
_FAINT = 1 / 255
"""Alpha below which a picture shows nothing, so that its colour does not matter."""


def display_scale(images: Iterable[AnyArray]) -> float:
    """The factor that brings the median of positive light to middle grey; 1 without any light."""
    lit = np.concatenate([image.reshape(-1) for image in images])
    lit = lit[lit > 0]
    return float(MIDDLE_GREY / np.median(lit)) if lit.size else 1.0


def displayed(image: AnyArray, scale: float) -> Bytes:
    """Linear light times a scale, clipped, as sRGB of 8 bits."""
    return np.asarray(np.round(255 * srgb_encode(np.clip(image * scale, 0, 1))), np.uint8)


def picture(
    light: Array32,
    alpha: Array32 | None,
    scale: float,
    shown: Shown = displayed,
) -> Bytes:
    """Light times a scale for a display.

    Args:
        light: Linear Rec.709 [H, W, 3]; with `alpha`, premultiplied by it.
        alpha: Opacity [H, W], 0..1; None of an opaque picture.
        scale: Factor on the light.
        shown: Encoding for the display.

    Returns:
        uint8 [H, W, 3]; with alpha straight RGBA [H, W, 4], as PNG has it.
    """
    if alpha is None:
        return shown(light, scale)
    straight = np.asarray(light / np.maximum(alpha, _FAINT)[..., None], np.float32)
    return np.dstack([shown(straight, scale), np.round(255 * alpha).astype(np.uint8)])


def in_colour(light: Array32, bands: Sequence[Band]) -> Array32:
    """Light [H, W, C] for the eye, linear Rec.709 [H, W, 3]: itself, or the false colours of bands."""
    return light if not bands else (light @ false_colour(bands).T).astype(np.float32)


def exposure_of(training: Training, dataset: Dataset) -> float:
    """Factor on light that shows a scene in training as middle grey: that of its session, as plates have it.

    Of light in another unit, by a learned curve, and of objects without a background: `display_scale` of
    renders of some of the views, evenly chosen, drawn as the scene that is stored: of held-out views nearer
    than all that trained it, with other blur.
    """
    observation, views = training.method.observation, dataset.views
    curved = isinstance(observation, ToneCurve) and observation.learned
    if not curved and not any(view.transparent for view in views):
        return exposure_factor(Session.open(dataset.session), dataset.calibration)
    chosen = sorted({round(place) for place in np.linspace(0, len(views) - 1, MOST_VIEWS)})
    means = training.gaussians.parameters["means"].detach()
    sampling = Sampling.of(means, [view.lens for view in dataset.train])
    renderer = replace(training.renderer(), sampling=sampling)
    lights = (_radiance(training, renderer, views[place].lens) for place in chosen)
    return display_scale(in_colour(light, dataset.bands) for light in lights)


def _radiance(training: Training, renderer: Renderer, camera: SplatCamera) -> Array32:
    """Linear radiance [H, W, C]."""
    with torch.no_grad():
        degree = training.method.degree(1.0)
        image = renderer(training.gaussians, camera, degree=degree).image
        return np.asarray(training.method.observation.radiance(image).cpu().numpy())
