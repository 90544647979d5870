"""The face of the toolkit: the `rig` command, its reports and its public API.

    import rig

    rig.capture_simulated("demo", Path("S"), seed=0)
    rig.calibrate(Path("S"))
    scene = rig.reconstruct(Path("S"), method="nh-3dgs", quality="draft")
    print(rig.evaluate(scene)["hdr_psnr_mu_aligned"])

`import rig` loads nothing heavy: each name below is fetched from its stage when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calib.calibrate import calibrate as calibrate

    from capture.check import check as check
    from capture.check import repair as repair
    from capture.photos import import_photos as import_photos
    from capture.simulated import capture_simulated as capture_simulated
    from imaging.calibration import read_calibration as read_calibration
    from imaging.dng import write_dng as write_dng
    from imaging.errors import (
        InputError as InputError,
    )
    from imaging.errors import (
        PartialError as PartialError,
    )
    from imaging.errors import (
        RigError as RigError,
    )
    from imaging.errors import (
        StorageError as StorageError,
    )
    from imaging.exposure import Exposure as Exposure
    from imaging.exr import read_exr as read_exr
    from imaging.exr import write_exr as write_exr
    from imaging.mosaic import RawMosaic as RawMosaic
    from imaging.photo import read_photo as read_photo
    from imaging.raw import read_raw as read_raw
    from imaging.session import Session as Session
    from recon.evaluate import evaluate as evaluate
    from recon.reconstruct import reconstruct as reconstruct
    from recon.renders import render as render

_HOMES = {
    "capture_simulated": "capture.simulated",
    "import_photos": "capture.photos",
    "check": "capture.check",
    "repair": "capture.check",
    "calibrate": "calib.calibrate",
    "reconstruct": "recon.reconstruct",
    "evaluate": "recon.evaluate",
    "render": "recon.renders",
    "Session": "imaging.session",
    "read_calibration": "imaging.calibration",
    "Exposure": "imaging.exposure",
    "RawMosaic": "imaging.mosaic",
    "read_raw": "imaging.raw",
    "write_dng": "imaging.dng",
    "read_photo": "imaging.photo",
    "read_exr": "imaging.exr",
    "write_exr": "imaging.exr",
    "RigError": "imaging.errors",
    "InputError": "imaging.errors",
    "StorageError": "imaging.errors",
    "PartialError": "imaging.errors",
}

__all__ = [
    "Exposure",
    "InputError",
    "PartialError",
    "RawMosaic",
    "RigError",
    "Session",
    "StorageError",
    "calibrate",
    "capture_simulated",
    "check",
    "evaluate",
    "import_photos",
    "read_calibration",
    "read_exr",
    "read_photo",
    "read_raw",
    "reconstruct",
    "render",
    "repair",
    "write_dng",
    "write_exr",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("hdr-rig")
    if name not in _HOMES:
        raise AttributeError(f"module 'rig' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES, "__version__"])
