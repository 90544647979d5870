"""Cost of importing the common ground, in any order."""

import subprocess
import sys

import pytest


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=120
    )


def test_the_package_itself_is_free() -> None:
    heavy = ["numpy", "scipy", "torch", "cv2", "pydantic", "rawpy", "OpenEXR", "tifffile", "PIL", "pycolmap"]
    done = run(f"import sys, imaging, imaging.errors; print([m for m in {heavy!r} if m in sys.modules])")
    assert (done.stdout, done.stderr) == ("[]\n", "")


MODULES = ["sensor.cfa", "colour.spaces", "metrics", "sensor.mosaic"]
MODULES += [f"files.{name}" for name in ("tiff.dng", "exr", "photo", "raw", "store")]
MODULES += [f"session.{name}" for name in ("records", "session")]


@pytest.mark.parametrize("order", [MODULES, MODULES[::-1]], ids=["forwards", "backwards"])
def test_no_module_loads_torch_or_colmap(order: list[str]) -> None:
    imports = "; ".join(f"import imaging.{module}" for module in order)
    done = run(f"import sys; {imports}; print([m for m in ('torch', 'pycolmap', 'cv2') if m in sys.modules])")
    assert (done.stdout, done.stderr) == ("[]\n", "")
