"""The filter before each mono camera, as a rig file writes it."""

from collections.abc import Sequence
from typing import Any

from imaging.session.records import MOST_BANDS, Band


def band_of(value: Any) -> Band:
    """The band that a line such as "650nm, 650, 40" names; ValueError with what it has to be."""
    try:
        name, *numbers = [cell.strip() for cell in value.split(",")]
        if len(numbers) > 2:
            raise ValueError
        waves = [float(cell) for cell in numbers] + [None, None]
        return Band(name=name, wavelength_nm=waves[0], bandwidth_nm=waves[1])
    except (ValueError, AttributeError):
        raise ValueError('a name, its wavelength and bandwidth in nm, as "650nm, 650, 40"') from None


def fault_of_bands(bands: Sequence[Band | None]) -> tuple[int, str] | None:
    """Which camera is at fault, and a sentence, where the filters of a rig do not go together; else None."""
    seen: dict[str, Band] = {}
    for index, band in enumerate(bands):
        if band is None:
            if any(bands):
                return index, "this camera has no band and others have; name the filter of each, or none."
        elif seen.setdefault(band.name.casefold(), band) != band:
            return index, f"another filter has the name {band.name!r} already; give every filter its own."
        elif len(seen) > MOST_BANDS:
            return index, f"there are more than {MOST_BANDS} bands; a scene has at most so many."
    return None
