"""Votes of photographs on a Gaussian: its signal above noise, and the views that would gain or lose without
it.

A rendered pixel is affine in the opacity of each Gaussian, so `o dC/do` is exactly what it adds to the pixel
in place of what is behind it: one derivative is one removal. In units of the noise of a view, the sum of its
squares is how far above noise the Gaussian is, and that less twice its product with the residuals is what
chi-square would gain if it were gone. Sums of squares of derivatives are estimated by random signs
(Hutchinson 1990), so that a view costs a backward pass a probe, by the existing passes, whatever the device.
Noise is the difference of the render from the photographs of a view: that of the sensor, and the Gaussians'
own error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from recon.data.dataset import View
from recon.scene.gaussians import Gaussians
from recon.train.training import Training

PROBES = 2
SIGNIFICANT = 9.0
"""Chi-square that three standard deviations of one sample make."""


@dataclass
class Evidence:
    """Evidence on N Gaussians over the selected views.

    seen: int32 [N], views in which it is above noise. needed, opposed: int32 [N], views whose photographs get
    worse, or better, without it; all by `SIGNIFICANT`. total: float64 [N], what chi-square of all views gains
    if it goes.
    """

    visible: Tensor
    needed: Tensor
    opposed: Tensor
    total: Tensor


def evidence(
    training: Training, views: Sequence[View], done: float, seed: int, probes: int = PROBES
) -> Evidence:
    """Ask the photographs of views; done: where on the schedule the training is, 0..1."""
    gaussians = training.gaussians
    parameters = {name: value.detach() for name, value in gaussians.parameters.items()}
    logits = parameters["opacity_logits"].clone().requires_grad_(True)
    asked = Gaussians(parameters | {"opacity_logits": logits})
    # d logit is o (1 - o) d o, and wanted is o d / d o.
    through = torch.sigmoid(-logits.detach()).clamp_min(1e-6).double()
    count = len(gaussians)
    votes = Evidence(
        torch.zeros(count, dtype=torch.int32, device=gaussians.device),
        torch.zeros(count, dtype=torch.int32, device=gaussians.device),
        torch.zeros(count, dtype=torch.int32, device=gaussians.device),
        torch.zeros(count, dtype=torch.float64, device=gaussians.device),
    )
    generator = torch.Generator().manual_seed(seed)
    for view in views:
        prediction, target = _shown(training, asked, view, done)
        missed = (prediction - target).detach()
        variance = (missed.square().sum() / (missed != 0).sum().clamp_min(1)).clamp_min(1e-12).double()
        power = torch.zeros_like(votes.total)
        for _ in range(probes):
            signs = torch.randint(0, 2, prediction.shape, generator=generator).to(prediction) * 2 - 1
            power += (_derivative(prediction, signs, logits) / through).square()
        power /= probes * variance
        gain = power - 2 * _derivative(prediction, missed, logits) / through / variance
        votes.visible += power > SIGNIFICANT
        votes.needed += gain > SIGNIFICANT
        votes.opposed += gain < -SIGNIFICANT
        votes.total += gain
    return votes


def _derivative(prediction: Tensor, weights: Tensor, logits: Tensor) -> Tensor:
    (gradient,) = torch.autograd.grad(prediction, logits, weights, retain_graph=True)
    return gradient.double()


def _shown(training: Training, gaussians: Gaussians, view: View, done: float) -> tuple[Tensor, Tensor]:
    """Return what a view shows and what its photographs do, as the loss compares them."""
    method, refinement = training.method, training.refinement
    delta = refinement.motion(view, done) if refinement else None
    factors = refinement.factors(view, done) if refinement else None
    degree = method.degree(done)
    render = training.renderer()(gaussians, view.lens, degree=degree, camera_delta=delta)
    image = refinement.through_lens(render.image, view, done) if refinement else render.image
    return method.observation.compare(image, view, done, factors)
