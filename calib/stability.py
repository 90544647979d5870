"""Stress tests of calibration on data whose truth is known.

No files and no pictures: the numbers that the steps of a calibration work on, made by hand.
"""

import math

import numpy as np

from calib.light.falloff import Tracks
from calib.light.vignetting import estimate
from calib.sensor.photon_transfer import Points, fit
from imaging.arrays import Array
from imaging.merge.bracket import merge_bracket
from imaging.merge.linear_frame import LinearFrame, SensorSignalNoise
from imaging.merge.ratios import overlap, ratio
from imaging.optics.lens import Lens, project, rays
from imaging.stress_case import StressCase

WELL = 15_000.0
"""Electrons at white."""
LENSES = {
    "wide lens, -30 % at the corner": Lens(
        model="OPENCV", width=640, height=480, fx=420, fy=420, cx=330, cy=236, k1=-0.25, k2=0.06, p1=3e-3
    ),
    "fisheye of 150 degrees": Lens(
        model="OPENCV_FISHEYE", width=640, height=480, fx=300, fy=300, cx=320, cy=240, k1=-0.02, k2=0.003
    ),
}


def calibration(seed: int = 0) -> list[StressCase]:
    """Merging, exposure ratios, falloff, photon transfer and lenses."""
    rng = np.random.default_rng(seed)
    rows = [
        _row("24 stops merged from 13 exposures, no noise", "radiance", _merged(), 1e-6),
        _row("24 stops merged from 13 exposures, bias by noise", "mean radiance", _bias(rng), 5e-3),
    ]
    for stops in (1, 4, 8):
        error = _ratio(2.0**stops, rng)
        rows.append(_row(f"exposures 2^{stops} apart", "their ratio", error, 3e-3))
    rows.append(_row("corners at 0.3, gains 2 times apart", "falloff", _falloff(rng), 0.02))
    for gain, read in ((0.01, 1.0), (0.4, 3.0), (8.0, 30.0)):
        error = _gain(gain, read, rng)
        rows.append(_row(f"photon transfer of {gain:g} DN/e, {read:g} e read noise", "gain", error, 0.02))
    for name, lens in LENSES.items():
        rows.append(_row(name, "pixels there and back, of the width", _there_and_back(lens), 1e-9))
    return rows


def _row(case: str, what: str, error: float, limit: float) -> StressCase:
    return StressCase.of("calibration", case, what, "truth", error, limit)


def _frame(electrons: Array, k: float, read: float = 4.0) -> LinearFrame:
    signal = np.minimum(electrons / WELL, 1.0).astype(np.float32)
    none = np.zeros(signal.shape, bool)
    noise = SensorSignalNoise(slope=1 / WELL, floor=(read / WELL) ** 2)
    return LinearFrame(signal, k, signal >= 1.0, none, ~none, noise=noise, ceiling=1.0)


SCALES = tuple(4.0**-step for step in range(13))


def _merged() -> float:
    light = np.geomspace(2.0**-1, 2.0**23, 4000).reshape(40, 100)
    merged = merge_bracket([_frame(light * k * WELL, k) for k in SCALES])
    return float(np.abs(merged.radiance / light - 1).max()) if merged.valid.all() else math.inf


def _bias(rng: np.random.Generator) -> float:
    worst = 0.0
    for light in (0.5, 2.0**10, 2.0**22):
        true = np.full((200, 200), light)
        frames = [
            _frame(rng.poisson(np.minimum(true * k, 3) * WELL) + 4.0 * rng.standard_normal(true.shape), k)
            for k in SCALES
        ]
        worst = max(worst, abs(float(merge_bracket(frames).radiance.mean()) / light - 1))
    return worst


def _ratio(true: float, rng: np.random.Generator) -> float:
    """Ratio of two noisy exposures of a smooth scene."""
    light = np.tile(np.geomspace(0.05, 1.5, 400), (300, 1))
    shots = [
        _frame(rng.poisson(np.minimum(light * k, 3) * WELL) + 4.0 * rng.standard_normal(light.shape), k)
        for k in (1.0, 1 / true)
    ]
    measured = ratio([overlap(*shots)])
    return math.inf if measured is None else abs(float(np.exp(measured.log)) / true - 1)


def _falloff(rng: np.random.Generator) -> float:
    """Noisy brightness of scene points, one in ten wrong, through a lens that nearly no one has."""
    names, points = ["a", "b", "c", "d"], 1500
    polynomial, gains = np.array([-0.9, 0.25, -0.05]), np.array([0.7, 1.0, 1.4, 0.9])
    light = rng.normal(0, 2, points)
    point = np.repeat(np.arange(points), 6)
    camera = rng.integers(0, 4, len(point))
    radius = rng.uniform(0, 1, len(point))
    brightness = light[point] + np.log((1 + radius[:, None] ** [2, 4, 6] @ polynomial) * gains[camera])
    brightness += rng.normal(0, 0.05, len(point))
    wrong = rng.random(len(point)) < 0.1
    brightness[wrong] += rng.normal(0, 1, int(wrong.sum()))
    direction = np.tile([0.0, 0.0, 1.0], (len(point), 1))
    tracks = Tracks(point, camera, radius, brightness, direction, point % 20)
    estimated = estimate(tracks, names, dict.fromkeys(names, "one"))
    powers = np.linspace(0, 1, 11)[:, None] ** [2, 4, 6]
    ratio = (1 + powers @ np.array(estimated.vignetting["a"])) / (1 + powers @ polynomial)
    relative = np.array([estimated.gain[name] for name in names]) / gains
    return float(max(np.abs(ratio - 1).max(), np.abs(relative / relative.mean() - 1).max()))


def _gain(gain: float, read: float, rng: np.random.Generator) -> float:
    """Gain from variances as flats of 100,000 photosites would have them, at twelve levels."""
    freedom = 1e5
    electrons = np.geomspace(20, 12_000, 12)
    true = gain**2 * (electrons + read**2) + 1 / 12
    measured = true * rng.chisquare(freedom, len(true)) / freedom
    points = Points(gain * electrons, measured, np.full(len(true), freedom))
    fitted = fit(points)
    return math.inf if fitted is None else abs(fitted.gain / gain - 1)


def _there_and_back(lens: Lens) -> float:
    x, y = np.meshgrid(np.linspace(0.5, lens.width - 0.5, 65), np.linspace(0.5, lens.height - 0.5, 49))
    pixels = np.stack([x, y], axis=-1)
    return float(np.abs(project(lens, rays(lens, pixels)) - pixels).max()) / lens.width
