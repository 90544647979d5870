"""Settings of a training besides the session."""

import math
from dataclasses import replace

from imaging.record import Record
from imaging.session.calibration import StatedPart
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.decide.cost.budget import Budget, Unit
from recon.decide.overrides import Overrides
from recon.decide.presets import QUALITIES, START_SHARE, QualityName, TrainedMethod, downwards
from recon.decide.request import TrainingRequest
from recon.methods import METHODS
from recon.methods.method import Method
from recon.train.densification import DensityRules
from recon.train.schedule import rate_factor
from recon.train.training import Plan


class Settings(Record):
    """Settings of a training besides the session: the same settings and seed give the same bytes."""

    method: TrainedMethod
    quality: QualityName
    seed: int
    iterations: int
    """Iterations as planned at the start; a budget in seconds was turned into this number from the speed
    measured then.
    """
    max_gaussians: int
    """Maximum number of Gaussians as requested, or, of a training that was begun, as chosen."""
    max_width: int
    batch: int = 1
    """Views a step; as many as processes trained together."""
    budget: float | None = None
    """Budget as requested, in `budget_unit`; None: the preset."""
    budget_unit: Unit = "s"
    early_stop: bool = False
    """True if training ends once it stops improving."""
    all_views: bool = False
    """True if no view is held out."""
    overrides: Overrides = Overrides()
    """Overrides by the user."""
    environment: bool = False
    """True if light from far away is behind the Gaussians, as decided."""
    depth: float = 0.0
    """Weight of measured depth in the loss, as decided."""
    depth_scale: float | None = None
    """Factor of the units of depth maps; None: without maps, or they are left out."""
    degree: int | None = None
    """Degree of the harmonics, as chosen for the scene; None: that of `overrides` or the method."""
    overruled: tuple[StatedPart, ...] = ()
    """Parts of the photographs' light in which scene points overrule the files, as decided."""

    @property
    def watches(self) -> bool:
        """True if held-out views may end the training."""
        return self.early_stop or (self.budget is not None and self.budget_unit == "dB")

    @property
    def start_share(self) -> float:
        """Share of the Gaussians that training begins with; the rest it grows."""
        return START_SHARE if self.overrides.growth is None else 1 - self.overrides.growth

    def no_larger(self, width: int, gaussians: int | None = None) -> "Settings":
        """The same of pictures no wider, px, and no more Gaussians, where these were not set by hand."""
        update = {}
        if self.overrides.width is None:
            update["max_width"] = min(self.max_width, width)
        if gaussians is not None and self.overrides.gaussians is None:
            update["max_gaussians"] = min(self.max_gaussians, gaussians)
        return self.model_copy(update=update)

    def downwards(self, views: int) -> tuple["Settings", ...]:
        """These and what a time without room for them may fall back on, largest first, for training views."""
        sizes = [self]
        for preset in (QUALITIES[name] for name in downwards(self.quality)[1:]):
            smaller = sizes[-1].no_larger(preset.width, preset.gaussians_of(views))
            if smaller != sizes[-1]:
                sizes.append(smaller)
        return tuple(sizes)

    @property
    def size(self) -> str:
        """Width and number of Gaussians, in words."""
        return f"{self.max_width} px and {self.max_gaussians:,} Gaussians"

    def words(self) -> dict[str, str]:
        """Return what a person asked for, by name."""
        return {
            "method": self.method,
            "quality": self.quality,
            "seed": str(self.seed),
            "budget": "none" if self.budget is None else str(Budget(self.budget, self.budget_unit)),
            "early stop": "on" if self.early_stop else "off",
            "held-out views": "none" if self.all_views else "as usual",
            "settings": " ".join(self.overrides.words()) or "of the preset",
        }

    def composed(self, dataset: Dataset, light: Light) -> Method:
        """The method with what was set and decided."""
        overrides = (
            self.overrides
            if self.degree is None
            else self.overrides.model_copy(update={"degree": self.degree})
        )
        return replace(overrides.composed(METHODS[self.method](dataset, light)), depth_weight=self.depth)

    def plan(self) -> Plan:
        """The whole training."""
        return Plan(
            self.iterations,
            DensityRules(self.max_gaussians),
            self.seed,
            self.batch,
            measure=True,
            rate_factor=rate_factor(self.iterations * self.batch),
        )


def asked_for(dataset: Dataset, method: str, request: TrainingRequest, *, processes: int) -> Settings:
    """Settings as requested: a size in the budget, else an override, else the preset.

    Args:
        dataset: Views to train on: a preset's iterations and Gaussians depend on their number, and a budget
            in Gaussians is limited to that of their pixels.
        method: As chosen.
        request: Of the training.
        processes: That train together: a step takes a view of each, and the number of steps is divided by
            theirs.

    Returns:
        Settings before anything is decided by the scene.
    """
    preset, budget, overrides = QUALITIES[request.quality], request.budget, request.overrides
    iterations = overrides.iterations or preset.iterations_of(len(dataset.train))
    pixels = sum(view.lens.width * view.lens.height for view in dataset.train)
    return Settings.model_validate(
        {
            "method": method,
            "quality": request.quality,
            "seed": request.seed,
            "iterations": math.ceil(iterations / processes),
            "batch": processes,
            "max_gaussians": request.most_gaussians(len(dataset.train), pixels),
            "max_width": overrides.width or preset.width,
            "budget": None if budget is None else budget.amount,
            "budget_unit": "s" if budget is None else budget.unit,
            "early_stop": request.early_stop,
            "all_views": request.all_views,
            "overrides": overrides,
        }
    )
