"""Reading of a file by ExifTool."""

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

needs_exiftool = pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")


def exiftool(path: Path, *options: str) -> dict[str, object]:
    return exiftool_of_each([path], *options)[0]


def exiftool_of_each(paths: Sequence[Path], *options: str) -> list[dict[str, object]]:
    """By one call, since a call takes longer than its files."""
    done = subprocess.run(
        ["exiftool", "-j", *options, *map(str, paths)], capture_output=True, check=True, timeout=60
    )
    return json.loads(done.stdout)
