"""The coordinates that a scene is in, and each surveyed point beside where the scene has it."""

from collections.abc import Iterable

from imaging.session.calibration import CalibrationRecord
from imaging.session.coordinates import SurveyedPoint, length_text
from rig.report.charts.topic import NOT_DETERMINED, Table
from rig.terminal.text import number

_SOURCES = {
    "survey": "by surveyed points",
    "gps": "by the positions in the photographs",
    "session": "by another session",
}


def coordinate_tables(record: CalibrationRecord) -> Iterable[Table]:
    """Yield what the scene was placed by; nothing where its coordinates are its own."""
    known = record.coordinates
    if known is None:
        return
    unit = "m" if record.unit == "m" else "relative"
    yield Table(
        "Coordinates",
        f"Poses and points are in {known.described}{known.less_offset}, placed {_SOURCES[known.source]}. "
        "Errors are standard errors, of the whole scene.",
        ("#Scale, %", "#Turn, °", f"#Place, {unit}", f"#Misses, rms {unit}", "#Used", "#Left out"),
        (
            (
                "known before" if known.scale_error is None else f"± {number(100 * known.scale_error, 2)}",
                f"± {number(known.rotation_error, 2)}",
                f"± {number(known.position_error, 2)}",
                number(known.rms, 3),
                f"{known.used:,}",
                f"{known.left_out:,}",
            ),
        ),
    )
    if known.points:
        yield Table(
            "Surveyed points",
            "From where each was surveyed to where the scene has it, and from its marks to where the views "
            "should show it.",
            ("Point", "#x", "#y", "#z", "#Off", "#Off, rms px", "#Images", "Used"),
            tuple(_row(point) for point in known.points),
        )


def _row(point: SurveyedPoint) -> tuple[str, ...]:
    axes = [NOT_DETERMINED] * 4
    if point.miss is not None and point.miss_m is not None:
        axes = [_signed(one) for one in point.miss] + [length_text(point.miss_m)]
    pixels = NOT_DETERMINED if point.miss_px is None else number(point.miss_px, 3)
    used = "; ".join(filter(None, ("yes" if point.used else "no", point.reason)))
    return point.name, *axes, pixels, str(len(point.marks)), used


def _signed(value: float) -> str:
    sign = "−" if value < 0 else "+"
    return f"{sign}{length_text(abs(value))}"
