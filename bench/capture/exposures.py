"""Exposures estimated from overlapping pixels: simulated shutters that are 5 % off, and real brackets.

    python -m bench.capture.exposures [--quick] [--json] [--write]

Simulated: cameras of the demo rig with more pixels, every shutter time off by a normal deviate of 5 %; the
error is that of the ratio of neighbouring exposures. Of developed photographs no picture separates a straight
line over the logarithm of exposure from the curve; "less a line" is the error without it. Real: the brackets
t2i and memorial of the folder that RIG_DATA names, without truth. --write puts the tables into
bench/results/exposures.md.
"""

import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

import imagecodecs
import numpy as np

from bench.support.record import arguments, deliver, machine, words
from capture.check import developed_ratios
from capture.check.check import check
from capture.check.exposure_estimates import ExposureEstimate, estimates, meant, raw_edges
from capture.imports.photos import import_photos
from capture.pictures import reduced_pictures
from drivers.camera import CameraFile
from drivers.sim.camera import camera, shutter
from drivers.sim.camera.camera import Body, SimulatedCamera
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.seeds import generator
from imaging.arrays import Array
from imaging.merge.linear_frame import from_raw
from imaging.optics.exposure import Exposure

OFF = 0.05
GOAL = 0.1
"""Per cent that a ratio may be wrong by."""
SPACINGS = {
    "1 EV": (1 / 4, 1 / 8, 1 / 15, 1 / 30, 1 / 60, 1 / 125, 1 / 250),
    "2 EV": (1 / 4, 1 / 15, 1 / 60, 1 / 250, 1 / 1000),
    "4 EV": (1 / 4, 1 / 60, 1 / 1000),
}
WIDTH, HEIGHT = 960, 720
BOOTSTRAPS = 500


@dataclass(frozen=True)
class Bracket:
    """ln of estimated over applied exposures where both are known, NaN elsewhere; ln of the labels."""

    error: Array
    labels: Array

    def ratios(self, line: bool) -> Array:
        """Per cent by which the ratios of neighbours are wrong; line: less a straight line."""
        known = np.isfinite(self.error)
        error = self.error.copy()
        if line and known.sum() > 2:
            error[known] -= np.polyval(np.polyfit(self.labels[known], error[known], 1), self.labels[known])
        steps = np.diff(error)
        return np.asarray(100 * np.abs(np.expm1(steps[np.isfinite(steps)])))


def wrong_shutters(seed: int) -> Callable[[Body, int, Exposure], tuple[Exposure, float]]:
    """`applied_exposure` of cameras whose every exposure is off by its own 5 %, and whose light is steady."""

    def applied(body: Body, frame: int, label: Exposure) -> tuple[Exposure, float]:
        exact = shutter.applied(label)
        off = generator(seed, body.serial, "off", frame, label.time).standard_normal()
        return exact.with_time(exact.time * float(np.exp(OFF * off))), 1.0

    return applied


def shots(device: SimulatedCamera, labels: Sequence[Exposure]) -> list[reduced_pictures.ReducedPicture]:
    """The bracket as `rig check` sees it."""
    reduced_shots = []
    for label in labels:
        device.set_exposure(label)
        device.arm()
        device.trigger()
        frame = device.collect()
        if isinstance(frame, CameraFile):
            codes = imagecodecs.jpeg_decode(frame.data).astype(np.float32) / 255
            reduced_shots.append(reduced_pictures.of_photo(np.asarray(codes, np.float32)))
        else:
            reduced_shots.append(reduced_pictures.of_raw(from_raw(frame, 1.0), frame.cfa))
    return reduced_shots


def brackets(
    rig: SimulatedRig, seed: int, times: Sequence[float], cameras: int, frames: int
) -> list[Bracket]:
    """Every camera at every frame."""
    labels = [Exposure(time=time, f_number=4.0, iso=100.0) for time in times]
    applied = wrong_shutters(seed)
    results = []
    with patch.object(camera, "applied_exposure", applied):
        for device in rig.devices[:cameras]:
            taken = []
            for frame in range(frames):
                device.place(frame)
                taken.append(shots(device, labels))
            estimates = _raw(taken, labels) if device.body.kind == "raw" else _developed(taken, labels)
            for frame, estimated in enumerate(estimates):
                truth = [applied(device.body, frame, label)[0].scale for label in labels]
                results.append(_bracket(estimated, truth, labels))
    return results


def _raw(
    taken: Sequence[Sequence[reduced_pictures.ReducedPicture]], labels: Sequence[Exposure]
) -> list[list[ExposureEstimate | None]]:
    scale = np.log([label.scale for label in labels])
    linear = [[one.linear for one in bracket if one.linear is not None] for bracket in taken]
    return [estimates(labels, raw_edges(frames, scale)) for frames in linear]


def _developed(
    taken: Sequence[Sequence[reduced_pictures.ReducedPicture]], labels: Sequence[Exposure]
) -> list[list[ExposureEstimate | None]]:
    patches = [[one.patches for one in bracket if one.patches is not None] for bracket in taken]
    codes = [developed_ratios.codes_of(one, meant(labels)) for one in patches]
    curves = developed_ratios.curves(codes)
    return [estimates(labels, developed_ratios.edges(one, curves) if curves else {}) for one in codes]


