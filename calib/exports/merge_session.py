"""Merging of a session's brackets into linear EXR files, one for each camera at each frame.

    OUT/<frame>/<camera>.exr    R, G, B; sigma.R, sigma.G, sigma.B; mask
    OUT/<frame>/<camera>.<band>.exr    the same, grey, of each band where a filter wheel changes them

Light is in one unit for the whole rig and session: signal (1 = white) per second of exposure scale, with the
gains and the vignetting of the calibration divided out. Values are light times one factor for the whole
session, whatever part of it is merged, so that its median opens as middle grey; header and merge.json state
it, and `light = value / factor`. Each file stands for itself: see `calib.exports.merged_view`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from calib.exports.merged_view import UNIT, MergedView, assumed_response, exposure_scales, merge_view
from calib.exports.middle_grey import exposure_factor
from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.calibration import CalibrationRecord, Response, is_stale, read_calibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId
from imaging.spaces import Space

SUMMARY = "merge.json"


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
    *,
    frame: int | None = None,
    camera: str | None = None,
    space: Space = "rec709",
    exposure: float | None = None,
    on_progress: Progress = unreported,
) -> Merged:
    """Merge the brackets of the scene into EXR files under `out`.

    Exposures, responses, gains and colour are those of the session's calibration, if it has one. Existing
    files with the same inputs are kept.

    Args:
        session: Session, or its folder.
        out: Folder of the files.
        frame: Frame to merge; None: all.
        camera: Camera to merge; None: all.
        space: Primaries of the files.
        exposure: Stops of the values above the light; None: as many as show the median of the session as
            middle grey, to the nearest stop.
        on_progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The merged views, and the factor of their values.

    Raises:
        InputError: There is no such bracket, a file is missing or damaged, exposures are unknown, the
            calibration is damaged or older than the shots, or the colour of a camera is unknown in a space
            other than Rec.709.
        StorageError: The disk refuses.
    """
    if exposure is not None and not abs(exposure) <= STOPS_MOST:
        raise InputError(f"light cannot be written {exposure} stops brighter: give -60 to 60.")
    calibration = _calibration(Path(session))
    session, out = Path(session), Path(out)
    opened = Session.open(session)
    every = brackets(opened.shots("scene"))
    groups = {
        view: shots
        for view, shots in every.items()
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
        factor = exposure_factor(opened, _exposed(opened, every, calibration), calibration, on_progress)
    placed = () if calibration is None else calibration.views
    developed = {view.id: view.white_balance for view in placed}
    results = []
    parts = [
        (view, out / f"{view}{suffix}.exr", band_shots)
        for view, shots in groups.items()
        for suffix, band_shots in _of_one_band(shots).items()
    ]
    for done, (view, path, shots) in enumerate(parts):
        on_progress("merging", done, len(parts))
        band_shots = None if calibration is None else calibration.camera(view.camera)
        white = developed.get(view) if opened.camera(view.camera).kind == "ldr" else None
        scales = None if calibration is None else calibration.exposure_scale
        scale = None if calibration is None else calibration.luminance
        absolute = (scale.value, scale.error) if scale and view.camera in scale.cameras else None
        results.append(
            merge_view(opened, path, view, shots, band_shots, scales, space, factor, absolute, white)
        )
    on_progress("merging", len(parts), len(parts))
    store.write_json(out / SUMMARY, {"schema_version": 1, "units": UNIT, "exposure_factor": factor})
    return Merged(out, tuple(results), factor, calibration)


def _exposed(
    session: Session, groups: Mapping[ViewId, Sequence[ShotRecord]], calibration: CalibrationRecord | None
) -> dict[ViewId, list[tuple[ShotRecord, float, Response]]]:
    """Brackets with the exposure scale and the response of each shot."""
    scales = None if calibration is None else calibration.exposure_scale
    exposed = {}
    for view, shots in groups.items():
        kind = session.camera(view.camera).kind
        response = assumed_response(kind) if calibration is None else calibration.camera(view.camera).response
        with suppress(InputError):  # what has no exposure has no light, and is refused where it is merged
            k = exposure_scales(session, shots, scales)
            exposed[view] = [(shot, scale, response) for shot, scale in zip(shots, k, strict=True)]
    return exposed


def _of_one_band(shots: Sequence[ShotRecord]) -> dict[str, list[ShotRecord]]:
    """A bracket by what its file's name ends with: nothing, or the band where there are several."""
    bands = dict.fromkeys(shot.band for shot in shots)
    if len(bands) == 1:
        return {"": list(shots)}
    return {f".{band}": [shot for shot in shots if shot.band == band] for band in bands}


def _calibration(session: Path) -> CalibrationRecord | None:
    """The calibration of a session if it has one; InputError if it is damaged or older than the shots."""
    if not (session / "calibration" / "calibration.json").exists():
        return None
    record = read_calibration(session)
    if is_stale(session, record):
        raise InputError(
            f"{session / 'calibration'} is older than the shots of the session: run `rig calibrate`."
        )
    return record
