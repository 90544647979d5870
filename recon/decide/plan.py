"""A training as it was decided."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import torch

from imaging.session.records import Rung
from recon.data.dataset import Dataset
from recon.data.light import Light
from recon.decide.cost.prediction import Prediction
from recon.decide.settings import Settings
from recon.decide.steps.corrections import UNCORRECTED, Corrections
from recon.scene.environment import Environment
from recon.start.initialisation import Start, gaussians_at
from recon.train.training import Training


@dataclass(frozen=True)
class TrainingPlan:
    """A training as it was decided, without the photographs: several processes are sent the same one.

    settings: the requested ones, with decisions in place of defaults. points: to start from, and `far`, the
    environment behind them: not needed, nor are the corrections, when training resumes from a checkpoint.
    rungs: the evidence for the decisions; that for the corrections is in `corrections`.
    """

    settings: Settings
    light: Light
    corrections: Corrections = UNCORRECTED
    rungs: tuple[Rung, ...] = ()
    prediction: Prediction | None = None
    points: Start | None = None
    far: Environment | None = None

    def training(self, dataset: Dataset, device: torch.device) -> Training:
        """A training of this plan, not yet begun."""
        assert self.points is not None
        method = self.settings.composed(dataset, self.light)
        gaussians = gaussians_at(self.points, method.appearance, method.observation.units)
        refinement = self.corrections.begun(dataset)
        far = None if self.far is None else self.far.copied()
        return Training.begin(method, self.light, gaussians, dataset.extent, device, refinement, far)

    def facts(self) -> dict[str, Any]:
        """The plan for a checkpoint, as JSON; the light is stored with the training."""
        return {
            "settings": self.settings.model_dump(mode="json"),
            "rungs": [rung.model_dump(mode="json") for rung in self.rungs],
            "predicted": self.prediction and self.prediction.model_dump(mode="json"),
        }

    @classmethod
    def stored(cls, facts: Mapping[str, Any], light: Light) -> Self:
        """Read back the plan of a checkpoint."""
        return cls(
            Settings.model_validate(facts["settings"]),
            light,
            rungs=tuple(Rung.model_validate(rung) for rung in facts["rungs"]),
            prediction=facts["predicted"] and Prediction.model_validate(facts["predicted"]),
        )
