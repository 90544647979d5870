"""Trainings on simulated sessions for the scripts of this folder: one start, any method, its metrics."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.support.oracle import oracle_session
from capture.simulated import capture_simulated
from imaging import metrics
from recon.data.dataset import Dataset
from recon.data.light import Light, light_of, radiance_image
from recon.data.load import load
from recon.data.shot import Shot
from recon.decide.presets import START_SHARE
from recon.measure.truth import true_radiance
from recon.methods.method import Method
from recon.observe.shot_comparison import shot_psnr
from recon.start.initialisation import Start, gaussians_at, start_points
from recon.train.densification import DensityRules
from recon.train.devices.warm_up import warm_up
from recon.train.trainer import train
from recon.train.training import Plan, Training


@dataclass(frozen=True, eq=False)
class Trial:
    """A session ready to be trained on again and again, from the same points."""

    dataset: Dataset
    light: Light
    start: Start
    truth: list[np.ndarray]
    cap: int


def session(work: Path, name: str, seed: int, calibration: str) -> Path:
    """A simulated session of a seed, calibrated from its pictures ('own') or from the truth ('truth')."""
    folder = work / f"{name}-{seed}-{calibration}"
    if calibration == "truth":
        return oracle_session(folder, name, seed=seed, points=300 if name.startswith("toy") else 2500)
    if not (folder / "truth" / "truth.json").exists():
        capture_simulated(name, folder, seed=seed)
    if not (folder / "calibration" / "calibration.json").exists():
        from calib.calibrate import calibrate

        calibrate(folder, on_progress=lambda message, done, total: None)
    return folder


def prepare(folder: Path, cap: int, seed: int) -> Trial:
    """Load a session and find its starting points."""
    dataset = load(folder)
    images = [radiance_image(view) for view in dataset.train]
    rng = np.random.Generator(np.random.PCG64([seed, 0x57A27]))
    return Trial(
        dataset,
        light_of(dataset, images),
        start_points(dataset, images, int(START_SHARE * cap), rng),
        [true_radiance(folder, view) for view in dataset.held_out],
        cap,
    )


def run(
    trial: Trial,
    compose: Callable[[Dataset, Light], Method],
    iterations: int,
    seed: int,
    at: Sequence[int] = (),
) -> list[dict[str, Any]]:
    """Train once; a row of metrics at the end, and before it at the iterations `at` of the same training."""
    warm_up(lambda message, done, total: None)
    method = compose(trial.dataset, trial.light)
    gaussians = gaussians_at(trial.start, method.appearance, method.observation.units)
    training = Training.begin(method, trial.light, gaussians, trial.dataset.extent)
    plan = Plan(iterations, DensityRules(trial.cap), seed, log_every=iterations)
    rows, wall, used = [], 0.0, 0.0
    for until in [*sorted(at), iterations]:
        began, clock = time.perf_counter(), time.process_time()
        train(training, trial.dataset, plan, until=until)
        wall, used = wall + time.perf_counter() - began, used + time.process_time() - clock
        row: dict[str, Any] = {"iterations": until, "gaussians": len(training.gaussians)}
        row |= {"seconds": round(wall, 2), "processor_seconds": round(used, 2)}
        rows.append(row | quality(trial, training))
    return rows


def quality(trial: Trial, training: Training) -> dict[str, Any]:
    """Metrics of the held-out views as `rig evaluate` has them, with the values per view under `views`."""
    observation, light, signals = training.method.observation, [], []
    for view in trial.dataset.held_out:
        with torch.no_grad():
            degree = training.method.degree(1.0)
            image = training.renderer()(training.gaussians, view.lens, degree=degree).image
            light.append(observation.radiance(image).numpy())
            signals.append([observation.predict(image, view, shot.k) for shot in view.shots])
    everything, truth = np.stack(light), np.stack(trial.truth)
    peak, scale = float(truth.max()), metrics.align_scale(everything, truth)
    views = [
        {
            "hdr_psnr_mu_aligned": metrics.hdr_psnr_mu(image * scale, goal, peak),
            "hdr_psnr_mu_dark": metrics.hdr_psnr_mu_dark(image * scale, goal, peak),
            "stops_median": metrics.stops_median(image * scale, goal),
            **_signal(predicted, view.shots, goal.max(-1) / peak),
        }
        for image, goal, predicted, view in zip(light, truth, signals, trial.dataset.held_out, strict=True)
    ]
    means = {key: float(np.nanmean([view[key] for view in views])) for key in views[0]}
    return means | {"views": views}


def _signal(predicted: list[torch.Tensor], shots: Sequence[Shot], light: np.ndarray) -> dict[str, float]:
    """PSNR of the signal, mean over a bracket; and apart, where the light is below 1 % or above 50 %.

    predicted: signal of every shot; light [H, W]: true, over the scene's maximum. The two parts count only
    photosites that are not clipped, of all shots together; NaN without any.
    """
    psnrs = [psnr for pair in zip(predicted, shots, strict=True) if (psnr := shot_psnr(*pair)) is not None]
    figures = {"raw_psnr": float(np.mean(psnrs))}
    for name, there in {"shadows": light < 0.01, "highlights": light > 0.5}.items():
        squares = [
            ((ours.numpy() - shot.pixels) ** 2)[there & shot.valid & ~shot.saturated]
            for ours, shot in zip(predicted, shots, strict=True)
        ]
        together = np.concatenate(squares).astype(np.float64)
        figures[f"raw_psnr_{name}"] = (
            -10 * float(np.log10(together.mean())) if together.size else float("nan")
        )
    return figures


class Cache:
    """Finished rows of a script in a .jsonl, so that a stopped one goes on where it was."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[str, Any] = {}
        if path.exists():
            self._rows = dict(json.loads(line) for line in path.read_text().splitlines())

    @property
    def rows(self) -> dict[str, Any]:
        """All that are there, by name."""
        return dict(self._rows)

    def has(self, key: str) -> bool:
        """Return whether the row of that name is there."""
        return key in self._rows

    def get(self, key: str, make: Callable[[], Any]) -> Any:
        """The row of that name, made now if it is not there."""
        if key not in self._rows:
            self._rows[key] = make()
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open("a") as file:
                file.write(json.dumps([key, self._rows[key]]) + "\n")
        return self._rows[key]
