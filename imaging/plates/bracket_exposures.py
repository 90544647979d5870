"""Exposure and response of the shots of a bracket, with a calibration and without one."""

from collections.abc import Mapping, Sequence

from imaging.errors import InputError
from imaging.optics.dial_settings import meant
from imaging.session.calibration import CalibrationRecord, Response
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def response_of(session: Session, camera: str, calibration: CalibrationRecord | None) -> Response:
    """Response of a camera: of the calibration, else assumed."""
    if calibration is not None:
        return calibration.camera(camera).response
    if session.camera(camera).kind == "ldr":
        return Response(kind="srgb", evidence="sRGB assumed: there is no calibration")
    return Response(kind="linear", evidence="taken as linear: there is no calibration")


def exposure_scales(
    session: Session, shots: Sequence[ShotRecord], scales: Mapping[str, float] | None
) -> list[float]:
    """Exposure scales of a bracket: of the calibration, else of the labels; 1 where a single shot has
    none.

    Nominal shutter times of a still camera count as the exact powers of two.
    """
    if scales is not None and all(shot.file in scales for shot in shots):
        return [scales[shot.file] for shot in shots]
    exposures = [shot.exposure for shot in shots]
    known = [exposure for exposure in exposures if exposure is not None]
    if len(known) == len(shots):
        exact = meant(known)
        return [exact[exposure].scale for exposure in known]
    if len(shots) == 1:
        return [1.0]
    blank = shots[exposures.index(None)]
    raise InputError(
        f"{session.folder}: {blank.file} has no exposure, so its bracket cannot be merged: run "
        "`rig calibrate`, or import it with a list of exposures."
    )
