"""Sensors measured from simulated darks, flats and brackets, against what was simulated.

    python -m bench.calibration.light.sensor [--quick] [--json] [--write]

Every trial is another sensor of a kind, of 256x256 photosites: 16 darks at each of 3 times, 4 flats at each
of 8 exposures that flicker by 0.3 %. "in" counts the trials whose 95 % interval holds the true value. Defects
are those of 10 standard deviations and more of a mean dark, or of the fixed pattern in light. The read noise
of brackets holds what rows have in common. --write puts the table into bench/results/sensor.md. Finished
trials are kept, so that a run that was stopped goes on; remove hdr-rig-bench/sensor.jsonl to begin anew.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import chain, pairwise
from typing import Any

import numpy as np

from bench.support.record import WORK, arguments, deliver, machine, words
from calib.sensor import brackets
from calib.sensor.emva1288 import emva
from calib.sensor.linearity import straightness
from calib.sensor.stack import gather
from drivers.sim.camera.sensor import SensorModel, SimulatedSensor
from imaging.arrays import Array
from imaging.files import store

SIDE, DARKS, FLATS = 256, 16, 4
TIMES = (0.01, 1.0, 8.0)

_PLAIN = SensorModel(
    gain=0.4, read_noise=3.0, full_well=10_300.0, black=((256.0, 257.3), (255.0, 256.5)), bit_depth=12,
    prnu=0.008, dsnu=0.5, dark_current=0.5, dark_spread=0.2, hot_share=1e-3, hot_current=100.0,
    dead_share=5e-4,
)  # fmt: skip
KINDS = {
    "12 bits, ISO 100": _PLAIN,
    "12 bits, white 12 % too high": replace(_PLAIN, ceiling=3600),
    "12 bits, rows of 1 e": replace(_PLAIN, row_noise=1.0),
    "14 bits, ISO 1600": replace(
        _PLAIN,
        gain=6.0,
        read_noise=1.5,
        bit_depth=14,
        black=((512.0, 511.0), (513.2, 512.0)),
        full_well=50_000.0,
    ),
    "12 bits, read noise 0.2 DN": replace(_PLAIN, gain=0.1, read_noise=2.0, full_well=38_000.0),
    "12 bits, black at 1.5 DN": replace(_PLAIN, black=((1.5, 1.5), (1.2, 1.8))),
}
BENT = "12 bits, bent by 2 % at white"
FIELDS = (
    ("gain", "gain %", 100.0),
    ("read_noise", "read noise %", 100.0),
    ("black", "black DN", 1.0),
    ("ceiling", "ceiling %", 100.0),
    ("prnu", "PRNU %", 100.0),
    ("dsnu", "DSNU %", 100.0),
    ("dark_current", "dark current %", 100.0),
)
_SITES = np.array(((0.55, 1.0), (1.0, 0.7)))
"""Response of red, green and blue sites to grey light."""


def light(scene: bool, rng: np.random.Generator) -> Array:
    """Relative light at each photosite: a flat that falls off, or something to look at."""
    y, x = (np.mgrid[0:SIDE, 0:SIDE] - SIDE / 2 + 0.5) / (SIDE / 2)
    if not scene:
        return np.asarray((1.0 - 0.15 * (x**2 + y**2)) * np.tile(_SITES, (SIDE // 2, SIDE // 2)))
    waves = sum(
        rng.normal() * np.sin(rng.uniform(1, 25) * x + rng.uniform(1, 25) * y + rng.uniform(0, 7))
        for _ in range(12)
    )
    return np.asarray(np.exp2(-4.0 + waves * 1.2 + 3.0 * x) * np.tile(_SITES, (SIDE // 2, SIDE // 2)))


def nominal(model: SensorModel) -> emva.Nominal:
    """Return what the files say: a round black, and white at the end of the bits."""
    return emva.Nominal(np.full(4, float(np.rint(np.mean(model.black)))), float(model.white))


def end(model: SensorModel) -> float:
    """Return where photosites end, DN: by the converter, or by the well of the site with the least black."""
    full = float(np.min(model.black)) + model.gain * model.full_well
    return min(float(model.white if model.ceiling is None else model.ceiling), full)


def shoot(sensor: SimulatedSensor, rng: np.random.Generator, levels: int = 8) -> emva.Frames:
    model, dark, even = sensor.model, np.zeros((SIDE, SIDE)), light(False, rng)
    darks, few = [], []
    for exposure in TIMES:
        frames = [sensor.expose(dark, exposure, 1.0, rng) for _ in range(DARKS)]
        few.append(frames[:8])
        darks.append(gather(frames, exposure))
    flats = []
    for step in range(levels):
        amount = 1.6 * model.white_electrons * 2.0 ** (step - levels + 1)
        flicker = 1.0 + 0.003 * rng.standard_normal(FLATS)
        frames = [sensor.expose(even * amount * flash, 0.01, 1.0, rng) for flash in flicker]
        flats.append(gather(frames, 2.0**step, float(nominal(model).black.mean())))
    return emva.Frames(darks, flats, few)


def trial(model: SensorModel, seed: int) -> dict[str, Any]:
    sensor, rng = SimulatedSensor(model, SIDE, SIDE, seed, "bench"), np.random.default_rng((seed, 1))
    frames = shoot(sensor, rng)
    measurement, _ = emva.measure_emva(frames, nominal(model), 100.0)
    true = {
        "gain": model.gain,
        "read_noise": model.read_noise,
        "row_noise": model.row_noise,
        "prnu": model.prnu,
        "dsnu": model.dsnu,
        "dark_current": float(sensor.dark_current[~sensor.hot].mean()),
        "ceiling": end(model),
        "nonlinearity": model.nonlinearity,
    }
    row: dict[str, Any] = {}
    for name, value in true.items():
        value_measured = getattr(measurement, name)
        if value_measured is not None and (value > 0 or name == "nonlinearity"):
            row[name] = (
                (value_measured.value / value - 1) if value else value_measured.value,
                (value_measured.value - value) / value_measured.sigma,
            )
    if measurement.black is not None:
        worst = max(
            zip(chain(*measurement.black), chain(*model.black), strict=True),
            key=lambda pair: abs(pair[0].value - pair[1]),
        )
        row["black"] = (
            worst[0].value - worst[1],
            (measurement.black[0][0].value - model.black[0][0]) / measurement.black[0][0].sigma,
        )
    row["linear"] = measurement.linear
    return row | _defects(sensor, frames, {(defect.x, defect.y) for defect in measurement.defects or ()})


def _defects(sensor: SimulatedSensor, frames: emva.Frames, named: set[tuple[int, int]]) -> dict[str, int]:
    model, longest = sensor.model, TIMES[-1]
    usual = model.dark_current * longest
    scatter = np.sqrt(model.read_noise**2 + usual + 1 / 12 / model.gain**2) / np.sqrt(DARKS)
    spread = np.hypot(np.hypot(scatter, model.dsnu), usual * model.dark_spread)
    hot = sensor.hot & (sensor.dark_current * longest - usual > 10 * spread)
    dead = sensor.dead
    must = {(int(x), int(y)) for y, x in zip(*np.nonzero(hot | dead), strict=True)}
    real = {(int(x), int(y)) for y, x in zip(*np.nonzero(sensor.hot | sensor.dead), strict=True)}
    return {"defects": len(must), "missed": len(must - named), "false": len(named - real)}


def bracket_trial(model: SensorModel, seed: int) -> dict[str, Any]:
    sensor = SimulatedSensor(model, SIDE, SIDE, seed, "bench")
    rng = np.random.default_rng((seed, 2))
    assumed, pairs = nominal(model), []
    for _ in range(4):
        scene = light(True, rng) * model.white_electrons
        shots = [
            sensor.expose(scene * amount * np.exp(0.01 * rng.standard_normal()), 0.25 * amount, 1.0, rng)
            for amount in (1 / 16, 1 / 2, 4.0)
        ]
        for short, long in pairwise(shots):
            pair = brackets.compare(long, short, assumed.black, assumed.white)
            if pair is not None:
                pairs.append(pair)
    pooled = brackets.pooled(pairs, assumed.white - float(assumed.black.mean()))
    row: dict[str, Any] = {"determined": pooled.transfer is not None}
    if pooled.transfer is not None:
        value, sigma = brackets.gain(pooled.transfer)
        row["gain"] = (value / model.gain - 1, (value - model.gain) / sigma)
        read = brackets.read_noise(pooled.transfer)
        if read is not None:
            # Brackets cannot part photosites from rows and from the fixed pattern of the dark.
            true = float(np.sqrt(model.read_noise**2 + model.row_noise**2))
            row["read_noise"] = (read[0] / true - 1, (read[0] - true) / read[1])
    shift = assumed.black + pooled.black - np.ravel(model.black)
    row["black"] = (float(np.abs(shift).max()), float(shift[0] / pooled.black_error[0]))
    if pooled.plateau is not None:
        top = end(model)
        row["ceiling"] = (
            pooled.plateau.level / top - 1,
            (pooled.plateau.level - top) / pooled.plateau.scatter,
        )
    line = straightness(pooled.levels, float(pooled.black_error.mean()) / assumed.white)
    if line is not None:
        row |= {
            "linear": line.linear,
            "nonlinearity": (line.share, (line.share - model.nonlinearity) / line.error),
        }
    return row


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Worst and typical errors, and how often the interval holds the truth."""
    out: dict[str, Any] = {"trials": len(rows)}
    for name in (
        "gain",
        "read_noise",
        "row_noise",
        "prnu",
        "dsnu",
        "dark_current",
        "black",
        "ceiling",
        "nonlinearity",
    ):
        errors = np.array([row[name] for row in rows if name in row])
        if len(errors):
            out[name] = {
                "cases": len(errors),
                "worst": float(np.abs(errors[:, 0]).max()),
                "rms": float(np.sqrt((errors[:, 0] ** 2).mean())),
                "bias": float(errors[:, 0].mean()),
                "inside": float((np.abs(errors[:, 1]) <= 1.96).mean()),
            }
    for name in ("defects", "missed", "false"):
        if name in rows[0]:
            out[name] = sum(row[name] for row in rows)
    judged = [row["linear"] for row in rows if row.get("linear") is not None]
    return out | {"linear": sum(judged), "linear_cases": len(judged)}


