"""PLY files of `rig export` as Mitsuba draws them, against the light that they are of."""

import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from imaging.files.exr.reading import read_exr
from recon.exports.export import export
from recon.result.scene import Scene
from tests.foreign_viewers.python_programs import run
from tests.foreign_viewers.wall import FOCAL, HEIGHT, RADIANCES, WIDTH, front, strips

LIBRARIES = [
    os.environ.get("DRJIT_LIBLLVM_PATH", ""),
    *(str(path) for part in (19, 18, 17, 16) for path in Path("/usr/lib").glob(f"*/libLLVM-{part}.so")),
]
LLVM = next((path for path in LIBRARIES if path and Path(path).exists()), None)
"""The compiler of Mitsuba, whose versions before 16 it cannot use."""
pytest.importorskip("mitsuba")
pytestmark = pytest.mark.skipif(LLVM is None, reason="no libLLVM of 16 or later: apt-get install libllvm19")


def test_the_radiances_of_the_wall_are_rendered(wall: Scene, tmp_path: Path) -> None:
    """Light of a linear file, and of display values with `srgb_primitives`, which end at white."""
    place = np.linalg.inv(front().cam_from_world) @ np.diag([-1.0, -1.0, 1.0, 1.0])  # +x is left in Mitsuba
    asked = []
    for linear in (True, False):
        path = tmp_path / f"{linear}.ply"
        export(wall, path, linear=linear, exposure=0.0)
        stand = {"to_world": place.tolist(), "fov": math.degrees(2 * math.atan(WIDTH / 2 / FOCAL))}
        size = {"width": WIDTH, "height": HEIGHT}
        out = str(path.with_suffix(".exr"))
        asked.append({"file": str(path), "srgb": not linear, "out": out, **stand, **size})
    (tmp_path / "asked.json").write_text(json.dumps(asked))
    run(sys.executable, "mitsuba_picture.py", tmp_path / "asked.json", DRJIT_LIBLLVM_PATH=str(LLVM))
    light = np.array(RADIANCES)[:, None] * np.ones(3)
    upper, lower = strips(read_exr(tmp_path / "True.exr").rgb())
    assert np.abs(np.log2(upper / light)).max() < 0.02
    _, ours = strips(wall.render(front()))
    assert np.abs(np.log2(lower / ours)).max() < 0.08  # next to brighter rows
    upper, _ = strips(read_exr(tmp_path / "False.exr").rgb())
    assert np.abs(np.log2(upper / light.clip(max=1)))[1:].max() < 0.05
