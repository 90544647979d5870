"""The scale of light of a calibration, from readings of luminance and the pictures that show what was
read."""

import hashlib
import json
from collections.abc import Iterable, Sequence

import numpy as np

from calib.light.vignetting import NOTICED, NOTICED_IN_SHEEN
from calib.luminance.area import AreaLight, area_light
from calib.luminance.chart_greys import chart_light, chart_views
from calib.luminance.scale import Comparison, combined
from imaging.errors import CalibrationError
from imaging.session.calibration import CalibrationRecord
from imaging.session.luminance import LuminanceReading, LuminanceScale, ReadingEvidence
from imaging.session.records import Rung
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId

RUNG = "luminance"
AIM = 0.01
"""Relative, of every reading: the meter and the marked area see not quite the same place from the same
side."""
FALLOFF_UNKNOWN = 0.3
"""Relative error at the corner of a lens whose falloff is unknown."""
GAIN_UNKNOWN = 0.05
"""Relative: cameras of one model that nothing has compared."""


def scaled(
    session: Session,
    record: CalibrationRecord,
    readings: Sequence[LuminanceReading] | None,
    earlier: LuminanceScale | None,
) -> CalibrationRecord:
    """Add the scale of its light to the record, and the rung on its source.

    Args:
        session: Session of the record.
        record: Calibration without a scale, or with one that is replaced.
        readings: Readings of luminance or illuminance; None: those of `earlier`; empty: the scale is dropped.
        earlier: Scale of a calibration of the session before; None if there is no such scale.

    Returns:
        The record; where the scale cannot be measured it has none, and the rung gives the reason.

    Raises:
        InputError: A file is missing or damaged.
    """
    rungs = tuple(rung for rung in record.rungs if rung.name != RUNG)
    bare = record.model_copy(update={"luminance": None, "rungs": rungs})
    earlier_readings = () if earlier is None else earlier.readings
    if readings is None:
        readings = [one.reading for one in earlier_readings]
    if not readings:
        return bare
    try:
        _require_shots(session, earlier_readings, readings)
        scale = measure_scale(session, bare, readings)
    except CalibrationError as error:
        lost = Rung(name=RUNG, taken=False, reason=str(error).removesuffix("."))
        return bare.model_copy(update={"rungs": (*rungs, lost)})
    return bare.model_copy(update={"luminance": scale, "rungs": (*rungs, _rung(scale))})


def measure_scale(
    session: Session, record: CalibrationRecord, readings: Sequence[LuminanceReading]
) -> LuminanceScale:
    """The scale of a record's light in cd/m2; CalibrationError when a reading cannot be looked up or they
    contradict each other, InputError for a damaged file.
    """
    known: list[float] = []
    lights: list[AreaLight] = []
    views: list[tuple[ViewId, ...]] = []
    # A reading is of an area that somebody pointed at, or of the chart's white patch.
    for reading in readings:
        if reading.view is not None and reading.area is not None:
            light = area_light(session, record, reading.view, reading.area)
            views.append((reading.view,))
            lights.append(light)
            known.append(reading.luminance or reading.known(1.0) * (reading.reflectance or 1.0))
        else:
            views.append(chart_views(record))
            light, white = chart_light(session, record)
            lights.append(light)
            known.append(reading.known(white))
    # Cameras that were never compared may differ by their gains, which widens the error.
    cameras = _cameras(session, record, {view.camera for shown in views for view in shown})
    apart = GAIN_UNKNOWN if not _compared(record) and len(cameras) > 1 else 0.0
    errors = [
        float(np.sqrt(light.error**2 + AIM**2 + _falloff_error(record, light.radius, shown) ** 2 + apart**2))
        for light, shown in zip(lights, views, strict=True)
    ]
    scale = combined(
        [
            Comparison(str(reading), stated, light.light, error, reading.error, reading.source)
            for reading, stated, light, error in zip(readings, known, lights, errors, strict=True)
        ]
    )
    return LuminanceScale(
        value=scale.value,
        error=scale.error,
        cameras=cameras,
        readings=tuple(
            ReadingEvidence(
                reading=reading,
                views=shown,
                luminance=stated,
                light=light.light,
                light_error=error,
                shots_sha256=_shots_sha256(session, shown),
                residual=float(residual),
            )
            for reading, shown, stated, light, error, residual in zip(
                readings, views, known, lights, errors, scale.residuals, strict=True
            )
        ),
    )


def _require_shots(
    session: Session, evidence: Iterable[ReadingEvidence], readings: Sequence[LuminanceReading]
) -> None:
    """CalibrationError if a reading of an earlier run was of pictures that the session has no more."""
    for one in evidence:
        if one.reading in readings and _shots_sha256(session, one.views) != one.shots_sha256:
            raise CalibrationError(
                f"the shots of {', '.join(map(str, one.views))}, where the reading was taken, have changed: "
                "read it again and give it with --luminance."
            )


def _shots_sha256(session: Session, views: Sequence[ViewId]) -> str:
    groups = brackets(session.shots("scene"))
    hashes = [[shot.sha256 for shot in groups.get(view, [])] for view in views]
    return hashlib.sha256(json.dumps(hashes).encode()).hexdigest()


def _compared(record: CalibrationRecord) -> bool:
    """Return whether the sensitivities of the cameras were compared by points that they share."""
    return any(rung.name == "camera_gain" for rung in record.rungs)


def _cameras(session: Session, record: CalibrationRecord, read: set[str]) -> tuple[str, ...]:
    """The cameras that the scale holds for; not those whose light has no colour, and so no luminance."""
    coloured = {
        camera.name
        for camera in record.cameras
        if camera.camera_from_rec709 is not None or session.camera(camera.name).kind != "raw"
    }
    placed = {view.camera for view in record.views} & coloured
    if _compared(record) and read & placed:
        read = read | placed
    return tuple(camera.name for camera in record.cameras if camera.name in read)


def _falloff_error(record: CalibrationRecord, radius: float, views: Sequence[ViewId]) -> float:
    """Relative, of what gain and vignetting of the cameras were divided out at a radius."""
    rungs = {rung.name: rung for rung in record.rungs}
    tried = [rungs[name] for name in ("vignetting", "camera_gain") if name in rungs]
    if any(rung.gain is not None for rung in tried):
        by_side = rungs.get("vignetting_by_side")
        return NOTICED_IN_SHEEN if by_side is not None and by_side.taken else NOTICED
    if all(any(record.camera(view.camera).vignetting) for view in views):
        return NOTICED  # flats, or a calibration that was given
    return FALLOFF_UNKNOWN * radius**2


def _rung(scale: LuminanceScale) -> Rung:
    names = [str(one.reading) for one in scale.readings]
    worst = max(abs(one.residual) for one in scale.readings)
    agree = f", which agree to {100 * worst:.2g} %" if len(names) > 1 else ""
    count = "a reading" if len(names) == 1 else f"{len(names)} readings"
    return Rung(
        name=RUNG,
        taken=True,
        gain=scale.value,
        standard_error=scale.error,
        unit="cd/m² for light of 1",
        reason=f"the scale of light, from {count} at {', '.join(names)}{agree}; it holds for "
        f"{', '.join(scale.cameras)}",
        parameters=1,
    )
