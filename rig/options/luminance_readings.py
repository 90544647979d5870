"""Readings of luminance on the command line: `0003/cam0:1200,800,60,40=85cd/m2,+-3%`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import typer

from imaging.request import FORGET, Forget

if TYPE_CHECKING:
    from imaging.session.luminance import LuminanceReading

EXAMPLE = "0000/cam0:1200,800,60,40=85cd/m2"
HELP = (
    "READING is VIEW:LEFT,TOP,WIDTH,HEIGHT=VALUE, in pixels of the file; repeat it for more. VALUE is a "
    f"luminance, as in {EXAMPLE} (spot meter, known lamp), or an illuminance and a reflectance, as in "
    "0000/cam0:1200,800,60,40=1200lx,18% (grey card). chart=1200lx is the illuminance at the colour chart of "
    "the calibration. Add ,+-3% for the standard error of meter and card together (5 % if it is not given), "
    "and ,by=NAME where readings are by different meters or of different lamps: those of one meter share its "
    "error."
)
ERROR = 0.05
"""Standard error of a reading that states none: luminance meters of class L to B of DIN 5032-7 have 5 to 10 %
as a limit, photographers' spot meters a tenth of a stop.
"""
_NUMBER = r"(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+)"


class ReadingText(str):
    """Reading option, parsed when it is needed."""

    def reading(self) -> LuminanceReading:
        """The reading; InputError of one sentence that says what is wrong with the text."""
        from pydantic import ValidationError

        from imaging.errors import InputError
        from imaging.session.luminance import LuminanceReading

        place, separator, value = self.strip().partition("=")
        try:
            if not separator:
                raise ValueError("a reading follows after '='")
            return LuminanceReading.model_validate(_place(place) | _value(value))
        except ValidationError as error:
            message = error.errors()[0]["msg"].removeprefix("Value error, ")
            reason = f"{message[:1].lower()}{message[1:]}"
        except ValueError as error:
            reason = str(error)
        raise InputError(
            f"--luminance {str(self)!r}: {reason}; write a reading as {EXAMPLE}, or with lux and reflectance "
            "as 0000/cam0:1200,800,60,40=1200lx,18%."
        )


def _place(text: str) -> dict[str, object]:
    """View and area; neither for the chart."""
    if text.strip() == "chart":
        return {}
    view, separator, area = text.rpartition(":")
    numbers = re.fullmatch(r"\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*", area)
    if not (separator and numbers):
        raise ValueError(
            "before '=' stand a view and left, top, width and height of an area in it, or 'chart'"
        )
    return {"view": view.strip(), "area": tuple(map(int, numbers.groups()))}


def _value(text: str) -> dict[str, object]:
    """Luminance or illuminance, reflectance, error and source."""
    fields: dict[str, object] = {"error": ERROR}
    for part in text.split(","):
        word = part.strip()
        if match := re.fullmatch(rf"{_NUMBER}\s*(cd/m2|cd/m²|cd/m\^2|nits?|lx|lux)?", word):
            name = "illuminance" if match[2] in ("lx", "lux") else "luminance"
            fields[name] = float(match[1])
        elif match := re.fullmatch(rf"(?:\+-|±|\+/-)\s*{_NUMBER}\s*%", word):
            fields["error"] = float(match[1]) / 100
        elif match := re.fullmatch(rf"{_NUMBER}\s*%", word):
            fields["reflectance"] = float(match[1]) / 100
        elif match := re.fullmatch(r"by=\s*(\S.*)", word):
            fields["source"] = match[1]
        else:
            raise ValueError(f"{word!r} is no luminance, illuminance, reflectance or error")
    fields.setdefault("source", "light meter" if "illuminance" in fields else "spot meter")
    return fields


def reading_text(text: str) -> ReadingText:
    """Parse for typer."""
    if not text.strip():
        raise typer.BadParameter(f"write a reading as {EXAMPLE}")
    return ReadingText(text)


def readings_of(texts: list[ReadingText] | None) -> tuple[LuminanceReading, ...] | Forget | None:
    """Readings from the options; None without any."""
    if not texts:
        return None
    if [text.strip() for text in texts] == [FORGET]:
        return FORGET
    return tuple(text.reading() for text in texts)
