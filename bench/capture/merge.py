"""Merging of brackets: noise against the Cramér-Rao bound, exposure ratios, ghosts and shake.

    python -m bench.capture.merge [--quick] [--json] [--write]

A sensor of 15,000 electrons and 4 of read noise, five exposures 2 EV apart. Noise is that of all pixels of a
decade of radiance (1: white in the longest exposure), in units of the bound of the unsaturated exposures.
Ratios: exposures 5 % (normal) off their labels, estimated from the frames. Ghosts: a scene of six decades
with texture.
"""

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import Any

import cv2
import numpy as np

from bench.support.record import arguments, deliver, machine, words
from imaging.arrays import Array, Floats
from imaging.merge.alignment import shifts
from imaging.merge.bracket import MARGIN, merge_bracket
from imaging.merge.ghosts import without_ghosts
from imaging.merge.linear_frame import LinearFrame, Noise, SensorSignalNoise
from imaging.merge.ratios import overlap, ratio, solve
from imaging.sensor.cfa import Cfa

FULL_WELL, READ = 15_000.0, 4.0
NOISE = SensorSignalNoise(slope=1 / FULL_WELL, floor=(READ / FULL_WELL) ** 2)
SCALES = tuple(4.0**-n for n in range(5))
DECADES = tuple((10.0**n, 10.0 ** (n + 1)) for n in range(-4, 2))
JITTER = 0.05
SIZE = (300, 400)

BRACKETS: dict[str, tuple[float, ...]] = {
    "five, 2 EV apart": SCALES,
    "two, 4 EV apart": (1.0, 1 / 16),
    "one": (1.0,),
    "one of them twice": (1.0, 0.25, 0.25, 1 / 16),
    "2^20 apart": (1.0, 2.0**-20),
}


def expose(
    light: Array, k: float, rng: np.random.Generator, cfa: Cfa | None = None, noise: Noise | None = NOISE
) -> LinearFrame:
    electrons = rng.poisson(np.minimum(light * k, 3.0) * FULL_WELL) + READ * rng.standard_normal(light.shape)
    signal = np.minimum(electrons / FULL_WELL, 1.0).astype(np.float32)
    none = np.zeros(signal.shape, bool)
    return LinearFrame(signal, k, signal >= 1.0, none, ~none, cfa, noise, ceiling=1.0)


def bound(light: Array, scales: Sequence[float]) -> Array:
    """Standard deviation that no unbiased merge can beat, counting the exposures that are clear of white."""
    total = np.zeros(light.shape)
    for k in scales:
        variance = NOISE.variance(light * k)
        total += np.where(light * k + MARGIN * np.sqrt(variance) < 1, k**2 / variance, 0.0)
    with np.errstate(divide="ignore"):
        return 1.0 / np.sqrt(total)


def hat(frames: Sequence[LinearFrame]) -> Array:
    """Weighted by a hat over the codes, as Debevec and Malik weight, in linear light."""
    signal = np.stack([frame.signal for frame in frames]).astype(float)
    k = np.array([frame.k for frame in frames])[:, None, None]
    weight = np.maximum(np.minimum(signal, 1 - signal), 1e-6) * ~np.stack([f.saturated for f in frames])
    return np.asarray((weight * signal / k).sum(0) / np.maximum(weight.sum(0), 1e-12))


def decade(low: float, high: float, scales: Sequence[float], seed: int) -> dict[str, Any]:
    rng = np.random.default_rng([seed, int(1e6 * low)])
    light = np.exp(rng.uniform(np.log(low), np.log(high), (400, 500)))
    frames = [expose(light, k, rng) for k in scales]
    best = bound(light, scales)
    merged = merge_bracket(frames)
    blind = merge_bracket([expose(light, k, rng, noise=None) for k in scales])
    known = merged.valid & np.isfinite(best)
    if not known.any() or merged.sigma is None:
        return {"from": low, "measured": 0.0, "clipped": float(merged.clipped.mean())}
    away = (merged.radiance - light)[known]
    whitened = away / merged.sigma[known]

    def noise(image: Floats) -> float:
        return float(np.sqrt(np.mean(((image - light) / best)[known] ** 2)))

    return {
        "from": low,
        "measured": float(known.mean()),
        "clipped": float(merged.clipped.mean()),
        "noise": noise(merged.radiance),
        "bias": float(np.mean(whitened)),
        "chi_square": float(np.mean(whitened**2)),
        "sums": noise(blind.radiance),
        "hat": noise(hat(frames)),
    }


