"""Whole ways from photographs to an evaluated scene, by this checkout and by an earlier one, in turns.

    python -m bench.speed.whole_ways --before CHECKOUT [--sets castle,banana,...] [--quick] [--json] [--write]
        [--seeds 3] [--work FOLDER]

Each step is a command of the checkout's own `rig` in a process of its own: import (or a simulated
capture, seconds not counted), `rig calibrate` once, `rig reconstruct --quality draft` by seed, and `rig
evaluate` of all held-out views (not counted). lego has given poses. Seconds are of the processor, of a
training to its report. A first calibration and training on a toy, not counted, compile the kernels of both.
Finished rows are kept in FOLDER.
"""

import argparse
import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

from bench.support.record import arguments, commit_of, deliver, machine, words
from bench.support.trial import Cache

SETS = {
    "castle": ("sceaux", 1280),
    "banana": ("banana", 1280),
    "fox": ("fox/images", 640),
    "lego": ("lego", 400),
    "demo": ("", 320),
    "gallery": ("", 320),
}
"""Folder in RIG_DATA, where the set is of photographs, and width of its trainings, px."""
HERE = Path(__file__).parents[2]


def rig(checkout: Path, *options: str, makes: Path | None = None) -> tuple[float, str]:
    """Run a command of a checkout; return its processor seconds and what it printed.

    A calibration that leaves views out ends with an exit code other than 0 all the same.
    """
    before = _used()
    done = subprocess.run(
        [sys.executable, "-m", "rig", *options],
        cwd=checkout,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode and not (makes and makes.is_file()):
        sys.exit(f"bench/speed/whole_ways.py: `rig {' '.join(options)}` failed in {checkout}.")
    return _used() - before, done.stdout


def _used() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def calibrated(checkout: Path, name: str, work: Path) -> dict[str, Any]:
    """Make the session of a set by a checkout and calibrate it; return its seconds."""
    folder, _ = SETS.get(name, ("", 0))
    shutil.rmtree(work, ignore_errors=True)
    if folder:
        rig(checkout, "import", str(Path(os.environ["RIG_DATA"]) / folder), str(work))
    else:
        rig(checkout, "capture", str(work), "--sim", name)
    if name == "lego":
        return {"seconds": 0.0}
    made = work / "calibration" / "calibration.json"
    return {"seconds": rig(checkout, "calibrate", str(work), makes=made)[0]}


def trained(checkout: Path, name: str, session: Path, seed: int) -> dict[str, Any]:
    """Train a draft by a checkout; return its seconds and the quality of all held-out views."""
    width = SETS[name][1]
    options = ["--quality", "draft", "--set", f"width={width}", "--seed", str(seed), "--name", f"way-{seed}"]
    seconds, _ = rig(checkout, "reconstruct", str(session), *options, "--replace")
    _, said = rig(checkout, "evaluate", str(session / "reconstructions" / f"way-{seed}"), "--json")
    metrics = json.loads(said)["scenes"][0]["metrics"]
    key = next(key for key in ("hdr_psnr_mu_aligned", "ldr_psnr_oe", "raw_psnr") if metrics.get(key))
    return {"seconds": seconds, "db": metrics[key]}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    sets = options.sets.split(",") if options.sets else list(SETS)
    seeds = 1 if options.quick else options.seeds
    checkouts = {"before": options.before.resolve(), "after": HERE}
    cache = Cache(options.work / "whole_ways.jsonl")
    commits = {when: commit_of(checkout) for when, checkout in checkouts.items()}
    for when, checkout in checkouts.items():
        session = options.work / f"way-warm-{when}"
        calibrated(checkout, "toy", session)
        rig(checkout, "reconstruct", str(session), "--quality", "draft", "--replace", "--name", "warm")
    rows = []
    for name in sets:
        sessions = {when: options.work / f"way-{commits[when]}-{name}" for when in checkouts}
        row: dict[str, Any] = {"set": name, "trainings": []}
        for when, checkout in checkouts.items():
            work = partial(calibrated, checkout, name, sessions[when])
            row[when] = cache.get(f"{name} {commits[when]} calibrated", work)["seconds"]
        for seed in range(seeds):
            for when, checkout in checkouts.items():
                work = partial(trained, checkout, name, sessions[when], seed)
                got = cache.get(f"{name} {commits[when]} {seed}", work)
                row["trainings"].append({"when": when, "seed": seed} | got)
        rows.append(row)
    return {"machine": machine(), "before": commits["before"], "seeds": seeds, "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# Whole ways, before and after",
        "",
        f"`python -m bench.speed.whole_ways --before CHECKOUT --write`, CHECKOUT at {result['before']}; "
        f"drafts, seeds: {result['seeds']}. {words(result['machine'])}.",
        "",
        "Processor seconds of calibration, of a training with its report (mean over seeds), and of both. dB "
        "of all held-out views, of simulated ones those of true light in mu-law; behind +-, the standard "
        "error of the difference over seeds.",
        "",
        "| set | width | calibrate: before | after | train: before | after | both: before | after | ratio "
        "| dB: before | after | gain |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        seconds, db = (
            {
                when: [one[key] for one in row["trainings"] if one["when"] == when]
                for when in ("before", "after")
            }
            for key in ("seconds", "db")
        )
        train = {when: statistics.mean(seconds[when]) for when in seconds}
        both = {when: row[when] + train[when] for when in train}
        gains = [after - before for before, after in zip(db["before"], db["after"], strict=True)]
        error = f" +- {statistics.stdev(gains) / len(gains) ** 0.5:.2f}" if len(gains) > 1 else ""
        cells = [row["set"], str(SETS[row["set"]][1])]
        cells += [f"{row[when]:.0f}" for when in train] + [f"{train[when]:.0f}" for when in train]
        cells += [f"{both[when]:.0f}" for when in both] + [f"{both['after'] / both['before']:.2f}"]
        cells += [f"{statistics.mean(db[when]):.2f}" for when in db]
        cells += [f"{statistics.mean(gains):+.2f}{error}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=3)
    parser.add_argument("--before", type=Path, required=True, help="a checkout of the commit to compare with")
    parser.add_argument("--sets", help="of " + ",".join(SETS))
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "whole_ways", result, report(result))


if __name__ == "__main__":
    main()
