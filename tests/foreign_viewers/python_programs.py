"""Programs by others that are Python modules, each in an environment of its own in `.judges`."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.foreign_viewers.viewers import MODULES

SCRIPTS = Path(__file__).parent / "programs"


def needs_python(program: str) -> pytest.MarkDecorator:
    """Skip where a program is not installed."""
    python = _python(program)
    return pytest.mark.skipif(not python.is_file(), reason=f"{python} is not there: see .ci/run")


def run(program: str, script: str, *arguments: Path, **settings: str) -> None:
    """Run a script of `programs/` by the Python of a program, with settings in its environment."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [str(part) for part in (_python(program), SCRIPTS / script, *arguments)]
    done = subprocess.run(
        command, env=environment | settings, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def _python(program: str) -> Path:
    return MODULES.parent / program / "bin" / "python"
