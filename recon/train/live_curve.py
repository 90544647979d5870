"""The live curve: quality of held-out views while a training goes on, without looking at any truth."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

import torch

from imaging.metrics import PSNR_CAP
from recon.data.dataset import View
from recon.methods.method import Method
from recon.observe.refinement import Refinement
from recon.observe.shot_comparison import psnr_of, shot_psnr
from recon.scene.gaussians import Gaussians, Renderer
from recon.train.devices.ranks import Ranks

MOST_VIEWS = 4
MOST_MOMENTS = 16
ITERATIONS_A_RENDER = 10
"""Iterations between renders. A render without gradient costs about a third of an iteration: at this interval
some 3 %.
"""


@dataclass(frozen=True)
class Moment:
    """A point of the curve. seconds: of training, without the measuring; db: mean PSNR of the views."""

    iteration: int
    seconds: float
    db: float


def chosen_views(held_out: Sequence[View]) -> tuple[View, ...]:
    """Choose at most four of the held-out views that masks do not hide, spread over them."""
    shown = [view for view in held_out if not view.hidden]
    step = max(1, math.ceil(len(shown) / MOST_VIEWS))
    return tuple(shown[step // 2 :: step])


def period(iterations: int, views: int) -> int:
    """Iterations between two moments: at most 16 moments, and fewer where they would cost too much."""
    fitting = iterations // (ITERATIONS_A_RENDER * max(views, 1))
    return math.ceil(iterations / min(max(fitting, 1), MOST_MOMENTS))


def held_out_psnr(
    method: Method,
    gaussians: Gaussians,
    renderer: Renderer,
    refinement: Refinement | None,
    views: Sequence[View],
    progress: float,
    ranks: Ranks,
) -> float:
    """Mean over views of the PSNR, dB, of what their shots should hold against what they hold.

    The same figure as `raw_psnr` or `ldr_psnr` of an evaluation, of these views, over what masks leave of
    them; EXR, which has no white, is compared in mu-law. The planes that the loss compares would hide the end
    of a training: noise fills them in the dark.

    Args:
        method: Method in training, whose observation predicts the shots.
        gaussians: Gaussians as they are.
        renderer: Drawing of them.
        refinement: Corrections, of which those of the lenses are applied; None: without.
        views: Held-out views.
        progress: Share of the training that is done, 0..1.
        ranks: Processes that share the views.

    Returns:
        The mean, the same on all ranks; `-PSNR_CAP` if no view has a valid sample.
    """
    total, count = 0.0, 0
    with torch.no_grad():
        for view in views[ranks.number :: ranks.count]:
            degree = method.degree(progress)
            image = renderer(gaussians, view.lens, degree=degree).image
            if refinement is not None:
                image = refinement.through_lens(image, view, progress)
            if view.sensor.kind == "hdr":
                prediction, target = method.observation.compare(image, view, progress)
                # What is not valid is equal in both: it adds nothing to the sum.
                valid = sum(int(shot.valid.sum()) for shot in view.shots)
                error = float((prediction - target).double().square().sum())
                psnrs = [psnr_of(error / valid)] if valid else []
            else:
                figures = (
                    shot_psnr(method.observation.predict(image, view, shot.k, shot.band), shot)
                    for shot in view.shots
                )
                psnrs = [psnr for psnr in figures if psnr is not None]
            if psnrs:
                total, count = total + fmean(psnrs), count + 1
    together, measured = ranks.totals(total, count)
    return together / measured if measured else -PSNR_CAP
