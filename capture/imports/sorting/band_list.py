"""Filter of each photograph: a list of bands, whose names are in the paths."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from capture.imports.originals import shown
from capture.imports.sorting.grouping import Bracket, PhotoSeries, split_into_brackets
from imaging.and_list import and_list
from imaging.errors import InputError
from imaging.session.records import MOST_BANDS, Band

FORM = "NAME, or NAME, WAVELENGTH, or NAME, WAVELENGTH, BANDWIDTH in nm"


def read_band_list(path: Path) -> tuple[Band, ...]:
    """The bands of a list, a line each: name, wavelength and bandwidth in nm; only the name is needed.

    What follows a # is a comment. InputError that names the line.
    """
    bands: list[Band] = []
    for number, line in enumerate(_text(path).splitlines(), start=1):
        cells = [cell.strip() for cell in line.partition("#")[0].split(",")]
        if cells == [""]:
            continue
        try:
            name, *numbers = cells
            waves = [float(cell) for cell in numbers] + [None, None]
            if len(numbers) > 2:
                raise ValueError
            bands.append(Band(name=name, wavelength_nm=waves[0], bandwidth_nm=waves[1]))
        except (ValueError, ValidationError) as error:
            raise InputError(f"line {number} of {path} names no band: write {FORM}.") from error
    names = [band.name.casefold() for band in bands]
    if len(set(names)) < len(names):
        raise InputError(f"{path} names a band twice: name each once.")
    if not 1 <= len(bands) <= MOST_BANDS:
        raise InputError(f"{path} names {len(bands)} bands: name 1 to {MOST_BANDS}, a line each.")
    return tuple(bands)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"{path} cannot be read: correct the path or its permissions.") from error


def bands_of(folder: Path, paths: Sequence[Path], bands: Sequence[Band]) -> dict[Path, str]:
    """The band of each photograph: the one whose name is a folder on its way, or a word of its own name.

    Of names that overlap the longest counts: `red-edge` is not of the band `red` too.

    InputError for a photograph of none or of several.
    """
    words = {
        band.name: re.compile(rf"(?<![A-Za-z0-9]){re.escape(band.name)}(?![A-Za-z0-9])", re.I)
        for band in bands
    }
    band_of = {}
    for path in paths:
        relative = shown(path.relative_to(folder))
        named = _named(relative, words)
        if len(named) != 1:
            of = f"of {and_list(named)}" if named else "of no band"
            raise InputError(
                f"{path} is {of} by its name: put the photographs into a folder for each band, or a band's "
                "name into that of each photograph."
            )
        band_of[path] = named[0]
    return band_of


def _named(text: str, words: Mapping[str, re.Pattern[str]]) -> list[str]:
    """The bands that a text names, without those whose name is there only as part of a longer one."""
    matches = [(name, *match.span()) for name, word in words.items() for match in word.finditer(text)]
    whole = {
        name
        for name, start, end in matches
        if not any(begin < end and start < stop and stop - begin > end - start for _, begin, stop in matches)
    }
    return [name for name in words if name in whole]


def split_by_band(
    series: PhotoSeries, count: int | None, band_of: Mapping[Path, str], bands: Sequence[Band]
) -> tuple[list[Bracket], str]:
    """The brackets of a camera, one a frame: of each band its own, one behind the other; and why.

    The first bracket of each band is of the first frame, and so on. InputError where a band has more of them
    than another.
    """
    parts = {}
    for band in bands:
        mine = tuple(photo for photo in series.originals if band_of[photo.path] == band.name)
        if mine:
            parts[band.name] = split_into_brackets(PhotoSeries(series.camera, mine), count)
    sizes = {name: len(brackets) for name, (brackets, _) in parts.items()}
    if len(set(sizes.values())) > 1:
        each = ", ".join(f"{size} of {name}" for name, size in sizes.items())
        raise InputError(
            f"camera {series.camera.name} has unequal numbers of frames, {each}: add what is missing, or say "
            "with --bracket how many photographs a band has in each frame."
        )
    rows = zip(*(chosen for chosen, _ in parts.values()), strict=True)
    joined = [[photo for bracket in together for photo in bracket] for together in rows]
    first = next(iter(parts.values()))[1]
    return joined, first if len(parts) == 1 else f"{first} So for each of {len(parts)} bands."
