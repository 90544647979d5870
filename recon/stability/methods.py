"""Methods at the extremes: a scene of known Gaussians, photographed in memory and trained for a moment."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import torch

from imaging.arrays import Array32
from imaging.progress import Progress, unreported
from imaging.sensor.cfa import Cfa, mosaic
from imaging.session.calibration import CalibrationRecord, Response
from imaging.session.records import ImageKind
from imaging.stress_case import StressCase
from recon.data.dataset import Dataset, Sensor, View
from recon.data.light import light_of, radiance_image
from recon.data.shot import HeldPlanes, Shot
from recon.data.tone import encode
from recon.methods import METHODS
from recon.splat import Limits, SplatCamera, rasterize
from recon.stability.scenes import camera, cloud
from recon.start.initialisation import Start, gaussians_at
from recon.train.densification import DensityRules
from recon.train.schedule import rate_factor
from recon.train.trainer import train
from recon.train.training import Plan, Training

COUNT, VIEWS, ITERATIONS = 60, 6, 120
USUAL = (1 / 64, 1 / 4)
"""Exposure scales at which the scene, of light up to 4, is neither dark nor white."""
SRGB = Response(kind="srgb", evidence="made so", residual=0.0)
LINEAR = Response(kind="linear", evidence="made so")
CASES: tuple[tuple[str, ImageKind], ...] = (
    ("nh-3dgs", "raw"),
    ("vanilla", "raw"),
    ("nh-3dgs", "hdr"),
    ("hdr-gs", "ldr"),
)
MEDIAN, CHANGE, BLACK, WHITE = 0.5, 0.05, 0.02, 0.1
"""Limits: of the median error of a held-out view after so short a training; of what another unit of light
changes; of the light in black frames, and of what white ones lack, both relative to white."""


def methods(seed: int = 0, progress: Progress = unreported) -> Iterator[StressCase]:
    """Each method as usual, in other units of light, at exposures far apart, in the dark, all white."""
    for done, (name, kind) in enumerate(CASES):
        progress(f"methods: {name} from {kind}", done, len(CASES))
        of = f"{name} from {kind}"
        usual, true = learned(name, kind, seed, USUAL)
        yield _row(f"{of}, as usual", "held-out light, median", _miss(usual, true), MEDIAN)
        for power in (20, -20):
            # The same files, said to be exposed so much less: they show so much more light.
            moved, _ = learned(name, kind, seed, USUAL, [k / 2.0**power for k in USUAL])
            error = float(np.quantile(np.abs(moved / 2.0**power / usual - 1), 0.99))
            yield _row(f"{of}, light times 2^{power}", "change of 99 % of held-out light", error, CHANGE)
        if kind == "hdr" or name == "vanilla":  # EXR has no exposures, and the baseline learns too slowly
            continue
        apart, true = learned(name, kind, seed, (2.0**-10, 4.0))
        yield _row(f"{of}, exposures 2^12 apart", "held-out light, median", _miss(apart, true), MEDIAN)
        black, _ = learned(name, kind, seed, (2.0**-24,), (1.0,))
        yield _row(f"{of}, all black", "light, of white", float(np.abs(black).max()), BLACK)
        white, _ = learned(name, kind, seed, (2.0**24,), (1.0,), glow=1.0)
        yield _row(f"{of}, all white", "what is missing of white", max(float((1 - white).max()), 0.0), WHITE)


def _row(case: str, what: str, error: float, limit: float) -> StressCase:
    return StressCase.of("methods", case, what, "truth", error, limit)


def _miss(ours: Array32, true: Array32) -> float:
    """Median relative error where there is light."""
    lit = true > 1e-3 * true.max()
    return float(np.median(np.abs(ours[lit] / true[lit] - 1)))


def learned(
    name: str,
    kind: ImageKind,
    seed: int,
    scales: Sequence[float],
    labels: Sequence[float] = (),
    glow: float = 0.02,
) -> tuple[Array32, Array32]:
    """The held-out view's light, as it was learned and as it is.

    Args:
        name: Of the method.
        kind: Of the photographs that are made.
        seed: Of the scene, its start and the training.
        scales: True exposure scales of a view's shots.
        labels: What is said of them, if it is anything else.
        glow: Light behind all.

    Returns:
        Radiance [H, W, 3] by the training, and of the scene.
    """
    tensors = [tensor.float() for tensor in cloud(seed, COUNT, size=0.2)]
    views = tuple(_view(index, tensors, kind, scales, labels or scales, glow) for index in range(VIEWS))
    held_out, train_on = views[VIEWS // 2], views[: VIEWS // 2] + views[VIEWS // 2 + 1 :]
    dataset = Dataset(Path(), kind, train_on, (held_out,), _NOTHING, "")
    light = light_of(dataset, [radiance_image(view) for view in train_on])
    method = METHODS[name](dataset, light)
    rng = np.random.default_rng(seed)
    # As far off as points of structure from motion, and coloured like the light that they lie in.
    xyz = tensors[0].double().numpy() + rng.normal(0, 0.02, (COUNT, 3))
    start = Start(xyz, np.full((COUNT, 3), 0.3 * light.normaliser), COUNT)
    gaussians = gaussians_at(start, method.appearance, method.observation.units)
    training = Training.begin(method, light, gaussians, dataset.extent)
    short = rate_factor(ITERATIONS)  # as a whole training of that length has it
    plan = Plan(ITERATIONS, DensityRules(2 * COUNT), seed, log_every=ITERATIONS, rate_factor=short)
    train(training, dataset, plan)
    with torch.no_grad():
        image = training.renderer()(training.gaussians, held_out.lens, degree=2).image
        result = method.observation.radiance(image).numpy()
    return result, _rendered(tensors, held_out.lens, glow)


def _rendered(tensors: list[torch.Tensor], lens: SplatCamera, glow: float) -> Array32:
    means, quats, scales, opacities, colours = tensors
    back, limits = torch.full((3,), glow), Limits.for_scene(1e-4, 1.0)
    with torch.no_grad():
        image = rasterize(means, quats, scales, opacities, colours, lens, back, limits).image
    return np.asarray(image.numpy(), np.float32)


def _view(
    index: int,
    tensors: list[torch.Tensor],
    kind: ImageKind,
    scales: Sequence[float],
    labels: Sequence[float],
    glow: float,
) -> View:
    lens = camera(turn=0.5 * (index / (VIEWS - 1) - 0.5))
    light = _rendered(tensors, lens, glow)
    sensor = Sensor(
        kind=kind,
        cfa=Cfa.RGGB if kind == "raw" else None,
        camera_from_rec709=np.eye(3),
        falloff=np.ones((lens.height, lens.width), np.float32),
        response=SRGB if kind == "ldr" else LINEAR,
    )
    shots = tuple(_shot(light, sensor, k, label) for k, label in zip(scales, labels, strict=True))
    return View("a", index, lens, sensor, shots)


def _shot(light: Array32, sensor: Sensor, k: float, label: float) -> Shot:
    """Shot without noise, in steps of 12 bits (RAW) or 8 (photographs), and none (EXR)."""
    signal = (light if sensor.cfa is None else mosaic(light, sensor.cfa)) * k
    if sensor.kind == "raw":
        signal = np.rint(4095 * signal.clip(0, 1)) / 4095
    elif sensor.kind == "ldr":
        signal = np.rint(255 * encode(signal, sensor.response)) / 255
    pixels = np.ascontiguousarray(signal, np.float32)
    measured = sensor.kind != "hdr"
    dark = pixels <= 1 / 255 if sensor.kind == "ldr" else np.zeros(pixels.shape, bool)
    saturated = (pixels >= 1) & measured
    return Shot("", label, HeldPlanes(pixels, saturated, dark, np.ones(pixels.shape, bool)))


_NOTHING = CalibrationRecord(
    created=datetime(2026, 1, 1, tzinfo=UTC),
    versions={},
    shots_sha256="",
    cameras=(),
    views=(),
    exposure_scale={},
)