def _bracket(
    estimated: Sequence[ExposureEstimate | None], truth: Sequence[float], labels: Sequence[Exposure]
) -> Bracket:
    scale = [np.nan if one is None else one.exposure.scale for one in estimated]
    return Bracket(np.log(scale) - np.log(truth), np.log([label.scale for label in labels]))


def summary(brackets: Sequence[Bracket], line: bool) -> dict[str, float]:
    """Median, 95th percentile and largest error in per cent; standard errors from bootstrapped brackets."""
    each = [bracket.ratios(line) for bracket in brackets]
    random = np.random.default_rng(0)
    drawn = [
        np.percentile(np.concatenate([each[i] for i in random.integers(0, len(each), len(each))]), [50, 95])
        for _ in range(BOOTSTRAPS)
    ]
    error = np.std(drawn, axis=0)
    every = np.concatenate(each)
    median, high = np.percentile(every, [50, 95])
    return {
        "ratios": len(every),
        "median": float(median),
        "median_error": float(error[0]),
        "p95": float(high),
        "p95_error": float(error[1]),
        "largest": float(every.max()),
    }


def simulated(seeds: int, cameras: int, frames: int) -> list[dict[str, Any]]:
    """A row a kind of camera and spacing."""
    rows = []
    for name, what in (("demo", "RAW"), ("demo-ldr", "JPEG")):
        rigs = [simulate(name, seed, width=WIDTH, height=HEIGHT, samples=1) for seed in range(seeds)]
        for spacing, times in SPACINGS.items():
            if what == "JPEG" and spacing == "4 EV":
                continue  # 8 bits hold too little of two exposures so far apart
            results = [
                one for seed, rig in enumerate(rigs) for one in brackets(rig, seed, times, cameras, frames)
            ]
            for line in (False,) if what == "RAW" else (False, True):
                row = {"files": what, "spacing": spacing, "less_a_line": line, "brackets": len(results)}
                rows.append(row | summary(results, line))
    return rows


def real(name: str) -> list[dict[str, Any]]:
    """Return what `rig check` says of a real bracket; empty without RIG_DATA."""
    data = os.environ.get("RIG_DATA")
    if not data:
        return []
    with tempfile.TemporaryDirectory() as folder:
        import_photos(Path(data) / name, Path(folder) / "s")
        looks = check(Path(folder) / "s").looks
    rows = []
    for look in sorted(looks, key=lambda one: -(one.reported.time if one.reported else 0.0)):
        stated = look.reported
        if stated is None:
            continue
        power = float(np.exp(meant([one.reported for one in looks if one.reported]))[looks.index(look)])
        rows.append(
            {
                "label": str(stated.time if stated.time >= 0.4 else f"1/{1 / stated.time:.0f}"),
                "stated": stated.time,
                "power": power / stated.scale * stated.time,
                "estimated": look.estimated.time if look.estimated else None,
                "off": look.off,
                "error": look.estimate_error,
            }
        )
    return rows


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Exposures from overlapping pixels",
        "",
        f"`python -m bench.capture.exposures --write`: shutters {100 * OFF:g} % off, "
        f"{result['seeds']} seeds, "
        f"{result['cameras']} cameras, {result['frames']} frames of {WIDTH}x{HEIGHT}; the goal "
        f"is {GOAL:g} % for RAW. "
        f"{words(result['machine'])}.",
        "",
        "| files | spacing | brackets | ratios | median error, % | 95 %, % | largest, % |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["simulated"]:
        kind = row["files"] + (", less a line" if row["less_a_line"] else "")
        lines.append(
            f"| {kind} | {row['spacing']} | {row['brackets']} | {row['ratios']} | "
            f"{row['median']:.3f} ± {row['median_error']:.3f} | {row['p95']:.3f} ± {row['p95_error']:.3f} | "
            f"{row['largest']:.3f} |"
        )
    for name, rows in result["real"].items():
        if not rows:
            continue
        lines += [
            "",
            f"{name}, within its bracket:",
            "",
            "| label, s | power of two, 1/s | estimated, 1/s | off, stops |",
            "|---|---|---|---|",
        ]
        for row in rows:
            power = row["estimated"]
            lines.append(
                f"| {row['label']} | {1 / row['power']:.4g} | "
                + (f"{1 / power:.4g} | {row['off']:+.3f} ± {row['error']:.3f} |" if power else "unknown | |")
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    seeds, cameras, frames = (1, 2, 2) if options.quick else (5, 4, 3)
    result = {
        "machine": machine(),
        "seeds": seeds,
        "cameras": cameras,
        "frames": frames,
        "simulated": simulated(seeds, cameras, frames),
        "real": {name: real(name) for name in ("t2i", "memorial")},
    }
    deliver(options, "exposures", result, report(result))


if __name__ == "__main__":
    main()
