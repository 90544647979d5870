"""Options that a user gives a training."""

from dataclasses import dataclass

from imaging.errors import InputError
from recon.decide.budget import Budget
from recon.decide.overrides import Overrides
from recon.decide.presets import MethodName, QualityName

LARGEST_SEED = 2**32 - 1
_DEFAULTS = Overrides()


@dataclass(frozen=True)
class TrainingRequest:
    """Options of a training: the command line, Python, a batch and the benches each make one.

    Attributes:
        method: "auto" chooses by the kind of the images.
        quality: Preset of iterations, Gaussians and width.
        budget: Time, size, number of Gaussians or quality; None: as the preset has it.
        seed: The same request and seed give the same bytes.
        overrides: Settings in place of the preset's and the method's.
        early_stop: Train no longer than was worth it for other scenes, and end when held-out quality stands
            still.
        name: Of the folder; None: made of method, quality and budget (`recon.result.place.default_name`).
        replace: Train anew where a scene of that name exists, and replace it once the new one is finished.

    Raises:
        InputError: The seed is out of range.
    """

    method: MethodName = "auto"
    quality: QualityName = "standard"
    budget: Budget | None = None
    seed: int = 0
    overrides: Overrides = _DEFAULTS
    early_stop: bool = False
    name: str | None = None
    replace: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= LARGEST_SEED:
            raise InputError(f"The seed {self.seed} is out of range: give a number from 0 to {LARGEST_SEED}.")
