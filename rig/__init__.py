"""The face of the toolkit: the `rig` command, its reports and its public API.

    import rig

    rig.capture_simulated("demo", "S", seed=0)
    rig.calibrate("S")
    folder = rig.reconstruct("S", quality="draft")
    print(rig.evaluate(folder)["hdr_psnr_mu_aligned"])
    scene = rig.open_scene(folder)
    light = scene.radiance(scene.views[0].splat_camera)

Paths may be `str` or `Path`; what goes wrong is a `RigError` of one sentence. `import rig` loads nothing
heavy: each name below is fetched from its stage when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calib.calibrate import calibrate
    from capture.check import check, repair
    from capture.connected_rig import capture_rig
    from capture.photos import import_photos
    from capture.rigfile import read_rig_file
    from capture.simulated import capture_simulated
    from imaging.calibration import read_calibration
    from imaging.dng import write_dng
    from imaging.errors import InputError, PartialError, RigError, StorageError
    from imaging.exposure import Exposure
    from imaging.exr import read_exr, write_exr
    from imaging.merging import merge_session
    from imaging.mosaic import RawMosaic
    from imaging.photo import read_photo
    from imaging.raw import read_raw
    from imaging.session import Session
    from recon.evaluate import evaluate
    from recon.reconstruct import reconstruct
    from recon.renders import render
    from recon.scene import Scene, open_scene
    from recon.splat import SplatCamera
    from recon.trade import sweep
    from rig.report.calibration_page import calibration_report
    from rig.report.reconstruction_page import reconstruction_report
    from rig.report.trade_page import trade_report

__all__ = [
    "Exposure",
    "InputError",
    "PartialError",
    "RawMosaic",
    "RigError",
    "Scene",
    "Session",
    "SplatCamera",
    "StorageError",
    "calibrate",
    "calibration_report",
    "capture_rig",
    "capture_simulated",
    "check",
    "evaluate",
    "import_photos",
    "merge_session",
    "open_scene",
    "read_calibration",
    "read_exr",
    "read_photo",
    "read_raw",
    "read_rig_file",
    "reconstruct",
    "reconstruction_report",
    "render",
    "repair",
    "sweep",
    "trade_report",
    "write_dng",
    "write_exr",
]

_HOMES = {
    "Exposure": "imaging.exposure",
    "InputError": "imaging.errors",
    "PartialError": "imaging.errors",
    "RawMosaic": "imaging.mosaic",
    "RigError": "imaging.errors",
    "Scene": "recon.scene",
    "Session": "imaging.session",
    "SplatCamera": "recon.splat",
    "StorageError": "imaging.errors",
    "calibrate": "calib.calibrate",
    "calibration_report": "rig.report.calibration_page",
    "capture_rig": "capture.connected_rig",
    "capture_simulated": "capture.simulated",
    "check": "capture.check",
    "evaluate": "recon.evaluate",
    "import_photos": "capture.photos",
    "merge_session": "imaging.merging",
    "open_scene": "recon.scene",
    "read_calibration": "imaging.calibration",
    "read_exr": "imaging.exr",
    "read_photo": "imaging.photo",
    "read_raw": "imaging.raw",
    "read_rig_file": "capture.rigfile",
    "reconstruct": "recon.reconstruct",
    "reconstruction_report": "rig.report.reconstruction_page",
    "render": "recon.renders",
    "repair": "capture.check",
    "sweep": "recon.trade",
    "trade_report": "rig.report.trade_page",
    "write_dng": "imaging.dng",
    "write_exr": "imaging.exr",
}


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
    return sorted({*globals(), *_HOMES, "__version__"})
