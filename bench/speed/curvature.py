"""Steps that know curvature, beside Adam's: held-out quality over processor seconds.

    python -m bench.speed.curvature [--sets castle,lego,demo] [--quick] [--json] [--write] [--seeds 1]
        [--work FOLDER]

The diagonal of Gauss and Newton's matrix as in 3DGS2-TR (Hsiao et al., arXiv 2602.00395): random signs are
sent backwards through the render of each iteration, and the squares of what arrives at a parameter average to
its curvature. A step is the mean gradient over the curvature, times a length, bounded by a multiple of Adam's
rate. Adam has the same iterations, and a quarter and a half more. Processor seconds of the training alone, on
one thread, from the same points.
"""

import argparse
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache, partial
from statistics import fmean
from typing import Any

import torch
from torch import Tensor

from bench.peers.compare import session_of
from bench.speed.half_size import Case, Prepared
from bench.support.oracle import oracle_session
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from imaging.compute import threads
from recon.data.dataset import View
from recon.decide.steps.method_choice import method_for
from recon.methods import METHODS
from recon.observe.linear import Observation
from recon.start.initialisation import gaussians_at
from recon.train.adam import Adam
from recon.train.densification import DensityRules
from recon.train.devices.ranks import Ranks
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

CASES = {
    "castle": Case(400, 20_000, 200),
    "lego": Case(400, 20_000, 300),
    "demo": Case(320, 20_000, 300),
}


@dataclass(frozen=True)
class Way:
    """Optimiser of a training: Adam with more iterations, or curved steps.

    more: factor of the iterations. length: of a curved step; None: Adam. bound: most Adam rates a step.
    """

    more: float = 1.0
    length: float | None = None
    bound: float = 1.0


WAYS = {
    "Adam": Way(),
    "Adam, 1.25 times as many": Way(more=1.25),
    "Adam, 1.5 times as many": Way(more=1.5),
    "curved, 0.03, 1 rate": Way(length=0.03),
    "curved, 0.1, 1 rate": Way(length=0.1),
    "curved, 0.1, 3 rates": Way(length=0.1, bound=3.0),
    "curved, 0.3, 3 rates": Way(length=0.3, bound=3.0),
}
DAMPING = 0.1
"""Least curvature, over the mean of the parameter's."""
MEMORY = 0.99
"""Share of the moving average of the curvature that an iteration keeps."""


class Curved(Adam):
    """Steps by gradient over curvature; the moving average of squares has the curvature's."""

    def __init__(self, groups: Iterable[dict[str, Any]], way: Way, eps: float) -> None:
        super().__init__(groups, eps)
        self._way = way
        self._curvature: dict[Tensor, Tensor] = {}

    def look(self, prediction: Tensor) -> None:
        """Send random signs backwards through a prediction [P, H, W] of the next step."""
        values = [group["params"][0] for group in self.param_groups]
        signs = torch.randint(0, 2, prediction.shape).to(prediction) * 2 - 1
        sums = torch.autograd.grad(prediction, values, signs, retain_graph=True, allow_unused=True)
        count = prediction.numel()
        self._curvature = {
            value: sum_.square() / count for value, sum_ in zip(values, sums, strict=True) if sum_ is not None
        }

    @torch.no_grad()
    def step(self) -> None:
        """Move every parameter that has a gradient and a curvature."""
        assert self._way.length is not None
        for group in self.param_groups:
            (value,) = group["params"]
            if value.grad is None or value not in self._curvature:
                continue
            state = self.state.setdefault(
                value,
                {
                    "step": torch.zeros(()),
                    "exp_avg": torch.zeros_like(value),
                    "exp_avg_sq": torch.zeros_like(value),
                },
            )
            state["step"] += 1
            passed, beta = float(state["step"]), group["betas"][0]
            mean = state["exp_avg"].lerp_(value.grad, 1 - beta) / (1 - beta**passed)
            bend = state["exp_avg_sq"].lerp_(self._curvature[value], 1 - MEMORY) / (1 - MEMORY**passed)
            bend = bend + DAMPING * bend.mean() + 1e-20
            most = self._way.bound * group["lr"]
            value -= (self._way.length * mean / bend).clamp_(-most, most)


class Watched:
    """An observation model that shows each of its predictions to an optimiser."""

    def __init__(self, observation: Observation, optimizer: Curved) -> None:
        self._observation, self._optimizer = observation, optimizer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._observation, name)

    def compare(self, image: Tensor, view: View, done: float, factors: Any = None) -> tuple[Tensor, Tensor]:
        """Predict and compare as the observation does, and let the optimiser look."""
        prediction, target = self._observation.compare(image, view, done, factors)
        if prediction.requires_grad:
            self._optimizer.look(prediction)
        return prediction, target


def trained(prepare: Any, case: Case, seed: int, way: Way) -> dict[str, Any]:
    """Row of one training."""
    prepared: Prepared = prepare()
    dataset = prepared.dataset
    method = METHODS[method_for(dataset, "auto")[0]](dataset, prepared.light)
    gaussians = gaussians_at(prepared.start, method.appearance, method.observation.units)
    training = Training.begin(method, prepared.light, gaussians, dataset.extent)
    if way.length is not None:
        torch.manual_seed(seed)
        optimizer = Curved(training.optimizer.param_groups, way, training.optimizer.eps)
        observation: Any = Watched(method.observation, optimizer)
        training = replace(training, optimizer=optimizer, method=replace(method, observation=observation))
    iterations = round(way.more * case.iterations)
    plan = Plan(
        iterations,
        DensityRules(case.gaussians),
        seed,
        log_every=iterations,
        rate_factor=rate_factor(iterations),
    )
    began = time.process_time()
    train(training, dataset, plan)
    spent = time.process_time() - began
    training = replace(training, method=method)
    return {"seconds": spent, "db": training.held_out_psnr(dataset.held_out, 1.0, Ranks())}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set, way and seed."""
    finished, rows = Cache(options.work / "curvature.jsonl"), []
    for name in options.sets.split(","):
        case = replace(CASES[name], iterations=20) if options.quick else CASES[name]
        session = (
            oracle_session(options.work / name, name) if name == "demo" else session_of(name, options.work)
        )
        for seed in range(1 if options.quick else options.seeds):
            prepare = cache(partial(Prepared.of, session, case, seed))
            for title, way in WAYS.items():
                key = f"{name} {case} {seed} {way}"
                row = finished.get(key, partial(trained, prepare, case, seed, way))
                rows.append({"set": name, "way": title, "seed": seed} | row)
    return {"machine": machine(), "rows": rows, "seeds": options.seeds}


def report(result: dict[str, Any]) -> str:
    """The table of seconds and quality by set and way."""
    rows = result["rows"]
    names = list(dict.fromkeys(row["set"] for row in rows))
    lines = [
        "# Steps that know curvature",
        "",
        "`python -m bench.speed.curvature --write`: processor seconds of a training on one thread, and dB "
        f"of held-out views; seeds: {result['seeds']}. {words(result['machine'])}.",
        "",
        f"| steps | {' | '.join(f'{name}, s | dB' for name in names)} |",
        "|---" * (1 + 2 * len(names)) + "|",
    ]
    for way in WAYS:
        cells = [way]
        for name in names:
            here = [row for row in rows if row["set"] == name and row["way"] == way]
            cells += [
                f"{fmean(row['seconds'] for row in here):.1f}",
                f"{fmean(row['db'] for row in here):.2f}",
            ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=",".join(CASES))
    options = parser.parse_args()
    threads.set_threads(1)
    result = measure(options)
    deliver(options, "curvature", result, report(result))


if __name__ == "__main__":
    main()
