"""The Khronos Group's glTF-Validator, run by Node."""

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

MODULES = Path(__file__).parents[1] / ".judges" / "node_modules"
"""Place where `.ci/run` puts it."""
NODE = shutil.which("node")
SCRIPT = (
    "require('gltf-validator').validateBytes(new Uint8Array(require('fs').readFileSync(process.argv[1])))"
    ".then(report => console.log(JSON.stringify(report.issues)))"
)

needs_gltf_validator = pytest.mark.skipif(
    NODE is None or not (MODULES / "gltf-validator").is_dir(),
    reason="npm install --prefix .judges gltf-validator is not there, or Node",
)


def issues_of(path: Path) -> list[dict[str, Any]]:
    """List the messages of the validator on a file; severity 0 is an error, 1 a warning."""
    command = [str(NODE), "-e", SCRIPT, str(path)]
    environment = os.environ | {"NODE_PATH": str(MODULES)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    messages: list[dict[str, Any]] = json.loads(done.stdout)["messages"]
    return messages
