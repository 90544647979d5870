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
    from calib.exports.merge_session import merge_session
    from capture.check.check import check, repair
    from capture.connected_rig import capture_rig
    from capture.imports.photos import import_photos
    from capture.rigfile.rigfile import read_rig_file
    from capture.simulated import capture_simulated
    from imaging.errors import InputError, PartialError, RigError, StorageError
    from imaging.exposure import Exposure
    from imaging.files.dng import write_dng
    from imaging.files.exr import read_exr, write_exr
    from imaging.files.photo import read_photo
    from imaging.files.raw import read_raw
    from imaging.mosaic import RawMosaic
    from imaging.session.calibration import read_calibration
    from imaging.session.session import Session
    from recon.evaluate import evaluate
    from recon.reconstruct import reconstruct
    from recon.render import render
    from recon.result.scene import Scene, open_scene
    from recon.splat import SplatCamera
    from recon.trade import trade_sweep
    from rig.report.pages.calibration import calibration_report
    from rig.report.pages.reconstruction import reconstruction_report
    from rig.report.pages.trade import trade_report

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
    "trade_report",
    "trade_sweep",
    "write_dng",
    "write_exr",
]

_HOMES = {
    "Exposure": "imaging.exposure",
    "InputError": "imaging.errors",
    "PartialError": "imaging.errors",
    "RawMosaic": "imaging.mosaic",
    "RigError": "imaging.errors",
    "Scene": "recon.result.scene",
    "Session": "imaging.session.session",
    "SplatCamera": "recon.splat",
    "StorageError": "imaging.errors",
    "calibrate": "calib.calibrate",
    "calibration_report": "rig.report.pages.calibration",
    "capture_rig": "capture.connected_rig",
    "capture_simulated": "capture.simulated",
    "check": "capture.check.check",
    "evaluate": "recon.evaluate",
    "import_photos": "capture.imports.photos",
    "merge_session": "calib.exports.merge_session",
    "open_scene": "recon.result.scene",
    "read_calibration": "imaging.session.calibration",
    "read_exr": "imaging.files.exr",
    "read_photo": "imaging.files.photo",
    "read_raw": "imaging.files.raw",
    "read_rig_file": "capture.rigfile.rigfile",
    "reconstruct": "recon.reconstruct",
    "reconstruction_report": "rig.report.pages.reconstruction",
    "render": "recon.render",
    "repair": "capture.check.check",
    "trade_report": "rig.report.pages.trade",
    "trade_sweep": "recon.trade",
    "write_dng": "imaging.files.dng",
    "write_exr": "imaging.files.exr",
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