def scene(seed: int, size: tuple[int, int] = SIZE) -> Array:
    """Smooth light of six decades, with texture."""
    rng = np.random.default_rng(seed)
    broad = cv2.resize(
        rng.uniform(np.log(1e-4), np.log(100.0), (9, 12)), size[::-1], interpolation=cv2.INTER_CUBIC
    )
    fine = cv2.resize(
        rng.standard_normal((size[0] // 4, size[1] // 4)), size[::-1], interpolation=cv2.INTER_CUBIC
    )
    return np.asarray(np.exp(broad + 0.5 * fine), np.float64)


def ratios(seed: int) -> float:
    """Largest error of an estimated ratio of neighbouring exposures."""
    rng = np.random.default_rng([seed, 1])
    true = np.log(SCALES) + JITTER * rng.standard_normal(len(SCALES))
    light = scene(seed, (900, 1200))
    frames = [expose(light, float(np.exp(k)), rng) for k in true]
    edges = {
        (i, j): edge
        for i, j in combinations(range(len(true)), 2)
        if (edge := ratio([overlap(frames[i], frames[j])])) is not None
    }
    solved, _ = solve(np.log(SCALES), edges)
    return float(np.abs(np.diff(solved) - np.diff(true)).max())


def ghosts(seed: int, cfa: Cfa | None) -> dict[str, float]:
    """Share flagged of a still scene; of the path of a bright square through it, and beside the path."""
    rng = np.random.default_rng([seed, 2])
    still = scene(seed)
    false = without_ghosts([expose(still, k, rng, cfa) for k in SCALES]).ghost.mean()
    frames, path = [], np.zeros(SIZE, bool)
    for step, k in enumerate(SCALES):
        light, place = still.copy(), (slice(100, 160), slice(60 + 50 * step, 110 + 50 * step))
        changed = np.abs(np.log(0.3 / light[place])) > 0.3
        light[place] = 0.3
        path[place] = changed
        frames.append(expose(light, k, rng, cfa))
    ghost = without_ghosts(frames).ghost
    beside = cv2.dilate(path.astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    return {"false": float(false), "found": float(ghost[path].mean()), "beside": float(ghost[beside].mean())}


def shake(seed: int, cfa: Cfa | None, step: float) -> float:
    """Largest error of a shift between neighbouring exposures, px."""
    rng = np.random.default_rng([seed, 3])
    logs, frames = np.log(scene(seed)), []
    for index, k in enumerate(SCALES):
        motion = np.array([[1, 0, step * index], [0, 1, -0.5 * step * index]], np.float32)
        moved = cv2.warpAffine(
            logs, motion, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        frames.append(expose(np.exp(moved), k, rng, cfa))
    return max(float(np.hypot(shift.x + step, shift.y - 0.5 * step)) for shift in shifts(frames))


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Merging",
        "",
        f"`python -m bench.capture.merge --write`: {result['seeds']} seeds. {words(result['machine'])}.",
        "",
        "Noise in units of the Cramér-Rao bound; bias in units of the sigma that the merge gives itself.",
        "",
        "| bracket | radiance | measured, % | noise | bias | chi-square | sums, no model | hat weights |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["decades"]:
        start = f"| {row['bracket']} | {row['from']:g}..{10 * row['from']:g} | {100 * row['measured']:.0f}"
        if "noise" in row:
            start += (
                f" | {row['noise']:.3f} | {row['bias']:+.3f} | {row['chi_square']:.3f} | {row['sums']:.2f}"
            )
            start += f" | {row['hat']:.2f}"
        else:
            start += " | all clipped, as a bound | | | |"
        lines.append(start + " |")
    lines += [
        "",
        f"Exposure ratios with 5 % shutter errors: largest error {100 * max(result['ratios']):.3f} %, "
        f"median {100 * float(np.median(result['ratios'])):.3f} %. "
        "With exposures 2^20 apart, light just below white falls to an exposure a million times noisier in "
        "one pixel of a thousand, as sigma shows: hence the noise of that row.",
        "",
        "| frames | flagged of a still scene, % | of what moved, % | beside it, % "
        "| error of a shift of 0 / 1 / 2.5 px, px |",
        "|---|---|---|---|---|",
    ]
    for row in result["motion"]:
        shaken = " / ".join(f"{error:.2f}" for error in row["shake"])
        lines.append(
            f"| {row['frames']} | {100 * row['false']:.4f} | {100 * row['found']:.1f} "
            f"| {100 * row['beside']:.3f} | {shaken} |"
        )
    return "\n".join(lines) + "\n"


def mean_of(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def motion(name: str, cfa: Cfa | None, seeds: Sequence[int]) -> dict[str, Any]:
    errors: Callable[[float], float] = lambda step: max(shake(seed, cfa, step) for seed in seeds)  # noqa: E731
    figures = mean_of([ghosts(seed, cfa) for seed in seeds])
    return {"frames": name} | figures | {"shake": [errors(step) for step in (0.0, 1.0, 2.5)]}


def main() -> None:
    options = arguments(__doc__).parse_args()
    seeds = range(1 if options.quick else 10)
    decades = [
        {"bracket": name} | mean_of([decade(low, high, scales, seed) for seed in seeds])
        for name, scales in BRACKETS.items()
        for low, high in DECADES
    ]
    result = {
        "machine": machine(),
        "seeds": len(seeds),
        "decades": decades,
        "ratios": [ratios(seed) for seed in seeds],
        "motion": [motion("pixels", None, seeds), motion("mosaic", Cfa.RGGB, seeds)],
    }
    deliver(options, "merge", result, table(result))


if __name__ == "__main__":
    main()
