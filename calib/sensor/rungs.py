"""Ladder rungs of the sensors' measurements."""

from collections.abc import Mapping
from itertools import chain
from typing import Literal

from calib.sensor.measure import MeasuredSensor
from imaging.and_list import and_list
from imaging.sensor.sensor_calibration import Measured, SensorCalibration
from imaging.session.records import Rung

Field = Literal["gain", "read_noise", "prnu", "dsnu", "dark_current"]

NAMES = frozenset(
    {
        "sensor_noise",
        "sensor_black",
        "sensor_ceiling",
        "sensor_pattern",
        "sensor_dark_current",
        "sensor_defects",
        "sensor_linearity",
        "sensor_falloff",
    }
)


def rungs(measured: Mapping[str, MeasuredSensor], stated: int, total: int) -> tuple[Rung, ...]:
    """One rung for each quantity of the sensors whose RAW is available; empty without RAW.

    stated: cameras whose files name their noise, of all.
    """
    if not measured:
        return ()
    at = [sensor for sensors in measured.values() for sensor in sensors.at]
    missing = "".join(f"; {words}" for sensors in measured.values() for words in sensors.missing)
    return (
        _noise(at, stated, total, missing),
        _black(measured),
        _ceiling(measured),
        _pattern(at),
        _one(at, "sensor_dark_current", "dark_current", "electrons/s", "darks of several times"),
        _defects(at),
        _linearity(at),
        _falloff(measured),
    )


def _values(at: list[SensorCalibration], field: Field) -> list[Measured]:
    return [value for sensor in at if (value := getattr(sensor, field)) is not None]


def _sources(values: list[Measured]) -> str:
    return and_list(dict.fromkeys(value.source for value in values))


def _noise(at: list[SensorCalibration], stated: int, total: int, missing: str) -> Rung:
    gains, reads = _values(at, "gain"), _values(at, "read_noise")
    if not gains and not stated:
        return _not(
            "sensor_noise",
            "gain and read noise are not known: the files do not name them (NoiseProfile), nothing measures "
            f"them, and the merge falls back on plain sums{missing}",
        )
    if not gains:
        return Rung(
            name="sensor_noise",
            taken=stated > 0,
            reason=f"gain and read noise as the files of {stated} of {total} cameras say (NoiseProfile); not "
            f"measured, and the merge falls back on plain sums for the others{missing}",
        )
    worst = max(gains, key=lambda one: one.sigma / one.value)
    read = max((one.sigma / one.value for one in reads if one.value > 0), default=float("inf"))
    words = f"; read noise to {100 * read:.2g} %" if reads else "; read noise is not determined"
    return Rung(
        name="sensor_noise",
        taken=True,
        gain=worst.value,
        standard_error=worst.sigma,
        unit="DN/electron, the least certain gain",
        reason=f"gain measured by photon transfer from {_sources(gains)}{words}{missing}",
    )


def _black(measured: Mapping[str, MeasuredSensor]) -> Rung:
    shifts = [
        (abs(level.value - float(stated)), level)
        for sensors in measured.values()
        for sensor, nominal in zip(sensors.at, sensors.nominal, strict=False)
        for level, stated in zip(chain(*(sensor.black or ())), nominal.black, strict=False)
    ]
    if not shifts:
        return _not(
            "sensor_black", "black level as the files state: darks or overlapping exposures would measure it"
        )
    far, level = max(shifts, key=lambda pair: pair[0])
    source = _sources([one for _, one in shifts])
    reason = f"black of each CFA site from {source}, against what the files say"
    return Rung(
        name="sensor_black",
        taken=True,
        gain=far,
        standard_error=level.sigma,
        unit="DN at most",
        reason=reason,
    )


