"""A training between two iterations, and the plan that it follows."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import torch

from recon.data.dataset import View
from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.refinement import RATES, Refinement
from recon.scene.environment import NAME as ENVIRONMENT
from recon.scene.environment import RATE as ENVIRONMENT_RATE
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.splat import SplatStats
from recon.train.adam import Adam
from recon.train.densification import DensityRules
from recon.train.devices.ranks import Ranks
from recon.train.live_curve import Moment, held_out_psnr
from recon.train.schedule import Schedule

_CPU = torch.device("cpu")


@dataclass(frozen=True)
class Plan:
    """Plan of a training: iterations, growth and seed; everything else is a fraction of it.

    batch: views of an iteration before it takes a step. As in Grendel-GS (Zhao et al., arXiv
    2406.18533), learning rates grow with its square root, and Adam forgets as much a view as ever.
    measure: whether held-out views are measured on the way. rate_factor: of the learning rates, but for
    those of corrections.
    """

    iterations: int
    density: DensityRules
    seed: int = 0
    batch: int = 1
    log_every: int = 50
    checkpoint_seconds: float = 20.0
    measure: bool = False
    rate_factor: float = 1.0


@dataclass
class Training:
    """A training between two iterations: all that the next one depends on.

    schedule: None until it begins. curve: what was measured so far. ending: why the schedule was cut short,
    if it was. seconds: of training alone; measuring: those of measuring.
    """

    method: Method
    light: Light
    gaussians: Gaussians
    optimizer: Adam
    stats: SplatStats
    refinement: Refinement | None = None
    environment: Environment | None = None
    iteration: int = 0
    seconds: float = 0.0
    measuring: float = 0.0
    schedule: Schedule | None = None
    curve: list[Moment] = field(default_factory=list)
    ending: Literal["", "early stop", "goal"] = ""

    @classmethod
    def begin(
        cls,
        method: Method,
        light: Light,
        gaussians: Gaussians,
        extent: float,
        device: torch.device = _CPU,
        refinement: Refinement | None = None,
        environment: Environment | None = None,
    ) -> "Training":
        """Initialise a training on a device; `extent` scales the learning rate of the means."""
        gaussians = gaussians.to(device)
        method.observation.to(device)
        rates = {**method.geometry.all(extent), **method.appearance.rates, **method.observation.rates}
        parameters = {**gaussians.parameters, **method.observation.shared}
        if refinement is not None:
            refinement.to(device)
            rates |= {str(name): RATES[name] for name in refinement.parameters}
            parameters |= {str(name): value for name, value in refinement.parameters.items()}
        if environment is not None:
            environment.to(device)
            rates[ENVIRONMENT] = ENVIRONMENT_RATE
            parameters[ENVIRONMENT] = environment.ln_light
        groups = [
            {
                "name": name,
                "params": [value.requires_grad_(True)],
                "rate": rates[name],
                "lr": rates[name].start,
            }
            for name, value in parameters.items()
        ]
        optimizer = Adam(groups, eps=1e-15)
        stats = SplatStats(len(gaussians), device)
        return cls(method, light, gaussians, optimizer, stats, refinement, environment)

    def renderer(self) -> Renderer:
        """Return how its Gaussians are drawn."""
        limits = limits_for(self.light.reference, self.method.observation.display_values)
        return Renderer(self.method.appearance, limits, self.environment)

    def held_out_psnr(self, views: Sequence[View], progress: float, ranks: Ranks) -> float:
        """Quality of views, dB: see `live_curve.held_out_psnr`."""
        return held_out_psnr(
            self.method, self.gaussians, self.renderer(), self.refinement, views, progress, ranks
        )

    def parameters(self) -> list[torch.Tensor]:
        """Gaussians, what the observation model shares, and corrections."""
        return [tensor for group in self.optimizer.param_groups for tensor in group["params"]]

    def gather(self, ranks: Ranks, keep: bool = True) -> None:
        """Make the statistics those of all ranks; one that does not `keep` them counts anew from zero."""
        ranks.add([self.stats.tension])
        for largest in (self.stats.radius, self.stats.weight):
            ranks.raise_to_largest(largest)
        if not keep:
            self.count_anew()

    def count_anew(self) -> None:
        """Reset the density statistics."""
        self.stats = SplatStats(len(self.gaussians), self.gaussians.device)


Steer = Callable[[Training], int | None]
"""Asked after each iteration but the last: how many iterations, at least 1, what is left of the schedule
shall take from here on; None for as many as it would."""
