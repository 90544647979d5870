"""The bracket planner against brute force, and the SNR that it predicts against simulated frames.

    python -m bench.capture.planner [--quick] [--json] [--write] [--scenes 500] [--seed 0]

Random scenes before three sensors, lists of up to 24 exposures. Brute force tries all subsets by
increasing size, of every shutter time at every ISO. The SNR is the mean over the standard deviation of
repeated frames at the dark end, the bright end and the hand-overs of planned brackets: of a sensor that
is as far from its data sheet as sold ones are, and of a whole simulated rig that meters, plans and shoots.
--write puts the table into bench/results/planner.md.
"""

import math
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any
from unittest.mock import patch

import numpy as np

from bench.capture.planner_cases import SENSORS, Case, demands, draw, fewest, noise_of, shown, unit
from bench.support.record import arguments, deliver, machine, words
from capture.bracket.exposure_choices import exposure_list
from capture.bracket.goals import BracketGoals
from capture.bracket.metering.meter import meter
from capture.bracket.planner import SLACK, BracketPlan, plan_bracket
from drivers.sim.camera import shutter
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor
from drivers.sim.rigs import simulate
from imaging.arrays import Array
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import mosaic
from imaging.sensor.mosaic import RawMosaic

SIDE, TAKES = 64, 32
"""Photosites along a side of the flat fields, and how often each is shot."""
LONG = 2.0
"""Seconds above which dark current, which no file states, is reported separately."""


def planned(case: Case) -> BracketPlan:
    return plan_bracket(case.targets, listed(case), BracketGoals(snr=case.snr))


def listed(case: Case) -> tuple[Exposure, ...]:
    return exposure_list(case.times, case.isos, 4.0, BracketGoals())


def against_brute_force(sensor: SensorModel, cases: list[Case]) -> dict[str, Any]:
    """Count the plans with as many exposures as the optimum, and those that show all that can be shown."""
    sizes: list[int] = []
    gains: list[float] = []
    more = fewer = incomplete = beyond = 0
    seconds = 0.0
    for case in cases:
        began = time.perf_counter()
        plan = planned(case)
        seconds += time.perf_counter() - began
        needed = demands(case, case.shots)
        chosen = sum(1 << case.shots.index(shot) for shot in plan.exposures)
        incomplete += bool(((needed & np.uint32(chosen)) == 0).any())
        best = fewest(needed, len(case.shots))
        more += len(plan.exposures) > best
        fewer += len(plan.exposures) < best
        beyond += bool(plan.shortfalls)
        sizes.append(best)
        with patch("capture.bracket.planner.BALANCE", 1.0):
            quickest = hand_over(case, planned(case))
        if quickest < math.inf:
            gains.append(hand_over(case, plan) - quickest)
    return {
        "scenes": len(cases),
        "lists": [min(len(case.shots) for case in cases), max(len(case.shots) for case in cases)],
        "optimum": {size: sizes.count(size) for size in sorted(set(sizes))},
        "more_than_the_optimum": more,
        "fewer_than_the_optimum": fewer,
        "showing_less_than_possible": incomplete,
        "beyond_the_list": beyond,
        "handing_over": len(gains),
        "better_hand_overs": len(better := [gain for gain in gains if gain > 0.01]),
        "hand_over_gain_db": float(np.mean(better)),
        "milliseconds_a_plan": 1000 * seconds / len(cases),
    }


def hand_over(case: Case, plan: BracketPlan) -> float:
    """The least SNR, dB, that an exposure gives where the next longer one ends; infinite if none does."""
    worst = math.inf
    for target in case.targets:
        for shot, longer in pairwise(plan.exposures):
            end = target.noise.brightest(longer) / 2.0**SLACK
            if target.dark <= end < target.bright and shown(target.noise, shot, case.snr, np.array([end]))[0]:
                worst = min(worst, target.noise.snr(end, shot))
    return worst


def decisive(case: Case, plan: BracketPlan) -> list[tuple[Exposure, float, float]]:
    """(exposure, radiance, predicted dB) at the ends of the scene and at the hand-overs, where unclipped."""
    points = []
    ascending = list(plan.exposures)
    for target in case.targets[:3]:
        ends = [target.noise.brightest(shot) / 2.0**SLACK for shot in ascending]
        pairs = [(ascending[-1], target.dark), (ascending[0], target.bright)]
        pairs += [(shot, end) for shot, end in zip(ascending, ends, strict=True)]
        pairs += [(shot, end) for shot, end in zip(ascending, ends[1:], strict=False)]
        for shot, radiance in pairs:
            if shown(target.noise, shot, case.snr, np.array([radiance]))[0]:
                points.append((shot, radiance, target.noise.snr(radiance, shot)))
    return points


def sensor_differences(
    sensor: SensorModel, cases: list[Case], seed: int, cold: bool = False
) -> tuple[Array, Array]:
    """Measured minus predicted SNR, dB, of flat fields [n], and the seconds of the exposures [n].

    cold: only what is LONG, without dark current.
    """
    rng = np.random.default_rng([seed, 1])
    white = noise_of(sensor).span / sensor.gain
    differences = []
    for number, case in enumerate(cases):
        one = unit(sensor, rng)
        sold = SimulatedSensor(replace(one, dark_current=0.0) if cold else one, SIDE, SIDE, seed, number)
        for shot, radiance, predicted in decisive(case, planned(case)):
            if cold and shot.time <= LONG:
                continue
            flat = np.full((SIDE, SIDE), radiance * shot.scale / shot.iso_gain * white)
            lit, dark = (
                np.stack([sold.expose(light, shot.time, shot.iso_gain, rng) for _ in range(TAKES)])
                for light in (flat, np.zeros_like(flat))
            )
            signal = lit.astype(np.float64) - dark.mean()  # light alone: dark current brightens as well
            differences.append((measured(signal) - predicted, shot.time))
    pairs = np.reshape(differences, (-1, 2))
    return pairs[:, 0], pairs[:, 1]


