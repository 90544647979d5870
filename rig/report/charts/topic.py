"""One topic of a calibration as the page shows it: drawings, tables, and values with errors as words."""

import math
from dataclasses import dataclass

from markupsafe import Markup

NOT_DETERMINED = "not determined"


@dataclass(frozen=True)
class Tile:
    """A headline number."""

    value: str
    unit: str
    label: str


@dataclass(frozen=True)
class Figure:
    """A drawing with its heading and what it shows; wide: it takes the whole width of the page."""

    heading: str
    explanation: str
    drawing: Markup
    wide: bool = False


@dataclass(frozen=True)
class Table:
    """Rows of words. Columns that begin with a number sign hold numbers, which are set to the right."""

    heading: str
    explanation: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Topic:
    """Section of charts: lenses, or sensors, or poses."""

    title: str
    note: str = ""
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()

    @property
    def empty(self) -> bool:
        """True if there is nothing to show."""
        return not (self.figures or self.tables)


def plus_minus(value: float, sigma: float | None, unit: str = "") -> str:
    """`326.72 ± 0.65 px`: the error with two digits, the value with as many decimals."""
    tail = f" {unit}" if unit else ""
    if not math.isfinite(value):
        return NOT_DETERMINED
    if sigma is None or not math.isfinite(sigma) or sigma <= 0:
        return f"{value:.6g}{tail}".replace("-", "−")
    decimals = max(1 - math.floor(math.log10(sigma)), 0)
    if decimals > 9:
        return f"{value:.6g} ± {sigma:.1e}{tail}".replace("-", "−")
    # Through its own rounding: 0.0996 is 0.10, with one decimal less than 0.0994.
    decimals = max(1 - math.floor(math.log10(float(f"{sigma:.1e}"))), 0)
    text = f"{value:.{decimals}f}"
    text = text if float(text) else text.lstrip("-")
    return f"{text} ± {sigma:.{decimals}f}{tail}".replace("-", "−")
