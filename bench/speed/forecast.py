"""Forecasts of `rig calibrate` and `rig reconstruct` against the clock, on a machine that is quiet.

    python -m bench.speed.forecast [--quick] [--json] [--write] [--work FOLDER] [--sets demo,sceaux,...]

The commands run as a user runs them, in processes of their own, on the demo's session and on real photographs
under RIG_DATA at the widths of bench/real/light.py: calibrated once, trained as a draft and by the standard
preset. What each says before it begins is read from its lines; the clock runs from Enter to its end, the
report included. The share of the cores that other work leaves is measured before each. --quick: sceaux,
calibrated and as a draft.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from bench.real.light import REAL, scaled
from bench.support.record import WORK, arguments, deliver, machine, words
from imaging.compute.cores import available_cores
from imaging.compute.free_share import free_share

SETS = ("demo", "sceaux", "monstree", "fox", "banana")
UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0}
SAID = re.compile(r"this takes (?:at most )?(.*?)(?: to (.*?))? in all")


def seconds(text: str) -> float:
    """Seconds of a text like `2 min 05 s`."""
    return sum(float(number) * UNITS[unit] for number, unit in re.findall(r"([\d.]+) (h|min|s)", text))


def run_rig(*command: str) -> dict[str, Any]:
    """Run a command of rig: what it forecasts, s; the clock's and the processor's seconds."""
    free = free_share(available_cores())
    began = time.monotonic()
    words_of = [sys.executable, "-m", "rig", *command]
    with subprocess.Popen(words_of, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as done:
        assert done.stderr is not None
        lines = done.stderr.read()
        _, status, usage = os.wait4(done.pid, 0)
        done.returncode = os.waitstatus_to_exitcode(status)
    clock = time.monotonic() - began
    said = SAID.search(lines)
    return {
        "command": " ".join(word for word in command if not Path(word).is_absolute()),
        "exit": done.returncode,
        "forecast": None if said is None else [seconds(part) for part in said.groups() if part],
        "clock": clock,
        "processor": usage.ru_utime + usage.ru_stime,
        "free": free,
    }


def session_of(name: str, work: Path) -> Path:
    """A session of a set, not calibrated."""
    folder = work / f"forecast-{name}"
    shutil.rmtree(folder, ignore_errors=True)
    if name == "demo":
        run_rig("capture", "--sim", "demo", str(folder / "S"))
    else:
        scaled(name, folder / "photographs")
        run_rig("import", str(folder / "photographs"), str(folder / "S"))
    return folder / "S"


def measure(options: argparse.Namespace) -> dict[str, Any]:
    names = ["sceaux"] if options.quick else options.sets.split(",")
    rows = []
    for name in names:
        session = str(session_of(name, options.work))
        qualities = ("draft",) if options.quick else ("draft", "standard")
        rows.append({"set": name} | run_rig("calibrate", session))
        rows += [
            {"set": name} | run_rig("reconstruct", session, "--quality", quality) for quality in qualities
        ]
    return {"machine": machine(), "rows": rows}


def table(result: dict[str, Any]) -> str:
    lines = [
        "# What was said to take how long",
        "",
        f"`python -m bench.speed.forecast --write`. {words(result['machine'])}.",
        "",
        "Seconds of the clock as forecast before a command began, where it takes more than half a minute,",
        "and as it took. free: share of the cores that other work left when it began.",
        "",
        "| set | command | forecast, s | clock, s | within | processor s | free, % |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        said = row["forecast"]
        # One number is that of "at most".
        least = 0.0 if said is None or len(said) == 1 else min(said)
        within = "" if said is None else "yes" if least <= row["clock"] <= max(said) else "no"
        forecast = "none" if said is None else " to ".join(f"{part:.0f}" for part in said)
        ended = "" if row["exit"] == 0 else f" (exit {row['exit']})"
        lines.append(
            f"| {row['set']} | {row['command']}{ended} | {forecast} | {row['clock']:.0f} | {within} | "
            f"{row['processor']:.0f} | {100 * row['free']:.0f} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, default=WORK)
    parser.add_argument("--sets", default=",".join(SETS), help=f"of {', '.join((*REAL, 'demo'))}")
    options = parser.parse_args()
    result = measure(options)
    deliver(options, "durations", result, table(result))


if __name__ == "__main__":
    main()
