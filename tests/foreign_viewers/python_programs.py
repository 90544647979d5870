"""Programs by others that are Python modules, each run by a script in a process of its own."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.foreign_viewers.viewers import MODULES

BLENDER = MODULES.parent / "blender" / "bin" / "python"
needs_blender = pytest.mark.skipif(not BLENDER.is_file(), reason=f"{BLENDER} is not there: see .ci/run")
SCRIPTS = Path(__file__).parent / "programs"


def run(python: Path | str, script: str, *arguments: Path, **settings: str) -> None:
    """Run a script of `programs/` by a program's Python, with settings in its environment."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(part) for part in (python, SCRIPTS / script, *arguments)]
    done = subprocess.run(
        command, env=environment | settings, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
