"""Held-out quality of a training on a view whose own pose, exposures or colours are uncertain too.

They are fitted on one half of the picture, with the Gaussians as they are, and the other half is judged. The
halves are squares that alternate as on a chessboard.
"""

from collections.abc import Collection
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from recon.data.dataset import View
from recon.observe.refinement import Refined, camera_delta
from recon.splat.corrected_camera import moved
from recon.splat.torch_threads import torch_on_one_thread
from recon.train.adam import Adam
from recon.train.training import Training

SQUARE = 8
"""Pixels."""
STEPS = 40
Unsure = Refined | Literal["gains"]
"""gains: of each channel, by which all of the view's light is multiplied."""
POSE_RATES = (2e-3, 1e-4)
EXPOSURE_RATES = (5e-2, 5e-4)
"""Learning rates of the exposures at the first and the last step. Adam's steps are about as long: exposures
half a stop off converge.
"""
ROUGHLY = 2 / 255
"""Noise of photographs, JPEG's included, in code values of 1, and of light through the mu-law."""


def robust_score_db(training: Training, view: View, unsure: Collection[Unsure], extent: float) -> float:
    """Return how small the residuals of the half that is judged are, dB; more is better.

    Residuals are in standard deviations of the noise, r: of RAW in those of the sensor where they are known,
    others, code values or light through the mu-law as training compares them, in so much as `ROUGHLY` says.
    Each counts by -10 log10(1 + r^2), as if errors were of a Cauchy distribution: a short training is wrong
    by a hundred deviations at the edges of lamps, whose squares would drown all others.

    Args:
        training: Training that is judged.
        view: View that it did not see.
        unsure: Which of the view's own pose, exposures and gains are fitted first.
        extent: Of the data set, scene coordinates; the unit of a correction of a place.

    Returns:
        Mean over the half that is judged, dB.
    """
    with torch_on_one_thread():
        pose, logs, gains = _fitted(training, view, unsure, extent)
    with torch_on_one_thread(), torch.no_grad():
        image = _image(training, view, pose, extent) * gains.exp()
        judged = _half(view, 1)
        if view.sensor.kind == "raw" and all(shot.noise is not None for shot in view.shots):
            return _whitened(training, image, view, logs, judged)
        prediction, target = training.method.observation.compare(image, view, 1.0, logs.exp())
        squares = ((prediction - target) / ROUGHLY).square()[..., _on_planes(judged, target)]
        return -10 / float(np.log(10)) * float(squares.log1p().mean(dtype=torch.float64))


def fitted_view(training: Training, view: View, unsure: Collection[Refined], extent: float) -> View:
    """A view as a training would have it: what of its own pose and exposures is `unsure`, fitted to it."""
    if not unsure:
        return view
    with torch_on_one_thread():
        pose, logs, _ = _fitted(training, view, unsure, extent)
    shots = tuple(
        replace(shot, k=shot.k * float(np.exp(log)))
        for shot, log in zip(view.shots, logs.tolist(), strict=True)
    )
    return replace(view, lens=moved(view.lens, camera_delta(pose, extent))[0], shots=shots)


def _fitted(
    training: Training, view: View, unsure: Collection[Unsure], extent: float
) -> tuple[Tensor, Tensor, Tensor]:
    """The view's correction of its pose [6], as `Refinement` has it, of ln k of its shots [shots], and the
    natural log of its gains [channels].
    """
    device = training.gaussians.parameters["means"].device
    pose, logs = torch.zeros(6), torch.zeros(len(view.shots), device=device)  # the host moves the camera
    gains = torch.zeros(view.channels, device=device)
    rates = {
        "poses": (pose, POSE_RATES), "exposures": (logs, EXPOSURE_RATES), "gains": (gains, EXPOSURE_RATES)
    }  # fmt: skip
    groups = [
        {"params": [value.requires_grad_(True)], "lr": first, "rates": (first, last)}
        for name, (value, (first, last)) in rates.items()
        if name in unsure
    ]
    if not groups:
        return pose, logs, gains
    optimizer = Adam(groups)
    for step in range(STEPS):
        for group in optimizer.param_groups:
            first, last = group["rates"]
            group["lr"] = first * (last / first) ** (step / STEPS)
        optimizer.zero_grad()
        image = _image(training, view, pose, extent) * gains.exp()
        prediction, target = training.method.observation.compare(image, view, 1.0, logs.exp())
        half = _on_planes(_half(view, 0), target)
        (prediction - target)[..., half].abs().mean().backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    return pose.detach(), logs.detach(), gains.detach()


def _image(training: Training, view: View, pose: Tensor, extent: float) -> Tensor:
    """Return what the view's camera sees where it is corrected to be, behind its corrected vignetting."""
    scene = {name: value.detach() for name, value in training.gaussians.parameters.items()}
    degree = training.method.degree(1.0)
    image = training.renderer()(
        replace(training.gaussians, parameters=scene), view.lens, degree=degree,
        camera_delta=camera_delta(pose, extent),
    ).image  # fmt: skip
    refinement = training.refinement
    return image if refinement is None else refinement.through_lens(image, view, 1.0).to(image.dtype)


def _whitened(training: Training, image: Tensor, view: View, logs: Tensor, judged: Tensor) -> float:
    """Mean over photosites of -10 log10(1 + r^2), r being residuals in standard deviations of the noise."""
    mask = judged.cpu().numpy()
    total, count = 0.0, 0
    for shot, log in zip(view.shots, logs.tolist(), strict=True):
        assert shot.noise is not None
        signal = training.method.observation.predict(image, view, shot.k * float(np.exp(log)), shot.band)
        residual = signal.cpu().numpy() - shot.pixels
        residual = np.where(shot.saturated, np.minimum(residual, 0.0), residual)
        squares = residual**2 / shot.noise.variance(np.maximum(shot.pixels, 0.0))
        counted = shot.valid & (mask if squares.ndim == 2 else mask[..., None])
        total -= 10 / np.log(10) * float(np.log1p(squares[counted]).sum(dtype=np.float64))
        count += int(counted.sum())
    return total / max(count, 1)


def _half(view: View, which: int) -> Tensor:
    """Bool [H, W]: the one half (0) or the other (1) of a view's pixels."""
    rows = torch.arange(view.lens.height)[:, None] // SQUARE
    return (rows + torch.arange(view.lens.width)[None] // SQUARE) % 2 == which


def _on_planes(half: Tensor, planes: Tensor) -> Tensor:
    """The same on planes [P, h, w], of which those of a mosaic have half the size."""
    step = half.shape[0] // planes.shape[-2]
    return half[::step, ::step].to(planes.device)