def measured(signal: Array) -> float:
    """dB: mean over the deviation from take to take of `signal` [takes, ...]."""
    return float(20 * np.log10(signal.mean() / np.sqrt(signal.var(axis=0, ddof=1).mean())))


def rig_differences(seed: int, takes: int) -> tuple[Array, Array]:
    """The same of the toy rig before ramps, by the shutter's labels and by the times that it applies."""
    by_label, by_time = [], []
    for stops in (4, 8, 12, 16):
        body = simulate("toy", seed).bodies[0]
        lens = body.optics.lens
        ramp = 8.0 * 2.0 ** np.linspace(-stops / 2, stops / 2, lens.width)[None, :, None]
        view = np.broadcast_to(ramp, (lens.height, lens.width, 3))
        camera = SimulatedCamera(body, partial(steady, view))
        exposures = exposure_list(camera.capabilities().times, (100.0,), 4.0, BracketGoals())
        targets = meter({"cam0": camera}, exposures).targets
        truth = mosaic(body.optics.exposure(view), body.cfa)
        levels = np.rint(4 * np.log2(truth)).astype(int)
        for shot in plan_bracket(targets, exposures, BracketGoals()).exposures:
            frames = []
            for _ in range(takes):
                camera.set_exposure(shot)
                camera.arm()
                camera.trigger()
                frames.append(camera.collect())
            signal = np.stack([frame.signal() for frame in frames if isinstance(frame, RawMosaic)]).astype(
                np.float64
            )
            applied = shutter.applied(shot)
            for level in np.unique(levels):
                there = levels == level
                light = np.array([float(np.sqrt((truth[there] ** 2).mean()))])
                if there.sum() >= 64 and shown(targets[0].noise, shot, 20.0, light)[0]:
                    snr = 10 * np.log10(
                        (signal[:, there].mean(axis=0) ** 2).mean()
                        / signal[:, there].var(axis=0, ddof=1).mean()
                    )
                    by_label.append(snr - targets[0].noise.snr(float(light[0]), shot))
                    by_time.append(snr - targets[0].noise.snr(float(light[0]), applied))
    return np.array(by_label), np.array(by_time)


def steady(view: Array, frame: int) -> Array:
    """Return what a camera sees of a scene that is the same in every frame."""
    return view


def spread(differences: Array) -> dict[str, float]:
    """Spread of the absolute differences; bias is their signed median."""
    size = np.abs(differences)
    return {
        "points": len(size),
        "bias": float(np.median(differences)),
        "median": float(np.median(size)),
        "p95": float(np.percentile(size, 95)),
        "max": float(size.max()),
    }


def measure(scenes: int, shot: int, takes: int, seed: int) -> dict[str, Any]:
    counts, snr, slow, cold = {}, {}, [], []
    for number, (name, sensor) in enumerate(SENSORS.items()):
        rng = np.random.default_rng([seed, number])
        cases = [draw(sensor, rng) for _ in range(scenes)]
        counts[name] = against_brute_force(sensor, cases)
        differences, times = sensor_differences(sensor, cases[:shot], seed)
        snr[f"{name}, up to {LONG:g} s"] = spread(differences[times <= LONG])
        slow.append(differences[times > LONG])
        cold.append(sensor_differences(sensor, cases[:shot], seed, cold=True)[0])
    snr[f"all three beyond {LONG:g} s, dark current 0.5 e/s"] = spread(np.concatenate(slow))
    snr[f"all three beyond {LONG:g} s, without dark current"] = spread(np.concatenate(cold))
    label, applied = rig_differences(seed, takes)
    snr["the toy rig, by the shutter's labels"] = spread(label)
    snr["the toy rig, by the times applied"] = spread(applied)
    return {"machine": machine(), "seed": seed, "brute_force": counts, "snr": snr}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The bracket planner against brute force",
        "",
        f"`python -m bench.capture.planner --write`: seed {result['seed']}. {words(result['machine'])}.",
        "",
        "| sensor | scenes, of these beyond the list | exposures in the list | more than the optimum | fewer "
        "| shows less than possible | exposures of the optimum: scenes | ms a plan |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, row in result["brute_force"].items():
        sizes = ", ".join(f"{size}: {count}" for size, count in row["optimum"].items())
        lines.append(
            f"| {name} | {row['scenes']}, {row['beyond_the_list']} | {row['lists'][0]} to {row['lists'][1]} "
            f"| {row['more_than_the_optimum']} | {row['fewer_than_the_optimum']} "
            f"| {row['showing_less_than_possible']} | {sizes} | {row['milliseconds_a_plan']:.1f} |"
        )
    gains = ", ".join(
        f"in {row['better_hand_overs']} of {row['handing_over']} by {row['hand_over_gain_db']:.1f} dB "
        f"({name})"
        for name, row in result["brute_force"].items()
    )
    lines += ["", f"The worst hand-over is better than in the quickest bracket as small: {gains}."]
    lines += [
        "",
        "Measured minus predicted SNR, dB:",
        "",
        "| frames of | points | bias | median of size | 95 % | largest |",
        "|---|---|---|---|---|---|",
    ]
    for name, row in result["snr"].items():
        lines.append(
            f"| {name} | {row['points']} | {row['bias']:+.3f} | {row['median']:.3f} | {row['p95']:.3f} "
            f"| {row['max']:.3f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--scenes", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    scenes, shot, takes = (40, 8, 40) if options.quick else (options.scenes, 40, 240)
    result = measure(scenes, shot, takes, options.seed)
    deliver(options, "planner", result, report(result))


if __name__ == "__main__":
    main()
