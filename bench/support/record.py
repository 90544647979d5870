"""Shared parts of the scripts: their options, the machine, places of tables."""

import argparse
import json
import os
import platform
import subprocess
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

from imaging.compute import threads
from imaging.files import store

RESULTS = Path(__file__).parents[1] / "results"
WORK = Path(tempfile.gettempdir()) / "hdr-rig-bench"
"""Default folder of sessions and finished rows."""


def arguments(text: str | None, seeds: int | None = None) -> argparse.ArgumentParser:
    """Make a parser with the flags of every script; `text` is the script's docstring.

    seeds: of trainings, by default, whose rows are kept in a folder; None: no such option.
    """
    parser = argparse.ArgumentParser(description=(text or "").splitlines()[0])
    for flag in ("--quick", "--json", "--write"):
        parser.add_argument(flag, action="store_true")
    if seeds is not None:
        parser.add_argument("--seeds", type=int, default=seeds)
        parser.add_argument("--work", type=Path, default=WORK)
    return parser


def deliver(
    options: argparse.Namespace, name: str, result: dict[str, Any], table: str, rows: Any = None
) -> None:
    """Print the result as was asked for; with --write publish its table, and beside it `rows` as JSON."""
    print(json.dumps(result, indent=1) if options.json else table)
    if options.write:
        publish(name, table)
        if rows is not None:
            store.write_json(RESULTS / f"{name}.json", rows)


def machine() -> dict[str, Any]:
    """Return what runs, and how busy it is."""
    return {
        "processor": _processor(),
        "threads": threads.thread_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        **{name: version(name) for name in ("torch", "numba", "numpy")},
    }


def commit_of(checkout: Path) -> str:
    """Return the short name of the commit that a checkout is at."""
    command = ["git", "rev-parse", "--short=8", "HEAD"]
    return subprocess.run(command, cwd=checkout, capture_output=True, text=True, check=True).stdout.strip()


def words(machine: dict[str, Any]) -> str:
    """The machine in half a line."""
    return (
        f"{machine['processor']}, {machine['threads']} threads, load {machine['load']}, Python "
        f"{machine['python']}, torch {machine['torch']}, numba {machine['numba']}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def publish(name: str, table: str) -> None:
    """Write bench/results/NAME.md, and bench/RESULTS.md, which has all of them one after another."""
    store.write_bytes(RESULTS / f"{name}.md", table.encode())
    parts = [path.read_text().rstrip() for path in sorted(RESULTS.glob("*.md"))]
    head = "Every table here was written by the script that it names.\n"
    store.write_bytes(RESULTS.parent / "RESULTS.md", "\n\n".join([head.rstrip(), *parts, ""]).encode())
