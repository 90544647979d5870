"""The scale of light in cd/m2: each reading beside what the pictures show there."""

from collections.abc import Iterable

from imaging.session.calibration import CalibrationRecord
from imaging.session.luminance import ReadingEvidence
from rig.report.charts.topic import Table, plus_minus


def luminance_tables(record: CalibrationRecord) -> Iterable[Table]:
    """The readings of a calibration whose light has a scale; nothing where it is relative."""
    scale = record.luminance
    if scale is not None:
        yield Table(
            "Scale of light",
            f"Light of 1 is {plus_minus(scale.value, scale.error, 'cd/m²')} (standard error), for "
            f"{', '.join(scale.cameras)}. Each reading beside what the pictures show in its place, and how "
            "far it is from the scale that all of them give.",
            ("Reading", "By", "#Stated, cd/m²", "#Light in the pictures", "#Off the scale, %"),
            tuple(_row(one) for one in scale.readings),
        )


def _row(one: ReadingEvidence) -> tuple[str, ...]:
    stated = plus_minus(one.luminance, one.reading.error * one.luminance)
    light = plus_minus(one.light, one.light_error * one.light)
    return str(one.reading), one.reading.source, stated, light, f"{100 * one.residual:+.2f}".replace("-", "−")
