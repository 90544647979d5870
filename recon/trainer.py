"""The training loop, from the first iteration to the last, for any method."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from recon.checkpoint import Checkpoint, adam_tensors, restore_adam
from recon.dataset import Dataset
from recon.density import Density, DensityRules
from recon.gaussians import Gaussians, Renderer, limits_for
from recon.interrupt import deferred
from recon.method import Light, Method
from recon.pixels import Progress
from recon.splat import SplatStats
from recon.torch_threads import torch_on_one_thread


@dataclass(frozen=True)
class Plan:
    """How long to train, how far to grow, and with which seed; everything else is a fraction of it."""

    iterations: int
    density: DensityRules
    seed: int = 0
    log_every: int = 50
    checkpoint_seconds: float = 20.0


@dataclass
class Training:
    """A training between two iterations: all that the next one depends on."""

    method: Method
    light: Light
    gaussians: Gaussians
    optimizer: torch.optim.Optimizer
    stats: SplatStats
    iteration: int = 0
    seconds: float = 0.0

    @classmethod
    def begin(cls, method: Method, light: Light, gaussians: Gaussians, extent: float) -> "Training":
        """Nothing trained yet; `extent` scales the learning rate of the means."""
        rates = {**method.geometry.all(extent), **method.appearance.rates, **method.observation.rates}
        parameters = {**gaussians.parameters, **method.observation.shared}
        groups = [
            {
                "name": name,
                "params": [value.requires_grad_(True)],
                "rate": rates[name],
                "lr": rates[name].start,
            }
            for name, value in parameters.items()
        ]
        optimizer = torch.optim.Adam(groups, eps=1e-15, fused=True)
        return cls(method, light, gaussians, optimizer, SplatStats(len(gaussians)))

    def renderer(self) -> Renderer:
        """How its Gaussians are drawn."""
        return Renderer(self.method.appearance, limits_for(self.light.reference))

    def checkpoint(self, facts: dict[str, Any]) -> Checkpoint:
        """All of it as tensors and facts."""
        stats = {
            f"stats.{key}": torch.from_numpy(getattr(self.stats, key).copy())
            for key in ("seen", "gradient", "radius", "weight")
        }
        own = {"iteration": self.iteration, "seconds": self.seconds, "light": vars(self.light)}
        return Checkpoint(
            {
                **{f"gaussians.{name}": value for name, value in self.gaussians.parameters.items()},
                **{f"shared.{name}": value for name, value in self.method.observation.shared.items()},
                **adam_tensors(self.optimizer),
                **stats,
            },
            {**facts, **own},
        )

    @staticmethod
    def light_in(checkpoint: Checkpoint) -> Light:
        """The scalars that the method has to be composed with before it is restored."""
        return Light(**checkpoint.facts["light"])

    @classmethod
    def restore(cls, method: Method, checkpoint: Checkpoint, extent: float) -> "Training":
        """The training that `checkpoint` was taken of; `method` is composed anew, as it was then."""
        for name, value in checkpoint.part("shared").items():
            method.observation.shared[name].data.copy_(value)
        gaussians = Gaussians(checkpoint.part("gaussians"))
        training = cls.begin(method, cls.light_in(checkpoint), gaussians, extent)
        restore_adam(training.optimizer, checkpoint.part("adam"))
        for key, value in checkpoint.part("stats").items():
            setattr(training.stats, key, value.numpy().copy())
        training.iteration = checkpoint.facts["iteration"]
        training.seconds = checkpoint.facts["seconds"]
        return training


def train(
    training: Training,
    dataset: Dataset,
    plan: Plan,
    *,
    log: Callable[[dict[str, Any]], None],
    save: Callable[[], None],
    progress: Progress | None = None,
    until: int | None = None,
) -> None:
    """Train up to iteration `plan.iterations` (or stop before at `until`).

    One iteration draws one view once and compares the render with every shot of its bracket. Every
    random choice is derived from the seed and the iteration, so a training that was saved and
    restored goes on bit for bit as if it had not been. `save` is called every
    `plan.checkpoint_seconds`, and when the user interrupts.
    """
    method, views = training.method, dataset.train
    density = Density(plan.density, training.light.reference)
    renderer = training.renderer()
    started = time.monotonic() - training.seconds
    saved, total = time.monotonic(), plan.iterations
    losses: list[float] = []

    with torch_on_one_thread(), deferred() as interrupt:
        while training.iteration < min(total, until or total):
            done = training.iteration / total
            for group in training.optimizer.param_groups:
                group["lr"] = group["rate"].at(done)

            view = views[_turn(training.iteration, len(views), plan.seed)]
            degree = method.schedule.degree(done)
            render = renderer(training.gaussians, view.lens, degree=degree, stats=training.stats)
            prediction, target = method.observation.compare(render.image, view, done)
            loss = (
                method.loss(prediction, target)
                + method.appearance.penalty(training.gaussians.parameters)
                + method.observation.penalty()
                + method.schedule.opacity_weight * training.gaussians.opacities().mean()
            )
            training.optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            training.optimizer.step()
            training.iteration += 1
            losses.append(float(loss.detach()))

            if density.due(training.iteration, total):
                generator = torch.Generator().manual_seed(_seed(plan.seed, 1, training.iteration))
                luminance = method.appearance.luminance(training.gaussians.parameters)
                density.adapt(
                    training.gaussians, luminance, training.stats, training.iteration / total, generator
                ).apply(training.gaussians, training.optimizer)
                training.stats = SplatStats(len(training.gaussians))

            training.seconds = time.monotonic() - started
            if training.iteration % plan.log_every == 0 or training.iteration == total:
                mean = float(np.mean(losses))
                log(
                    {
                        "iteration": training.iteration,
                        "loss": mean,
                        "gaussians": len(training.gaussians),
                        "seconds": round(training.seconds, 3),
                    }
                )
                if progress:
                    speed = training.iteration / max(training.seconds, 1e-9)
                    progress(f"training, loss {mean:.4f}, {speed:.1f} it/s", training.iteration, total)
                losses = []
            if interrupt.asked or time.monotonic() - saved > plan.checkpoint_seconds:
                save()
                saved = time.monotonic()
            if interrupt.asked:
                raise KeyboardInterrupt


def _turn(iteration: int, count: int, seed: int) -> int:
    """Which view is looked at: every epoch shows each view once, in an order of its own."""
    epoch, place = divmod(iteration, count)
    order = np.random.Generator(np.random.PCG64(_seed(seed, 0, epoch))).permutation(count)
    return int(order[place])


def _seed(*parts: int) -> int:
    return int(np.random.SeedSequence(parts).generate_state(1, np.uint64)[0] >> 1)
