"""ETH3D's rigs and photographs (Schöps et al., CVPR 2017), undistorted: poses, by COLMAP's own benchmark.

A scene holds `images/CAMERA/` and the true model in `rig_calibration_undistorted/` or `dslr_...`, which names
images as `CAMERA/FILE`; the cameras of a rig name their files of a moment alike.
"""

from pathlib import Path

from calib.calibrate import calibrate
from capture.imports.layouts.colmap import pose_of_image
from capture.imports.layouts.colmap_files import read_model
from capture.imports.photos import import_photos
from capture.imports.request import ImportRequest
from imaging.errors import CalibrationError, InputError
from imaging.progress import Progress
from imaging.session.session import Session
from recon.measure.protocols import eth3d
from rig.benchmarks.protocol import Choices, Column, Figures, Protocol


def _is_scene(folder: Path) -> bool:
    return (folder / "images").is_dir() and len(_models(folder)) == 1


def _models(folder: Path) -> list[Path]:
    return sorted(folder.glob("*_calibration_undistorted"))


def _run(scene: Path, session: Path, choices: Choices, progress: Progress) -> Figures:
    place = _models(scene)[0]
    true = {
        eth3d.name_of(image.name): pose_of_image(image, place).matrix()
        for image in read_model(place).images.values()
        if image.has_pose
    }
    if len(true) < 2:
        raise InputError(f"{place} has {len(true)} images with a pose: copy the scene again.")
    _import(scene / "images", session, progress)
    try:
        if not (session / "calibration" / "calibration.json").is_file():
            calibrate(session, on_progress=progress)
    except CalibrationError:  # no view was placed, which is a figure
        return eth3d.measure({}, true)
    return eth3d.measure(eth3d.placed_images(session), true)


def _import(images: Path, session: Path, progress: Progress) -> None:
    """A session of the photographs, whose folders are cameras; of a rig where these name all files alike.

    One that has all photographs is kept.
    """
    cameras = [
        frozenset(file.name for file in camera.iterdir() if not file.name.startswith("."))
        for camera in images.iterdir()
        if camera.is_dir() and not camera.name.startswith(".")
    ]
    there = Session.open(session).shots("scene") if (session / "session.json").is_file() else []
    if there and len(there) == sum(map(len, cameras)):
        return
    request = ImportRequest(
        layout="photos", cameras="folder", bracket=1, together="order" if len(set(cameras)) == 1 else "never"
    )
    import_photos(images, session, request, on_progress=progress).require_complete()


ETH3D = Protocol(
    name="ETH3D",
    is_scene=_is_scene,
    run=_run,
    columns={
        "placed": Column("placed %", 1),
        "auc_0.5": Column("AUC 0.5", 1),
        "auc_1": Column("AUC 1", 1),
        "auc_5": Column("AUC 5", 1),
        "auc_10": Column("AUC 10", 1),
    },
    published={
        "GLOMAP, rigs (arXiv 2407.20219, table 2)": {"auc_1": 57.6, "auc_5": 87.2},
        "COLMAP, rigs (the same)": {"auc_1": 45.5, "auc_5": 69.1},
        "Theia, rigs (the same)": {"auc_1": 40.4},
    },
    note="Area, percent, below the share of pairs of images whose relative rotation and direction are within "
    "an angle, up to that many degrees; pairs that are not placed count 180. The published programs knew the "
    "lenses; here they are estimated. Nothing is trained, so --quality and --views change nothing.",
)
