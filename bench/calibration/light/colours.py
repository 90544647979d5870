"""Colour charts: in three lights before two cameras, and detection in pictures.

    python -m bench.calibration.light.colours [--quick] [--json] [--write]

Charts are made from spectra: Ohta's patches, NPL's sensitivities of two cameras, CIE's lights; noise is that
of a sensor of 40,000 electrons, at a number of stops below white. Delta E 2000 is of patches that the fit
did not see, against what an observer adapted to the light sees. "Least squares" is colour-science's 3x3
(`matrix_colour_correction`, Cheung 2004), which keeps no white. A chart counts as found when every patch
that is used measures within 3 % and five standard errors of what was painted. --write puts
the tables into bench/results/colours.md.
"""

from collections.abc import Sequence
from typing import Any

import colour
import numpy as np

from bench.support.record import arguments, deliver, machine, words
from calib.colour.chart_detection import DetectedChart, Missed, best, locate
from calib.colour.fit import ChartPatches, ColourModel, held_out
from imaging.arrays import Array
from imaging.colour.difference import delta_e
from imaging.merge.bracket import Merged, merge_bracket
from imaging.merge.linear_frame import from_raw
from imaging.sensor.cfa import Cfa, cell_means
from tests.calib.colour.charts import FULL_WELL, READ, painted, photograph, square_on, world

LIGHTS = ("D65", "A", "LED-B3")
STOPS = (None, 0, -3, -6)
"""Stops below white; None: no noise."""
SITES = 200
"""Photosites of each channel that a patch is the mean of."""
SHARES = (0.6, 0.3, 0.15, 0.1)
TILTS = (0.0, 0.5, 1.0)
EXPOSURES = (0.0, -3.0, -6.0)
WIDTH, HEIGHT = 900, 600


def place() -> Array:
    row, column = np.divmod(np.arange(24), 6)
    return np.stack([column / 2.5 - 1, row / 1.5 - 1], axis=1)


def exposed(camera: str, light: str, stops: float | None, seed: int) -> ChartPatches:
    """A chart's patches with the noise of an exposure, its brightest at a number of stops below white."""
    rgb = world(camera, light).camera
    if stops is None:
        return ChartPatches(rgb, 1e-6 * rgb, place(), np.ones(24, bool))
    electrons = rgb / rgb.max() * FULL_WELL * 2.0**stops
    sigma = np.sqrt((electrons + READ**2) / SITES)
    noisy = electrons + np.random.default_rng(seed).normal(0, sigma)
    return ChartPatches(noisy, sigma, place(), np.all(noisy > 10 * sigma, axis=1))


def least_squares(patches: ChartPatches, truth: Array) -> Array:
    """Held-out delta E of colour-science's 3x3, float64 [24]."""
    rgb = patches.rgb / patches.rgb[18, 1] * truth[18, 1]
    errors = []
    for index in np.flatnonzero(patches.usable):
        rest = patches.without(int(index)).usable
        matrix = colour.matrix_colour_correction(rgb[rest], truth[rest], method="Cheung 2004", terms=3)
        errors.append(float(delta_e(matrix @ rgb[index], truth[index])))
    return np.array(errors)


def matrices(seeds: int) -> list[dict[str, Any]]:
    rows = []
    for camera in ("nikon", "sigma"):
        for light in LIGHTS:
            truth = world(camera, light).truth
            for stops in STOPS:
                trials = [
                    exposed(camera, light, stops, seed) for seed in range(1 if stops is None else seeds)
                ]
                mine = np.concatenate(
                    [held_out([patches], truth, ColourModel())[0][patches.usable] for patches in trials]
                )
                peer = np.concatenate([least_squares(patches, truth) for patches in trials])
                rows.append(
                    {
                        "camera": camera,
                        "light": light,
                        "stops": stops,
                        "mine": statistics(mine),
                        "peer": statistics(peer),
                    }
                )
    return rows


def statistics(errors: Array) -> dict[str, float]:
    return {"mean": errors.mean(), "p95": float(np.percentile(errors, 95)), "max": errors.max()}


