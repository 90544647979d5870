"""Memory of a GPU that a training takes: forecast before it begins, and explained where it was too little.

Bytes are counted in the tables of `recon.splat.gpu`; how many pairs of a Gaussian and a tile a view has is
estimated from trainings on the processor. Targets of the views are kept there only as far as there is room
(`recon.observe.targets`).
"""

from pathlib import Path

import torch

from imaging.compute import memory
from imaging.errors import InputError, ReconstructionError
from recon.data.dataset import Dataset
from recon.data.resident import FLOAT, pixels_of
from recon.decide.cost.memory_need import ADAM, NUMBERS, step_bytes
from recon.decide.settings import Settings
from recon.decide.steps.size import most_for
from recon.scene.harmonics import DEGREE
from recon.train.devices.training_device import device_name

TABLES = 600
"""Bytes of a Gaussian beside its numbers: projected (105), its gradients and moments (116), its statistics,
and its colours and shapes on their way there and back."""
PAIR = 224
"""Bytes of a pair until its gradient is summed: row, slot, transmittances, place in its list."""
PAIRS_OF_PIXEL, PAIRS_OF_GAUSSIAN = 2, 4
"""Pairs of a view, at most: trainings on the demo, lego at 400 px and a castle at 1,280 px end with 0.6 to
1.0 entries of tiles of 16x16 a pixel, of which half as large tiles have at most twice as many; then a few of
each Gaussian that is smaller than a tile."""
ELSEWHERE = "or put CUDA_VISIBLE_DEVICES= in front of the command to train on the processor"


def needed(pixels: int, step: int, gaussians: int, degree: int) -> int:
    """Bytes of a GPU that a training takes at the peak.

    Args:
        pixels: Of the largest view.
        step: Bytes of the largest view's comparison with its shots, as of `step_bytes`.
        gaussians: Most Gaussians of the training.
        degree: Of the harmonics, 0..2.

    Returns:
        Bytes.
    """
    numbers = sum(NUMBERS[: degree + 1])
    pairs = PAIRS_OF_PIXEL * pixels + PAIRS_OF_GAUSSIAN * gaussians
    return gaussians * (FLOAT * ADAM * numbers + TABLES) + PAIR * pairs + step


def require_room(dataset: Dataset, asked: Settings, device: torch.device) -> None:
    """InputError, with the number of Gaussians that would fit, unless a GPU has memory for a training."""
    if device.type != "cuda":
        return
    free, _ = torch.cuda.mem_get_info(device)
    degrees = range(DEGREE + 1) if asked.overrides.degree is None else (asked.overrides.degree,)
    pixels = max(map(pixels_of, dataset.views))
    step = max(map(step_bytes, dataset.views))
    # A file of some bytes holds more Gaussians of a lower degree, which may take more memory in all.
    total = max(needed(pixels, step, most_for(dataset, asked, degree), degree) for degree in degrees)
    if total <= free:
        return
    fixed, one = (needed(pixels, step, count, degrees[-1]) for count in (0, 1))
    fitting = int(0.98 * (free - fixed) / (one - fixed)) // 1000 * 1000
    if 4 * fitting * (one - fixed) < total - fixed:
        fix = "give a smaller --set width"
    elif asked.budget_unit in ("bytes", "Gaussians"):
        fix = f"give --budget {fitting // 1000}k"
    else:
        fix = f"give --set gaussians={fitting}"
    raise InputError(
        f"Training on {dataset.session} takes about {memory.text(total)} of the memory of "
        f"{device_name(device)} where {memory.text(free)} are free: {fix}, {ELSEWHERE}."
    )


def exceeded(folder: Path, device: torch.device, *, resumable: bool) -> ReconstructionError:
    """Return the error for a training in a folder whose GPU had too little memory after all.

    resumable: whether a checkpoint is there.
    """
    what = f"{device_name(device)} has too little memory for the training in {folder}"
    again = ", which goes on from its checkpoint" if resumable else ""
    return ReconstructionError(
        f"{what}: close other programs that use it and run the command again{again}, {ELSEWHERE}; or train "
        "fewer Gaussians, by --set gaussians, or by a smaller --budget that limits them, and --replace."
    )
