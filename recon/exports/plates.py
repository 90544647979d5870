"""Plates of a hand-over: the photographs of each view merged, as shot and without the lens, and the lens.

Light is in the unit of the renders beside them, merged by the calibration that the scene was trained on.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from imaging.files import store
from imaging.files.exr.camera import camera_attributes
from imaging.files.exr.reading import read_exr
from imaging.files.exr.writing import ExrValue, write_exr
from imaging.files.opencv_lens import write_opencv_lens
from imaging.files.tags.exr_colour import INTEROP_ID, UNKNOWN
from imaging.optics.lens import Lens
from imaging.plates.bracket_exposures import exposure_scales
from imaging.plates.lens_maps import redistorting, undistorting, warped, write_stmap
from imaging.plates.merged_view import PlateFormat, merge_view
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord
from imaging.session.paths import session_of
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId
from recon.result.model import CALIBRATION, SceneView, read_own_calibration
from recon.result.scene import Scene

PLATES, AS_SHOT, LENSES = "plates", "plates_as_shot", "lenses"
_SAME_LIGHT = 0.1
"""Stops by which a plate may differ from its render without a word."""
_OF_BOTH = (
    "rig:exposureFactor",
    "rig:view",
    "rig:units",
    "rig:colour",
    "whiteLuminance",
    "capDate",
    "software",
)
"""Attributes of a plate as shot that its straight one has, too."""


@dataclass(frozen=True)
class Plates:
    """Files that were written, and what could not be, as part of a sentence; sizes: (width, height),
    px, by camera.
    """

    files: list[Path]
    notes: tuple[str, ...] = ()
    sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)


def write_plates(folder: Path, scene: Scene, factor: float, progress: Progress) -> Plates:
    """FOLDER/plates_as_shot and plates, CAMERA.FRAME.exr each, and lenses: STMaps both ways, and YAML.

    InputError for a photograph that is damaged.
    """
    place = session_of(scene.folder)
    if place is None or not (scene.folder / CALIBRATION).is_file():
        return Plates([], ("plates: the photographs are not in a session beside the scene",))
    if scene.record.bands:
        return Plates([], ("plates: its photographs are of bands, which have no colour",))
    session, calibration = Session.open(place), read_own_calibration(scene.folder)
    shots = brackets(session.shots("scene"))
    files: list[Path] = []
    lenses: dict[str, Lens] = {}
    missing, brighter = 0, 0.0
    for done, view in enumerate(scene.views):
        progress("merging plates", done, len(scene.views))
        if not _there(session, shots, view.id):
            missing += 1
            continue
        files += _write(folder, session, view, shots[view.id], calibration, factor, lenses)
        brighter = max(brighter, _stops_apart(scene, session, shots[view.id], calibration))
    for name, lens in lenses.items():
        files += _write_lens(folder / LENSES, name, lens)
    notes = []
    if missing:
        notes.append(f"plates of {missing} views, whose photographs are not in the session")
    if brighter > _SAME_LIGHT:
        notes.append(
            "in the renders, the exposure of each photograph: the scene has display values as they are, so "
            f"that plates are up to {brighter:.2g} stops brighter or darker"
        )
    sizes = {name: (lens.width, lens.height) for name, lens in lenses.items()}
    return Plates(files, tuple(notes), sizes)


def _stops_apart(
    scene: Scene, session: Session, shots: list[ShotRecord], calibration: CalibrationRecord
) -> float:
    """Stops between a photograph's exposure and the one that its scene reads all display values at."""
    display = scene.record.display
    if display is None or display.developed:
        return 0.0
    scales = exposure_scales(session, shots, calibration.exposure_scale)
    return min(abs(math.log2(k / display.k)) for k in scales)


def _there(session: Session, shots: Mapping[ViewId, list[ShotRecord]], view: ViewId) -> bool:
    return view in shots and all(session.file(shot).is_file() for shot in shots[view])


def _write(
    folder: Path,
    session: Session,
    view: SceneView,
    shots: list[ShotRecord],
    calibration: CalibrationRecord,
    factor: float,
    lenses: dict[str, Lens],
) -> list[Path]:
    """The two plates of a view; the lens of its camera, at the size of the plate, goes into `lenses`."""
    name = f"{view.camera}.{view.frame:04d}.exr"
    shot, straight = folder / AS_SHOT / name, folder / PLATES / name
    merge_view(session, shot, view.id, shots, calibration, PlateFormat("rec709", factor))
    image = read_exr(shot)
    light = np.dstack([image.channels[letter] for letter in "RGB"])
    lens = lenses.setdefault(view.camera, view.lens.resized(light.shape[1], light.shape[0]))
    drawn, known = warped(light, undistorting(lens))
    planes = {letter: drawn[..., index] for index, letter in enumerate("RGB")} | {"A": known}
    header = {key: image.attributes[key] for key in _OF_BOTH if key in image.attributes}
    stated: dict[str, ExrValue] = {k: value for k, value in header.items() if isinstance(value, str | float)}
    stated |= camera_attributes(view.cam_from_world.matrix(), lens.matrix, (lens.width, lens.height))
    primaries = None if image.attributes.get(INTEROP_ID) == UNKNOWN else "rec709"
    write_exr(straight, planes, primaries=primaries, attributes=stated)
    return [shot, straight]


def _write_lens(folder: Path, name: str, lens: Lens) -> list[Path]:
    maps = {
        folder / f"{name}.undistort.exr": undistorting(lens),
        folder / f"{name}.redistort.exr": redistorting(lens),
    }
    for path, places in maps.items():
        write_stmap(path, places, path.stem.rpartition(".")[2])
    store.make_folder(folder)
    write_opencv_lens(folder / f"{name}.yaml", lens)
    return [*maps, folder / f"{name}.yaml"]
