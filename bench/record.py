"""What a measurement was made on, and where its table goes."""

import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from imaging import store
from recon import threads

RESULTS = Path(__file__).parent / "results"


def machine() -> dict[str, Any]:
    """What runs, and how busy it is."""
    return {
        "processor": _processor(),
        "threads": threads.thread_count(),
        "load": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        **{name: version(name) for name in ("torch", "numba", "numpy")},
    }


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
