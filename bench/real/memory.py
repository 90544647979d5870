"""The memory that a training was said to take, and took: the peak of a process of its own.

    python -m bench.real.memory [--sets castle,monstree,lego] [--quick] [--json] [--write] [--seeds 1]
        [--work FOLDER]

Sets as in `bench/real/compare.py`. Few iterations: nothing grows with them but the Gaussians, which start at
half of their number and reach it at 60 % of any length.
"""

import argparse
import json
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

from bench.real.compare import SETS, session_of
from bench.support.record import arguments, deliver, machine, words
from bench.support.trial import Cache

SETTINGS = ((320, 20_000), (640, 40_000), (1280, 80_000), (320, 300_000))
"""Width, px, and Gaussians: those of the three presets, and many on small pictures."""
ITERATIONS = 40
_RUN = f"""
import json, resource, sys
from recon.decide.overrides import Overrides
import recon.reconstruct as stage
from recon.decide.memory_need import need
needs = []
stage.need = lambda *views: needs.append(need(*views)) or needs[0]
session, width, gaussians, seed = sys.argv[1], *map(int, sys.argv[2:])
overrides = Overrides(
    width=width, gaussians=gaussians, iterations={ITERATIONS}, refine="none", environment=False
)
stage.reconstruct(
    session, quality="best", overrides=overrides, seed=seed, name="memory", shelf="memory", replace=True
)
peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({{"forecast": needs[0].total, "peak": peak}}))
"""


def measured(session: Path, width: int, gaussians: int, seed: int) -> dict[str, Any]:
    """What a training said of its memory, and its peak in bytes."""
    command = [sys.executable, "-c", _RUN, str(session), str(width), str(gaussians), str(seed)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command[3:])} failed:\n{done.stderr[-2000:]}")
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return row


def measure(options: argparse.Namespace) -> dict[str, Any]:
    cache = Cache(options.work / "memory.jsonl")
    rows = []
    for name in options.sets.split(","):
        session = session_of(name, options.work)
        for width, gaussians in SETTINGS[:1] if options.quick else SETTINGS:
            for seed in range(options.seeds):
                key = f"{name} {width} {gaussians} {seed}"
                row = cache.get(key, partial(measured, session, width, gaussians, seed))
                what = {"set": Path(name).name, "width": width, "gaussians": gaussians, "seed": seed}
                rows.append(what | row)
    return {"machine": machine(), "rows": rows}


def report(result: dict[str, Any]) -> str:
    lines = [
        "# The memory that a training was said to take, and took",
        "",
        f"`python -m bench.real.memory --write`: {ITERATIONS} iterations. Bytes of a Gaussian "
        f"were fitted to castle, monstree and lego, and to no other set. {words(result['machine'])}.",
        "",
        "| set | width, px | Gaussians | forecast, GB | peak, GB | forecast off, % |",
        "|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['set']} | {row['width']} | {row['gaussians']:,} | {row['forecast'] / 1e9:.2f} "
            f"| {row['peak'] / 1e9:.2f} | {100 * (row['forecast'] / row['peak'] - 1):+.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__, seeds=1)
    parser.add_argument("--sets", default=",".join(SETS))
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "memory", result, report(result))


if __name__ == "__main__":
    main()