def search(merged: Merged) -> DetectedChart | Missed:
    assert merged.cfa is not None
    return best(merged, [2 * outlines for outlines in locate(cell_means(merged.radiance, merged.cfa))])


def right(chart: DetectedChart | Missed, camera: Array) -> bool:
    """Return whether the chart that was found measures what was painted."""
    if isinstance(chart, Missed):
        return False
    used = chart.patches.usable
    ratio = (chart.patches.rgb / camera)[used]
    scale = np.median(ratio)
    return bool(np.all(np.abs(ratio / scale - 1) < 0.03 + 5 * (chart.patches.sigma / camera)[used] / scale))


def detection(turns: int) -> list[dict[str, Any]]:
    sensor = world("nikon", "D65")
    random = np.random.default_rng(1)
    rows = []
    for share in SHARES:
        for tilt in TILTS:
            good = wrong = total = 0
            for stops in EXPOSURES:
                for _ in range(turns):
                    corners = square_on(WIDTH, HEIGHT, share, random.uniform(0, 360), tilt)
                    light = painted(sensor.camera, sensor.white, corners, WIDTH, HEIGHT)
                    raw = photograph(light, 0.8 * 2.0**stops / light.max(), seed=total, vignetting=-0.2)
                    chart = search(merge_bracket([from_raw(raw, 1.0)]))
                    good += right(chart, sensor.camera)
                    wrong += isinstance(chart, DetectedChart) and not right(chart, sensor.camera)
                    total += 1
            rows.append({"share": share, "tilt": tilt, "found": good, "wrong": wrong, "of": total})
    return rows


def mosaics(count: int) -> int:
    """Return the number of walls of coloured squares, of that many, taken for a chart."""
    false = 0
    for seed in range(count):
        random = np.random.default_rng(seed)
        squares = random.uniform(0.02, 1, (4 + seed % 5, 6 + seed % 7, 3))
        light = 0.03 * np.ones((HEIGHT, WIDTH, 3))
        side = HEIGHT // (len(squares) + 1)
        for row, column in np.ndindex(*squares.shape[:2]):
            top, left = 10 + row * side, 10 + column * side
            light[top : top + side - side // 6, left : left + side - side // 6] = squares[row, column]
        raw = photograph(light, 0.8, seed=seed, cfa=Cfa.RGGB)
        false += isinstance(search(merge_bracket([from_raw(raw, 1.0)])), DetectedChart)
    return false


def table(result: dict[str, Any]) -> str:
    lines = [
        "# Colour from a chart",
        "",
        "`python -m bench.calibration.light.colours --write`: CIEDE2000 of patches left out. "
        f"{words(result['machine'])}.",
        "",
        "| Camera | Light | Noise | Mean | 95 % | Largest | Least squares: mean | largest |",
        "| --- | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in result["matrices"]:
        noise = "none" if row["stops"] is None else f"at {row['stops']} EV"
        mine, peer = row["mine"], row["peer"]
        lines.append(
            f"| {row['camera']} | {row['light']} | {noise} | {mine['mean']:.2f} | {mine['p95']:.2f} | "
            f"{mine['max']:.2f} | {peer['mean']:.2f} | {peer['max']:.2f} |"
        )
    lines += [
        "",
        f"Charts found in pictures of {WIDTH}x{HEIGHT}, at 0, -3 and -6 EV, turned at random, light falling "
        "by 20 % to the corners:",
        "",
        "| Share of the width | Tilt | Found | Measured wrongly | Of |",
        "| ---: | ---: | ---: | ---: | ---: |",
    ]
    lines += [
        f"| {row['share']:g} | {row['tilt']:g} | {row['found']} | {row['wrong']} | {row['of']} |"
        for row in result["detection"]
    ]
    lines += ["", f"Walls of coloured squares taken for a chart: {result['false']} of {result['walls']}."]
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> None:
    options = arguments(__doc__).parse_args(argv)
    walls = 4 if options.quick else 12
    result = {
        "machine": machine(),
        "matrices": matrices(1 if options.quick else 3),
        "detection": detection(1),
        "walls": walls,
        "false": mosaics(walls),
    }
    deliver(options, "colours", result, table(result))


if __name__ == "__main__":
    main()
