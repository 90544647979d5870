"""PlayCanvas's splat-transform, which reads and writes splats and was not written here."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

INSTALLED = Path(__file__).parents[1] / ".judges" / "node_modules" / ".bin"
"""Place where `.ci/run` puts it."""
SPLAT_TRANSFORM = shutil.which("splat-transform", path=f"{INSTALLED}{os.pathsep}{os.environ['PATH']}")

needs_splat_transform = pytest.mark.skipif(
    SPLAT_TRANSFORM is None or shutil.which("node") is None,
    reason="npm install --prefix .judges @playcanvas/splat-transform is not there, or Node",
)


def splat_transform(source: Path, out: Path, *options: str) -> None:
    """Read a file of splats and write it as another."""
    command = [str(SPLAT_TRANSFORM), "--quiet", source.name, *options, str(out)]
    done = subprocess.run(command, cwd=source.parent, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
