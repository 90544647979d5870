"""Every module can be imported on systems without `fcntl`, `resource` or `sched_getaffinity`."""

import subprocess
import sys
from pathlib import Path

ROOMS = ("imaging", "drivers", "capture", "calib", "recon", "rig")
PROGRAM = """
import builtins, importlib, os, pkgutil, sys
rooms, posix = {rooms!r}, {{"fcntl", "resource", "termios", "pwd", "grp", "posix"}}
given = builtins.__import__

def elsewhere(name, globals=None, *rest, **options):
    # Other packages know where they are; only this project's own imports are refused.
    if name in posix and (globals or {{}}).get("__name__", "").partition(".")[0] in rooms:
        raise ModuleNotFoundError(f"no module named {{name}}")
    return given(name, globals, *rest, **options)

builtins.__import__ = elsewhere
for name in ("sched_getaffinity", "posix_fadvise", "sysconf"):
    delattr(os, name)
for room in rooms:
    for module in pkgutil.walk_packages(importlib.import_module(room).__path__, room + "."):
        if not module.name.startswith("recon.splat.gpu"):  # Triton is for Linux alone
            importlib.import_module(module.name)
from imaging.compute.cores import available_cores
from imaging.compute.memory import available
from imaging.session.lock import sole_writer
assert available_cores() == os.cpu_count() and available() > 0
with sole_writer(importlib.import_module("pathlib").Path(sys.argv[1])):
    pass
"""


def test_every_module_can_be_imported_elsewhere(tmp_path: Path) -> None:
    program = PROGRAM.format(rooms=ROOMS)
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, timeout=200
    )
    assert (done.returncode, done.stderr) == (0, "")
