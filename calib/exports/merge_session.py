"""Merging of a session's brackets into linear EXR files, one for each camera at each frame.

    OUT/<frame>/<camera>.exr    R, G, B; sigma.R, sigma.G, sigma.B; mask
    OUT/<frame>/<camera>.<band>.exr    the same, grey, of each band where a filter wheel changes them

Light is in one unit for the whole rig and session: signal (1 = white) per second of exposure scale, with the
gains and the vignetting of the calibration divided out. Values are light times the one factor of the session
(`imaging.plates.middle_grey`), which renders of its scenes have too; header and merge.json state it, and
`light = value / factor`. Each file stands for itself: see `imaging.plates.merged_view`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from calib.exports.request import MergeRequest
from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.plates.merged_view import UNIT, MergedView, PlateFormat, merge_view
from imaging.plates.middle_grey import exposure_factor
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord, is_stale, read_calibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets

SUMMARY = "merge.json"
_DEFAULTS = MergeRequest()


STOPS_MOST = 60.0
"""Largest brightening or darkening of the light, stops."""


@dataclass(frozen=True)
class Merged:
    """Result of merging a session's brackets.

    Attributes:
        folder: Folder of the files.
        views: One entry for each bracket.
        exposure_factor: Factor of the values in the files on the light.
        calibration: Calibration that was used; None: labels were taken as they are, and photographs as sRGB.
    """

    folder: Path
    views: tuple[MergedView, ...]
    exposure_factor: float
    calibration: CalibrationRecord | None


@checked
def merge(
    session: str | PathLike[str],
    out: str | PathLike[str],
    request: MergeRequest = _DEFAULTS,
    *,
    on_progress: Progress = unreported,
    **options: object,
) -> Merged:
    """Merge the brackets of the scene into EXR files under `out`.

    Exposures, responses, gains and colour are those of the session's calibration, if it has one. Existing
    files with the same inputs are kept.

    Args:
        session: Session, or its folder.
        out: Folder of the files.
        request: Options.
        on_progress: Callback for the current step, the steps done, and all of them.
        options: Options by name, in place of those of `request`.

    Returns:
        The merged views, and the factor of their values.

    Raises:
        InputError: There is no such bracket, a file is missing or damaged, exposures are unknown, the
            calibration is damaged or older than the shots, or the colour of a camera is unknown in a space
            other than Rec.709.
        StorageError: The disk refuses.
    """
    frame, camera, exposure = request.frame, request.camera, request.exposure
    if exposure is not None and not abs(exposure) <= STOPS_MOST:
        raise InputError(f"light cannot be written {exposure} stops brighter: give -60 to 60.")
    calibration = current_calibration(Path(session))
    session, out = Path(session), Path(out)
    opened = Session.open(session)
    groups = {
        view: shots
        for view, shots in brackets(opened.shots("scene")).items()
        if frame in (None, view.frame) and camera in (None, view.camera)
    }
    if not groups:
        wanted = "".join(
            f" {name} {value}"
            for name, value in (("of camera", camera), ("at frame", frame))
            if value is not None
        )
        raise InputError(f"{session} has no shot of the scene{wanted}: name one that `rig check` lists.")
    store.require_writable(out)
    if exposure is not None:
        factor = 2.0**exposure
    else:
        factor = exposure_factor(opened, calibration, on_progress)
    plate, results = PlateFormat(request.space, factor, request.exr), []
    parts = [
        (view, out / f"{view}{suffix}.exr", band_shots)
        for view, shots in groups.items()
        for suffix, band_shots in of_one_band(shots).items()
    ]
    for done, (view, path, shots) in enumerate(parts):
        on_progress("merging", done, len(parts))
        results.append(merge_view(opened, path, view, shots, calibration, plate))
    on_progress("merging", len(parts), len(parts))
    store.write_json(out / SUMMARY, {"schema_version": 1, "units": UNIT, "exposure_factor": factor})
    return Merged(out, tuple(results), factor, calibration)


def of_one_band(shots: Sequence[ShotRecord]) -> dict[str, list[ShotRecord]]:
    """A bracket by what its file's name ends with: nothing, or the band where there are several."""
    bands = dict.fromkeys(shot.band for shot in shots)
    if len(bands) == 1:
        return {"": list(shots)}
    return {f".{band}": [shot for shot in shots if shot.band == band] for band in bands}


def current_calibration(session: Path) -> CalibrationRecord | None:
    """The calibration of a session if it has one; InputError if it is damaged or older than the shots."""
    if not (session / "calibration" / "calibration.json").exists():
        return None
    record = read_calibration(session)
    if is_stale(session, record):
        raise InputError(
            f"{session / 'calibration'} is older than the shots of the session: run `rig calibrate`."
        )
    return record
