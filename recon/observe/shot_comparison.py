"""A prediction beside the shot that it is of: both clipped as the sensor clips, and over what is valid."""

import math

import torch
from torch import Tensor

from imaging.metrics import PSNR_CAP
from recon.data.shot import Shot


def as_recorded(predicted: Tensor, shot: Shot) -> tuple[Tensor, Tensor]:
    """Predicted and recorded signal, of the shape of the shot, as they are to be compared.

    predicted: as `Observation.predict` has it. Both end where the sensor saturates, which may be below the
    white level of the file; and a sample that is saturated, or made of some that are, only says that the
    scene is at least so bright. Developed photographs end at code 1. Where the shot is not valid both are 0.
    """
    recorded = torch.from_numpy(shot.pixels).to(predicted).clamp_max(shot.top)
    clipped = predicted.clamp_max(shot.top)
    if shot.ceiling is not None:
        saturated = torch.tensor(shot.saturated).to(predicted.device)
        clipped = torch.where(saturated, torch.minimum(clipped, recorded), clipped)
    valid = torch.tensor(shot.valid).to(predicted.device)
    return torch.where(valid, clipped, 0.0), torch.where(valid, recorded, 0.0)


def shot_psnr(predicted: Tensor, shot: Shot) -> float | None:
    """PSNR of a signal of peak 1 over what is valid of a shot, dB; None if nothing is."""
    count = int(shot.valid.sum())
    if not count:
        return None
    clipped, recorded = as_recorded(predicted, shot)
    return psnr_of(float((clipped - recorded).double().square().sum()) / count)


def psnr_of(error: float) -> float:
    """PSNR of a mean squared error, dB, within the bounds of `imaging.metrics`."""
    if not math.isfinite(error):
        return -PSNR_CAP
    return -10 * math.log10(min(max(error, 10 ** (-PSNR_CAP / 10)), 10 ** (PSNR_CAP / 10)))
