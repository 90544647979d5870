"""`image_list.txt`: the exposures of a series in a text file, as in Debevec and Malik's memorial church.

A line is `file  [exposure]  1/shutter  f/stop  gain(dB)  ND`, separated by blanks; `#` begins a comment.
A gain of 3 dB doubles the exposure. Lists of HDRShop leave the exposure out.
"""

import math
from pathlib import Path

from imaging.errors import InputError
from imaging.exposure import Exposure

NAME = "image_list.txt"


def read_exposure_list(path: Path) -> dict[str, Exposure]:
    """Exposure by file name; InputError that names the first line that cannot be understood."""
    exposures: dict[str, Exposure] = {}
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise InputError(f"{path} cannot be read: correct its permissions or remove it.") from error
    for number, line in enumerate(lines, start=1):
        fields = line.split("#")[0].split()
        if not fields:
            continue
        try:
            exposures[fields[0]] = _exposure([float(field) for field in fields[1:]])
        except (ValueError, ArithmeticError) as error:
            raise InputError(
                f"{path}, line {number} is not 'file [exposure] 1/shutter f/stop gain ND': "
                "correct or remove it."
            ) from error
    return exposures


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
