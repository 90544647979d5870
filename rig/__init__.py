"""The face of the toolkit: the `rig` command, its reports and its public API.

    import rig

    rig.capture_simulated("demo", "S", seed=0)
    session = rig.Session.open("S")
    rig.calibrate(session)
    scene = rig.reconstruct(session, quality="draft")
    print(rig.evaluate(scene).hdr_psnr_mu_aligned)
    light = scene.render("0000/cam0")      # linear radiance, float32 [H, W, 3]
    scene.at(2.0).save("brighter.png")     # two stops above middle grey, as a display shows it

A session or a scene can be given wherever a path to its folder can, as `str` or `Path`. What comes back is
a typed record. `on_progress` is called with what is being done, the steps that are done, and all of them (0
where their number is not known); `on_message` with lines that stay. What goes wrong is a `RigError` of one
sentence. `import rig` loads nothing heavy: each name below is fetched from its stage when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calib.calibrate import calibrate
    from calib.exports.merge_session import Merged, merge
    from calib.request import CalibrationRequest
    from capture.capture_rig import capture_rig
    from capture.check.check import CheckReport, RepairReport, check, repair
    from capture.imports.photos import ImportResult, import_photos
    from capture.imports.request import ImportRequest
    from capture.record.capture_run import CaptureResult
    from capture.record.source import CaptureRequest, RigRequest
    from capture.rigfile.rigfile import read_rig_file
    from capture.simulated import capture_simulated
    from drivers.discovery import ConnectedCamera
    from imaging.errors import InputError, PartialError, RigError, StorageError
    from imaging.exposure import Exposure
    from imaging.files.exr import read_exr, write_exr
    from imaging.files.photo import read_photo
    from imaging.files.raw import read_raw
    from imaging.files.tiff.dng import write_dng
    from imaging.mosaic import RawMosaic
    from imaging.session.calibration import CalibrationRecord, read_calibration
    from recon.decide.request import TrainingRequest
    from recon.exports.export import Exported, export
    from recon.exports.hand_over import HandOver, hand_over
    from recon.exports.request import ExportRequest
    from recon.measure.evaluate import evaluate
    from recon.measure.evaluation import Evaluation
    from recon.rendering.render import render
    from recon.rendering.request import RenderRequest
    from recon.result.scene import Scene, open_scene
    from recon.scene.gaussians import Gaussians
    from recon.splat import SplatCamera, rasterize
    from recon.trade import Trade, trade_sweep
    from rig.facade import find_cameras, reconstruct
    from rig.report.pages.calibration import calibration_report
    from rig.report.pages.reconstruction import reconstruction_report
    from rig.report.pages.trade import trade_report
    from rig.session import Session

__all__ = [
    "CalibrationRecord",
    "CalibrationRequest",
    "CaptureRequest",
    "CaptureResult",
    "CheckReport",
    "ConnectedCamera",
    "Evaluation",
    "ExportRequest",
    "Exported",
    "Exposure",
    "Gaussians",
    "HandOver",
    "ImportRequest",
    "ImportResult",
    "InputError",
    "Merged",
    "PartialError",
    "RawMosaic",
    "RenderRequest",
    "RepairReport",
    "RigError",
    "RigRequest",
    "Scene",
    "Session",
    "SplatCamera",
    "StorageError",
    "Trade",
    "TrainingRequest",
    "calibrate",
    "calibration_report",
    "capture_rig",
    "capture_simulated",
    "check",
    "evaluate",
    "export",
    "find_cameras",
    "hand_over",
    "import_photos",
    "merge",
    "open_scene",
    "rasterize",
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
    "CalibrationRecord": "imaging.session.calibration",
    "CalibrationRequest": "calib.request",
    "CaptureRequest": "capture.record.source",
    "CaptureResult": "capture.record.capture_run",
    "CheckReport": "capture.check.check",
    "ConnectedCamera": "drivers.discovery",
    "Evaluation": "recon.measure.evaluation",
    "ExportRequest": "recon.exports.request",
    "Exported": "recon.exports.export",
    "Exposure": "imaging.exposure",
    "HandOver": "recon.exports.hand_over",
    "Gaussians": "recon.scene.gaussians",
    "ImportRequest": "capture.imports.request",
    "ImportResult": "capture.imports.photos",
    "InputError": "imaging.errors",
    "Merged": "calib.exports.merge_session",
    "PartialError": "imaging.errors",
    "RawMosaic": "imaging.mosaic",
    "RenderRequest": "recon.rendering.request",
    "RepairReport": "capture.check.check",
    "RigRequest": "capture.record.source",
    "RigError": "imaging.errors",
    "Scene": "recon.result.scene",
    "Session": "rig.session",
    "SplatCamera": "recon.splat",
    "StorageError": "imaging.errors",
    "Trade": "recon.trade",
    "TrainingRequest": "recon.decide.request",
    "calibrate": "calib.calibrate",
    "calibration_report": "rig.report.pages.calibration",
    "capture_rig": "capture.capture_rig",
    "capture_simulated": "capture.simulated",
    "check": "capture.check.check",
    "evaluate": "recon.measure.evaluate",
    "export": "recon.exports.export",
    "find_cameras": "rig.facade",
    "hand_over": "recon.exports.hand_over",
    "import_photos": "capture.imports.photos",
    "merge": "calib.exports.merge_session",
    "open_scene": "recon.result.scene",
    "rasterize": "recon.splat",
    "read_calibration": "imaging.session.calibration",
    "read_exr": "imaging.files.exr",
    "read_photo": "imaging.files.photo",
    "read_raw": "imaging.files.raw",
    "read_rig_file": "capture.rigfile.rigfile",
    "reconstruct": "rig.facade",
    "reconstruction_report": "rig.report.pages.reconstruction",
    "render": "recon.rendering.render",
    "repair": "capture.check.check",
    "trade_report": "rig.report.pages.trade",
    "trade_sweep": "recon.trade",
    "write_dng": "imaging.files.tiff.dng",
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
