"""Light from far away: what a trial says of it, and what it gains or costs in a training.

    python -m bench.real.far_field [--quick] [--json] [--write] [--seeds 1] [--work FOLDER]
        [--sets banana,...]

Real photographs as of `bench.real.light`, and the two yards of `bench.foreign.yards` as RAW brackets. Each is
trained as decided, and the other way (preset draft, 200 px wide, 10,000 Gaussians, 400 iterations; yards as
their bench has them). Rows are kept in FOLDER. --quick: banana.
"""

import argparse
from pathlib import Path
from typing import Any

from bench.foreign import yards
from bench.real.light import REAL, session_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache
from recon.decide.overrides import Overrides
from recon.decide.request import TrainingRequest
from recon.decide.steps.far_field import NAME
from recon.measure.evaluate import evaluate
from recon.reconstruct import reconstruct
from recon.result.model import read_model

SIZE = {"width": 200, "gaussians": 10_000, "iterations": 400}
YARD_SIZE = {"width": yards.WIDTH, "gaussians": yards.GAUSSIANS, "iterations": yards.ITERATIONS}


def row_of(place: Path, size: dict[str, int], seed: int) -> dict[str, Any]:
    """Rung of the far field, and held-out figures without it and with it."""
    row: dict[str, Any] = {}
    for asked in (None, True, False):
        if asked is not None and str(asked) in row:
            continue  # as decided
        overrides = Overrides(environment=asked).model_copy(update=size)
        request = TrainingRequest(quality="draft", seed=seed, overrides=overrides, name="scene", replace=True)
        folder = reconstruct(place, request)
        model = read_model(folder)
        rung = next(one for one in model.rungs if one.name == NAME)
        if asked is None:
            row["rung"] = rung.model_dump(mode="json")
        figures = evaluate(folder).known()
        keys = ("hdr_psnr_mu_p999", "stops_bright") if "hdr_psnr_mu_p999" in figures else ("ldr_psnr_oe",)
        row[str(rung.taken)] = {key: figures[key] for key in keys}
    return row


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """A row of each set and seed."""
    cache, rows = Cache(options.work / "real-far-field.jsonl"), []
    for name in options.sets:
        for seed in range(options.seeds):

            def train(name: str = name, seed: int = seed) -> dict[str, Any]:
                if name in REAL:
                    return row_of(session_of(name, options.work), SIZE, seed)
                return row_of(yards.session(options.work, name, "raw"), YARD_SIZE, seed)

            rows.append({"set": name, "seed": seed} | cache.get(f"{name} {seed}", train))
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Light from far away, by a trial",
        "",
        f"`python -m bench.real.far_field --write`: preset draft, {SIZE['width']} px, {SIZE['gaussians']:,} "
        f"Gaussians, {SIZE['iterations']} iterations; yards as in their own table. "
        f"{words(result['machine'])}.",
        "",
        "What the trial says, dB of its residuals, and held-out photographs without and with it, dB: of "
        "codes, of yards of the mu-law of light over the 99.9th percentile, in brackets stops in the "
        "brightest hundredth.",
        "",
        "| set | seed | looked through | trial | taken | without | with |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        rung = row["rung"]
        share = next((word for word in rung["reason"].split() if word.isdigit()), "0")
        trial = "none" if rung["gain"] is None else f"{rung['gain']:+.2f} ± {rung['standard_error']:.2f}"
        cells = [row["set"], str(row["seed"]), f"{share} %", trial, "yes" if rung["taken"] else "no"]
        for taken in ("False", "True"):
            values = list(row[taken].values())
            cells.append(f"{values[0]:.2f}" + (f" ({values[1]:.2f})" if len(values) > 1 else ""))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=",".join([*REAL, *yards.YARDS]), help="by commas")
    options = parser.parse_args()
    options.sets = ("banana",) if options.quick else tuple(options.sets.split(","))
    result = measure(options)
    deliver(options, "real_far_field", result, report(result))


if __name__ == "__main__":
    main()
