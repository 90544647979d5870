"""Lists of exposures in text files: those of HDRShop, of pfstools, and plain tables of seconds.

Three forms of a line are about; `#` begins a comment:

* `file  [exposure]  1/shutter  f/stop  gain(dB)  ND`, separated by blanks: `image_list.txt` of Debevec
  and Malik's memorial church; a gain of 3 dB doubles the exposure; HDRShop leaves the exposure out;
* `file  1/shutter  f-number  ISO  0`: `.hdrgen` of pfstools (pfsinhdrgen(1)), known by its suffix;
* `file, seconds[, f-number[, ISO]]`, separated by commas, with or without a heading; seconds may be
  written 1/60.
"""

import csv
import math
from pathlib import Path

from pydantic import ValidationError

from imaging.errors import InputError
from imaging.optics.exposure import Exposure

NAME = "image_list.txt"

_FORMS = {
    "hdrgen": "'file 1/shutter f-number ISO 0'",
    "comma": "'file, seconds, f-number, ISO'",
    "blank": "'file [exposure] 1/shutter f/stop gain ND'",
}


def read_exposure_list(path: Path) -> dict[str, Exposure]:
    """Exposure by file name; InputError that names the first line that cannot be understood."""
    exposures: dict[str, Exposure] = {}
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"{path} cannot be read: correct the path or its permissions.") from error
    first = True
    for number, line in enumerate(lines, start=1):
        line = line.split("#")[0].strip()
        form = "hdrgen" if path.suffix.lower() == ".hdrgen" else "comma" if "," in line else "blank"
        if not line or (first and form == "comma" and _is_heading(line)):
            continue
        first = False
        try:
            name, exposure = _READERS[form](line)
            if exposures.get(name, exposure) != exposure:
                raise ValueError("named twice")
            exposures[name] = exposure
        except (ValueError, ArithmeticError, ValidationError, csv.Error) as error:
            raise InputError(f"{path}, line {number} is not {_FORMS[form]}: correct or remove it.") from error
    return exposures


def _fields(line: str) -> list[str]:
    return [field.strip() for field in next(csv.reader([line], skipinitialspace=True))]


def _is_heading(line: str) -> bool:
    """Return whether no field of the line is a number: then it names the columns."""
    return not any(letter.isdigit() for field in _fields(line)[1:] for letter in field)


def _comma(line: str) -> tuple[str, Exposure]:
    name, time, *rest = _fields(line)
    if not name or len(rest) > 2:
        raise ValueError(f"{len(rest)} numbers beside the time")
    above, slash, below = time.partition("/")
    seconds = float(above) / float(below) if slash else float(above)
    f_number, iso = [*(float(field) if field else None for field in rest), None, None][:2]
    return name, Exposure(time=seconds, f_number=f_number, iso=iso)


def _hdrgen(line: str) -> tuple[str, Exposure]:
    # No file name of this form has blanks; what follows the ISO is always 0 and means nothing.
    name, per_second, f_number, iso, *rest = line.split()
    if len(rest) > 1:
        raise ValueError(f"{len(rest)} numbers too many")
    return name, Exposure(
        time=1.0 / float(per_second), f_number=float(f_number) or None, iso=float(iso) or None
    )


def _blank(line: str) -> tuple[str, Exposure]:
    name, *fields = line.split()
    return name, _exposure([float(field) for field in fields])


_READERS = {"comma": _comma, "hdrgen": _hdrgen, "blank": _blank}


def _exposure(numbers: list[float]) -> Exposure:
    """ValueError if the numbers are not those of one exposure."""
    if len(numbers) not in (4, 5):
        raise ValueError(f"{len(numbers)} numbers")
    per_second, f_stop, gain, density = numbers[-4:]
    if density:
        raise ValueError("what an ND value means differs between lists")
    iso = 100.0 * 2.0 ** (gain / 3.0) if gain else None
    exposure = Exposure(time=1.0 / per_second if per_second else math.inf, f_number=f_stop or None, iso=iso)
    if len(numbers) == 5 and not math.isclose(numbers[0], exposure.time, rel_tol=0.01):
        raise ValueError("the exposure contradicts the shutter speed")
    return exposure
