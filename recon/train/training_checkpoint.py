"""A training as a checkpoint, and back: it goes on bit for bit."""

from typing import Any

import torch

from recon.data.light import Light
from recon.methods.method import Method
from recon.observe.refinement import Refinement
from recon.scene.checkpoint import Checkpoint
from recon.scene.environment import NAME as ENVIRONMENT
from recon.scene.environment import Environment
from recon.scene.gaussians import Gaussians
from recon.train.live_curve import Moment
from recon.train.schedule import Schedule
from recon.train.training import Training

_CPU = torch.device("cpu")
_STATS = ("tension", "radius", "weight")


def checkpoint_of(training: Training, facts: dict[str, Any]) -> Checkpoint:
    """All of a training as tensors and facts, beside further `facts`."""
    corrections = {} if training.refinement is None else training.refinement.parameters
    rungs = () if training.refinement is None else training.refinement.rungs
    far = {} if training.environment is None else training.environment.tensors()
    stats = {f"stats.{key}": getattr(training.stats, key).clone() for key in _STATS}
    state = {
        "iteration": training.iteration,
        "seconds": training.seconds,
        "measuring": training.measuring,
        "schedule": training.schedule and training.schedule.turns,
        "curve": [vars(moment) for moment in training.curve],
        "ending": training.ending,
        "light": vars(training.light),
        "refinement": [rung.model_dump(mode="json") for rung in rungs],
    }
    return Checkpoint(
        {
            **{f"gaussians.{name}": value for name, value in training.gaussians.parameters.items()},
            **{f"shared.{name}": value for name, value in training.method.observation.shared.items()},
            **{f"refinement.{name}": value for name, value in corrections.items()},
            **{f"{ENVIRONMENT}.{name}": value for name, value in far.items()},
            **{f"adam.{name}": value for name, value in training.optimizer.tensors().items()},
            **stats,
        },
        {**facts, **state},
    )


def light_in(checkpoint: Checkpoint) -> Light:
    """The scalars that the method has to be composed with before its training is restored."""
    return Light(**checkpoint.facts["light"])


def restored(
    method: Method,
    checkpoint: Checkpoint,
    extent: float,
    device: torch.device = _CPU,
    refinement: Refinement | None = None,
) -> Training:
    """The training that `checkpoint` was taken of.

    Args:
        method: Method composed anew, as it was then; its shared parameters are set to those of the
            checkpoint.
        checkpoint: Checkpoint of a training (`checkpoint_of`).
        extent: Extent of the scene, which scales the learning rate of the means.
        device: Device to train on.
        refinement: `Refinement.stored` in the same checkpoint, where anything is corrected.

    Returns:
        The training, which goes on bit for bit.
    """
    for name, value in checkpoint.part("shared").items():
        method.observation.shared[name].data.copy_(value)
    gaussians, facts = Gaussians(checkpoint.part("gaussians")), checkpoint.facts
    environment = Environment.stored(checkpoint.part(ENVIRONMENT))
    training = Training.begin(
        method, light_in(checkpoint), gaussians, extent, device, refinement, environment
    )
    training.optimizer.restore(checkpoint.part("adam"))
    for key, value in checkpoint.part("stats").items():
        setattr(training.stats, key, value.to(device, copy=True))
    training.iteration = facts["iteration"]
    training.seconds = facts["seconds"]
    training.measuring = facts["measuring"]
    training.schedule = facts["schedule"] and Schedule.of(facts["schedule"])
    training.curve = [Moment(**moment) for moment in facts["curve"]]
    training.ending = facts["ending"]
    return training