def _ceiling(measured: Mapping[str, MeasuredSensor]) -> Rung:
    ends = [
        (sensor.ceiling, nominal.white)
        for sensors in measured.values()
        for sensor, nominal in zip(sensors.at, sensors.nominal, strict=False)
        if sensor.ceiling is not None
    ]
    if not ends:
        return _not("sensor_ceiling", "white level as the files say: nothing is overexposed enough to test")
    ceiling, white = min(ends, key=lambda pair: pair[0].value / pair[1])
    return Rung(
        name="sensor_ceiling",
        taken=ceiling.value < white - 1,
        gain=100 * (ceiling.value / white - 1),
        standard_error=100 * ceiling.sigma / white,
        unit="% from the white level of the files",
        reason=f"overexposed photosites end at {ceiling.value:.0f} DN, the files say {white:.0f}",
    )


def _pattern(at: list[SensorCalibration]) -> Rung:
    response, dark = _values(at, "prnu"), _values(at, "dsnu")
    if not response and not dark:
        return _not("sensor_pattern", "PRNU and DSNU are not determined: they take flats and darks")
    words = [
        f"{name} {scale * max(v.value for v in values):.3g} {unit}"
        for name, values, scale, unit in (("PRNU", response, 100, "%"), ("DSNU", dark, 1, "electrons"))
        if values
    ]
    worst = (response or dark)[0]
    return Rung(
        name="sensor_pattern",
        taken=bool(response),
        gain=worst.value,
        standard_error=worst.sigma,
        unit="PRNU, relative" if response else "electrons of DSNU",
        reason=f"fixed pattern: {', '.join(words)} at most",
    )


def _one(at: list[SensorCalibration], name: str, field: Field, unit: str, needs: str) -> Rung:
    values = _values(at, field)
    what = field.replace("_", " ")
    if not values:
        return _not(name, f"{what} is not determined: it takes {needs}")
    worst = max(values, key=lambda one: one.value)
    reason = f"{what} from {_sources(values)}"
    return Rung(
        name=name,
        taken=True,
        gain=worst.value,
        standard_error=worst.sigma,
        unit=f"{unit} at most",
        reason=reason,
    )


def _defects(at: list[SensorCalibration]) -> Rung:
    lists = [sensor.defects for sensor in at if sensor.defects is not None]
    if not lists:
        return _not("sensor_defects", "defect photosites were not looked for: that takes darks or flats")
    kinds = [defect.kind for defects in lists for defect in defects]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in ("hot", "dead", "noisy"))
    return Rung(
        name="sensor_defects",
        taken=bool(kinds),
        gain=float(len(kinds)),
        unit="photosites of all cameras",
        reason=f"{counts}; they are left out of the merge and of training",
    )


def _linearity(at: list[SensorCalibration]) -> Rung:
    lines = [(sensor.nonlinearity, sensor.linear) for sensor in at if sensor.nonlinearity is not None]
    if not lines:
        return _not("sensor_linearity", "RAW is taken as linear and not tested: no two exposures overlap")
    worst, linear = max(lines, key=lambda line: abs(line[0].value))
    bent = sum(one is False for _, one in lines)
    return Rung(
        name="sensor_linearity",
        taken=bent > 0,
        gain=100 * worst.value,
        standard_error=100 * worst.sigma,
        unit="% of the signal missing at white",
        reason="RAW is linear"
        if linear and not bent
        else f"RAW of {bent} sensors bends, and is straightened by a parabola when it is read",
    )


def _falloff(measured: Mapping[str, MeasuredSensor]) -> Rung:
    falls = [sensors.falloff for sensors in measured.values() if sensors.falloff is not None]
    if not falls:
        return _not("sensor_falloff", "no flats measure the fall of light towards the corners")
    worst = max(falls, key=lambda fall: fall.corner_error)
    return Rung(
        name="sensor_falloff",
        taken=True,
        gain=100 * sum(worst.vignetting),
        standard_error=100 * worst.corner_error,
        unit="% at the corner",
        reason="vignetting as the flats show it, in place of that from overlaps",
    )


def _not(name: str, reason: str) -> Rung:
    return Rung(name=name, taken=False, reason=reason)
