"""Reading of a file by ExifTool."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

needs_exiftool = pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")


def exiftool(path: Path, *options: str) -> dict[str, object]:
    done = subprocess.run(
        ["exiftool", "-j", *options, str(path)], capture_output=True, check=True, timeout=60
    )
    return json.loads(done.stdout)[0]
