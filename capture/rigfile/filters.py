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


def wheel_of(value: Any) -> tuple[Band, ...]:
    """The bands of a filter wheel, in its order; ValueError with what they have to be."""
    if not isinstance(value, list) or not 1 <= len(value) <= MOST_BANDS:
        raise ValueError(f'1 to {MOST_BANDS} filters, as ["450nm, 450, 40", "650nm, 650, 40"]')
    try:
        wheel = tuple(band_of(line) for line in value)
    except ValueError as error:
        raise ValueError(f"made of filters, each {error}") from None
    if len({band.name.casefold() for band in wheel}) < len(wheel):
        raise ValueError("made of filters with names of their own")
    return wheel


def fault_of_wheels(
    wheels: Sequence[tuple[Band, ...]], bands: Sequence[Band | None]
) -> tuple[int, str] | None:
    """Camera at fault, and a sentence, where its filter wheel is not that of the rig; else None."""
    for index, (wheel, band) in enumerate(zip(wheels, bands, strict=True)):
        if wheel and band is not None:
            return index, "this camera has a band and filters; leave one out."
        if wheel != wheels[0]:
            return index, "the cameras have other filters; give every camera the same, in the same order."
    return None


def fault_of_bands(bands: Sequence[Band | None]) -> tuple[int, str] | None:
    """Camera at fault, and a sentence, where the filters of a rig do not go together; else None."""
    named: dict[str, Band] = {}
    for index, band in enumerate(bands):
        if band is None:
            if any(bands):
                return index, "this camera has no band and others have; name the filter of each, or none."
        elif named.setdefault(band.name.casefold(), band) != band:
            return index, f"another filter has the name {band.name!r} already; give every filter its own."
        elif len(named) > MOST_BANDS:
            return index, f"there are more than {MOST_BANDS} bands; that is the most a scene may have."
    return None
