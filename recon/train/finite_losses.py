"""A training whose loss is not a number ends, and says at which view."""

import math
from dataclasses import dataclass, field

import torch
from torch import Tensor

from imaging.errors import ReconstructionError
from recon.data.dataset import View
from recon.train.training import Training


@dataclass
class FiniteLosses:
    """The losses of views, each read once: on the CPU as it comes, on a GPU when asked for."""

    training: Training
    _unread: list[tuple[View, int, Tensor]] = field(default_factory=list, init=False)

    def add(self, view: View, loss: Tensor) -> None:
        """Note the loss of a view, a scalar without gradient, in the iteration that is under way."""
        self._unread.append((view, self.training.iteration + 1, loss))
        if loss.device.type == "cpu":
            self.require()

    def require(self) -> None:
        """ReconstructionError names the first view since the last time whose loss was not finite."""
        if not self._unread:
            return
        values = torch.stack([loss for _, _, loss in self._unread]).tolist()
        noted, self._unread = self._unread, []
        for (view, iteration, _), value in zip(noted, values, strict=True):
            if not math.isfinite(value):
                raise ReconstructionError(self._sentence(view, iteration, value))

    def _sentence(self, view: View, iteration: int, value: float) -> str:
        head = f"Training stopped at iteration {iteration}, where the loss of view {view.name} is {value}"
        if (name := self._spoilt()) is not None:
            return f"{head}: {name}, which views share, is not finite any more, so train with another --seed."
        scales = [shot.k for shot in view.shots]
        falloff = view.sensor.falloff
        return (
            f"{head}: its photographs or its calibration, with exposure scales of {min(scales):.3g} to "
            f"{max(scales):.3g} s and a falloff of {falloff.min():.3g} to {falloff.max():.3g}, have numbers "
            "that no picture has; calibrate again, or leave that frame out."
        )

    def _spoilt(self) -> str | None:
        """Return the shared parameter, Gaussians aside, that is not finite, or None.

        On a GPU steps were taken since, so that a view may have spoilt it itself: nothing is said there.
        """
        training = self.training
        if training.gaussians.device.type != "cpu":
            return None
        for group in training.optimizer.param_groups:
            if group["name"] not in training.gaussians.parameters and not all(
                torch.isfinite(value.detach()).all() for value in group["params"]
            ):
                return str(group["name"])
        return None
