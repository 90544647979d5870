"""The training loop, from the first iteration to the last, for any method."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch

from recon.data.dataset import Dataset, View
from recon.data.light import Light
from recon.data.pixels import Progress
from recon.methods.method import Method
from recon.observe.refinement import RATES, Refinement
from recon.scene.checkpoint import Checkpoint, adam_tensors, restore_adam
from recon.scene.gaussians import Gaussians, Renderer, limits_for
from recon.splat import SplatStats
from recon.splat.torch_threads import torch_on_one_thread
from recon.train.densification import Density, DensityRules
from recon.train.interrupt import deferred
from recon.train.live_curve import Moment, chosen_views, held_out_db, period
from recon.train.ranks import Ranks
from recon.train.schedule import Course

_ALONE = Ranks()
_CPU = torch.device("cpu")


@dataclass(frozen=True)
class Plan:
    """How long to train, how far to grow, and with which seed; everything else is a fraction of it.

    batch: views that an iteration looks at before it takes a step. As in Grendel-GS (Zhao et al., arXiv
    2406.18533), learning rates grow with its square root, and Adam forgets as much a view as ever.
    measure: whether held-out views are looked at on the way. haste: factor of the learning rates, but for
    those of corrections.
    """

    iterations: int
    density: DensityRules
    seed: int = 0
    batch: int = 1
    log_every: int = 50
    checkpoint_seconds: float = 20.0
    measure: bool = False
    haste: float = 1.0


@dataclass
class Training:
    """A training between two iterations: all that the next one depends on.

    course: None until it begins. curve: what was measured so far. ending: why the schedule was cut short,
    if it was. seconds: of training alone; measuring: those of measuring.
    """

    method: Method
    light: Light
    gaussians: Gaussians
    optimizer: torch.optim.Optimizer
    stats: SplatStats
    refinement: Refinement | None = None
    iteration: int = 0
    seconds: float = 0.0
    measuring: float = 0.0
    course: Course | None = None
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
    ) -> "Training":
        """Nothing trained yet, on a device; `extent` scales the learning rate of the means."""
        gaussians = gaussians.to(device)
        method.observation.to(device)
        rates = {**method.geometry.all(extent), **method.appearance.rates, **method.observation.rates}
        parameters = {**gaussians.parameters, **method.observation.shared}
        if refinement is not None:
            refinement.to(device)
            rates |= {str(name): RATES[name] for name in refinement.parameters}
            parameters |= {str(name): value for name, value in refinement.parameters.items()}
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
        return cls(method, light, gaussians, optimizer, SplatStats(len(gaussians)), refinement)

    def renderer(self) -> Renderer:
        """How its Gaussians are drawn."""
        return Renderer(self.method.appearance, limits_for(self.light.reference))

    def held_out_db(self, views: Sequence[View], progress: float, ranks: Ranks) -> float:
        """Quality of views, dB: see `live_curve.held_out_db`."""
        return held_out_db(
            self.method, self.gaussians, self.renderer(), self.refinement, views, progress, ranks
        )

    def parameters(self) -> list[torch.Tensor]:
        """All tensors that are trained."""
        return [tensor for group in self.optimizer.param_groups for tensor in group["params"]]

    def gather(self, ranks: Ranks, keep: bool = True) -> None:
        """Make the statistics those of all ranks; one that does not `keep` them counts anew from zero."""
        ranks.add_array(self.stats.seen)
        ranks.add_array(self.stats.gradient)
        ranks.raise_array(self.stats.radius)
        ranks.raise_array(self.stats.weight)
        if not keep:
            self.stats = SplatStats(len(self.gaussians))

    def checkpoint(self, facts: dict[str, Any]) -> Checkpoint:
        """All of it as tensors and facts."""
        stats = {
            f"stats.{key}": torch.from_numpy(getattr(self.stats, key).copy())
            for key in ("seen", "gradient", "radius", "weight")
        }
        own = {
            "iteration": self.iteration,
            "seconds": self.seconds,
            "measuring": self.measuring,
            "course": self.course and self.course.turns,
            "curve": [vars(moment) for moment in self.curve],
            "ending": self.ending,
            "light": vars(self.light),
        }
        corrections = {} if self.refinement is None else self.refinement.parameters
        why = () if self.refinement is None else self.refinement.rungs
        return Checkpoint(
            {
                **{f"gaussians.{name}": value for name, value in self.gaussians.parameters.items()},
                **{f"shared.{name}": value for name, value in self.method.observation.shared.items()},
                **{f"refinement.{name}": value for name, value in corrections.items()},
                **adam_tensors(self.optimizer),
                **stats,
            },
            {**facts, **own, "refinement": [rung.model_dump(mode="json") for rung in why]},
        )

    @staticmethod
    def light_in(checkpoint: Checkpoint) -> Light:
        """The scalars that the method has to be composed with before it is restored."""
        return Light(**checkpoint.facts["light"])

    @classmethod
    def restore(
        cls,
        method: Method,
        checkpoint: Checkpoint,
        extent: float,
        device: torch.device = _CPU,
        refinement: Refinement | None = None,
    ) -> "Training":
        """The training that `checkpoint` was taken of; `method` is composed anew, as it was then.

        refinement: `Refinement.stored` in the same checkpoint, where anything is corrected.
        """
        for name, value in checkpoint.part("shared").items():
            method.observation.shared[name].data.copy_(value)
        gaussians = Gaussians(checkpoint.part("gaussians"))
        training = cls.begin(method, cls.light_in(checkpoint), gaussians, extent, device, refinement)
        restore_adam(training.optimizer, checkpoint.part("adam"))
        for key, value in checkpoint.part("stats").items():
            setattr(training.stats, key, value.numpy().copy())
        training.iteration = checkpoint.facts["iteration"]
        training.seconds = checkpoint.facts["seconds"]
        training.measuring = checkpoint.facts.get("measuring", 0.0)
        turns = checkpoint.facts.get("course")
        training.course = Course.of(turns) if turns else None
        training.curve = [Moment(**moment) for moment in checkpoint.facts.get("curve", [])]
        training.ending = checkpoint.facts.get("ending", "")
        return training


Steer = Callable[[Training], int | None]
"""Asked after each iteration but the last: how many iterations, at least 1, what is left of the schedule
shall take from here on; None for as many as it would."""


def train(
    training: Training,
    dataset: Dataset,
    plan: Plan,
    *,
    log: Callable[[dict[str, Any]], None],
    save: Callable[[], None],
    progress: Progress | None = None,
    until: int | None = None,
    ranks: Ranks = _ALONE,
    steers: Sequence[Steer] = (),
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Train up to iteration `plan.iterations` (or stop before at `until`).

    One iteration draws `plan.batch` views, each once, and compares the render with every shot of its
    bracket. Every random choice is derived from the seed and the iteration, so a training that was
    saved and restored goes on bit for bit as if it had not been. `save` is called every
    `plan.checkpoint_seconds`, and when the user interrupts. `steers` may shorten the rest of the schedule;
    the first one that wants to is heard, and `training.course` says what came of it. A training that has
    a course of that length already follows it. Several `ranks` share the views of an iteration;
    `plan.batch` must be a multiple of their number. Only the first logs, saves and steers.
    """
    method, views, refinement = training.method, dataset.train, training.refinement
    if plan.batch % ranks.count:
        raise ValueError(f"a batch of {plan.batch} views cannot be shared by {ranks.count} ranks")
    density = Density(plan.density, training.light.reference)
    renderer = training.renderer()
    course = training.course
    if course is None or course.planned != plan.iterations:
        course = training.course = Course.straight(plan.iterations)
    looked_at = chosen_views(dataset.validation or dataset.held_out) if plan.measure else ()
    every = period(plan.iterations, len(looked_at))
    started = clock() - training.seconds - training.measuring
    saved = clock()
    losses: list[float] = []
    for group in training.optimizer.param_groups:
        group["betas"] = (0.9**plan.batch, 0.999**plan.batch)

    with torch_on_one_thread(), deferred() as interrupt:
        while training.iteration < min(course.total, until or course.total):
            position = course.position(training.iteration)
            done = position / course.planned
            for group in training.optimizer.param_groups:
                haste = 1.0 if group["name"] in RATES else plan.haste
                group["lr"] = group["rate"].at(done) * math.sqrt(plan.batch) * haste

            training.optimizer.zero_grad(set_to_none=True)
            own_loss, degree = 0.0, method.schedule.degree(done)
            for turn in range(ranks.number, plan.batch, ranks.count):
                view = views[_turn(training.iteration * plan.batch + turn, len(views), plan.seed)]
                delta = refinement.motion(view, done) if refinement else None
                factors = refinement.factors(view, done) if refinement else None
                image = renderer(
                    training.gaussians, view.lens, degree=degree, stats=training.stats, camera_delta=delta
                ).image
                image = refinement.shaded(image, view, done) if refinement else image
                prediction, target = method.observation.compare(image, view, done, factors)
                loss = (
                    method.loss(prediction, target)
                    + method.appearance.penalty(training.gaussians.parameters)
                    + method.observation.penalty(done)
                    + method.schedule.opacity_weight * training.gaussians.opacities().mean()
                ) / plan.batch
                loss.backward()  # type: ignore[no-untyped-call]
                own_loss += float(loss.detach())
            ranks.add([tensor.grad for tensor in training.parameters() if tensor.grad is not None])
            training.optimizer.step()
            if refinement:
                refinement.settle()
            training.iteration += 1
            losses.append(own_loss)
            reached = course.position(training.iteration)
            done = reached / course.planned

            if density.due(reached, course.planned, reached - position):
                training.gather(ranks)
                generator = torch.Generator().manual_seed(_seed(plan.seed, 1, training.iteration))
                luminance = method.appearance.luminance(training.gaussians.parameters)
                density.adapt(training.gaussians, luminance, training.stats, done, generator).apply(
                    training.gaussians, training.optimizer
                )
                training.stats = SplatStats(len(training.gaussians))

            training.seconds = clock() - started - training.measuring
            last = training.iteration == course.total
            measured = bool(looked_at) and (last or training.iteration % every == 0)
            if measured:
                quality = training.held_out_db(looked_at, done, ranks)
                training.curve.append(Moment(training.iteration, training.seconds, quality))
                training.measuring = clock() - started - training.seconds
            if measured or last or training.iteration % plan.log_every == 0:
                (mean,) = ranks.totals(float(np.mean(losses)))
                if ranks.first:
                    line = {
                        "iteration": training.iteration,
                        "loss": mean,
                        "gaussians": len(training.gaussians),
                        "seconds": round(training.seconds, 3),
                    }
                    log(line | ({"held_out_db": round(training.curve[-1].db, 4)} if measured else {}))
                if progress and ranks.first:
                    progress(_told(training, mean), training.iteration, course.total)
                losses = []
            wishes = (steer(training) for steer in steers if ranks.first and not last)
            wish = next((wish for wish in wishes if wish is not None), 0)
            due = ranks.first and clock() - saved > plan.checkpoint_seconds
            stop, late, left = ranks.totals(interrupt.asked, due, wish)
            if left:
                course = training.course = course.turned(training.iteration, int(left))
            if stop or late:
                training.gather(ranks, ranks.first)
                if ranks.first:
                    save()
                saved = clock()
            if stop:
                raise KeyboardInterrupt


def _told(training: Training, loss: float) -> str:
    """How it goes, in few words; a narrow terminal cuts off the last ones."""
    speed = training.iteration / max(training.seconds, 1e-9)
    held_out = f"held-out {training.curve[-1].db:.1f} dB, " if training.curve else ""
    return f"{held_out}loss {loss:.4f}, {speed:.1f} it/s"


def _turn(iteration: int, count: int, seed: int) -> int:
    """Which view is looked at: every epoch shows each view once, in an order of its own."""
    epoch, place = divmod(iteration, count)
    order = np.random.Generator(np.random.PCG64(_seed(seed, 0, epoch))).permutation(count)
    return int(order[place])


def _seed(*parts: int) -> int:
    return int(np.random.SeedSequence(parts).generate_state(1, np.uint64)[0] >> 1)