def rows(
    what: str, measured: Callable[[SensorModel, int], dict[str, Any]], model: SensorModel, count: int
) -> list[Any]:
    """Trials 0 to count - 1, those of an earlier run that was stopped from its file."""
    file = WORK / "sensor.jsonl"
    finished = {
        (row["what"], row["seed"]): row["row"] for row in (store.read_lines(file) if file.exists() else [])
    }
    trials = []
    for seed in range(count):
        if (what, seed) not in finished:
            finished[what, seed] = measured(model, seed)
            store.make_folder(WORK)
            store.append_line(file, {"what": what, "seed": seed, "row": finished[what, seed]})
        trials.append(finished[what, seed])
    return trials


def run(quick: bool) -> dict[str, Any]:
    count, few, many = (4, 3, 3) if quick else (20, 6, 50)
    bent = replace(_PLAIN, nonlinearity=0.02)
    models = KINDS | {BENT: bent}

    def number(name: str) -> int:
        return many if name in ("12 bits, ISO 100", BENT) else few

    return {
        "flats": {
            name: summary(rows(f"flats, {name}", trial, model, count)) for name, model in models.items()
        },
        "brackets": {
            name: summary(rows(f"brackets, {name}", bracket_trial, model, number(name)))
            for name, model in models.items()
        },
    }


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Sensors from darks and flats, and from brackets",
        "",
        "`python -m bench.calibration.light.sensor --write`: 256x256 photosites, 16 darks at 3 times, 4 "
        "flats at 8 exposures; "
        "worst error of all trials, and of how many the 95 % interval holds the truth. "
        f"{words(result['machine'])}.",
    ]
    for title, tables, named in (
        ("From darks and flats", result["flats"], FIELDS),
        ("From brackets", result["brackets"], FIELDS[:4]),
    ):
        head = ["sensor", "trials", *(text for _, text, _ in named), "called linear"]
        if "darks" in title:
            head += ["defects", "missed", "false per 1e5"]
        lines += ["", f"## {title}", "", f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
        for name, column in tables.items():
            cells = [name, str(column["trials"])]
            for field, _, scale in named:
                errors = column.get(field)
                cells.append(
                    "-"
                    if errors is None
                    else f"{scale * errors['worst']:.2g} ({100 * errors['inside']:.0f} % in)"
                )
            cells.append(f"{column['linear']} of {column['linear_cases']}")
            if "defects" in column:
                false = column["false"] / (column["trials"] * SIDE**2) * 1e5
                cells += [str(column["defects"]), str(column["missed"]), f"{false:.2g}"]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    options = arguments(__doc__).parse_args()
    result = run(options.quick) | {"machine": machine()}
    deliver(options, "sensor", result, report(result))


if __name__ == "__main__":
    main()
