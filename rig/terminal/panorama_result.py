"""Results of `rig merge --panorama`, as its terminal and `--json` say them."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from calib.exports.panorama import panorama as panoramas
from imaging.choices import SPACE_NAMES, Space
from rig.terminal.result import CommandResult
from rig.terminal.text import command_line, counted, number

MOST_CLIPPED = 3
"""Saturated places that get a line each."""


def panorama_result(session: Path, made: "panoramas.Panorama", space: Space) -> CommandResult:
    """The file, how well its views agree, and what they do not show."""
    data = {
        "session": str(session),
        "file": str(made.file),
        "width": made.width,
        "views": made.views,
        "units": "cd/m2" if made.absolute else "light",
        "exposure_factor": made.exposure_factor,
        "known": made.known,
        "seam_stops": made.seam_stops,
        "seams": [{**asdict(seam), "one": str(seam.one), "other": str(seam.other)} for seam in made.seams],
        "clipped": [asdict(region) for region in made.clipped],
        "parallax_degrees": made.parallax,
        "camera_rgb": list(made.camera_rgb),
        "warnings": list(made.warnings),
    }
    lines = list(_lines(made))
    if made.camera_rgb:
        lines.append(camera_rgb_line(session, made.camera_rgb, space, calibrated=True))
    return CommandResult(data, lines)


def camera_rgb_line(session: Path, cameras: Sequence[str], space: Space, *, calibrated: bool) -> str:
    """Files that are in no known space, and what gives them one."""
    how = command_line("rig", "calibrate", session)
    chart = " --only colour --chart` with a view of a ColorChecker in it" if calibrated else "`"
    return (
        f"The colours of {', '.join(cameras)} are camera RGB, and no {SPACE_NAMES[space]}: run "
        f"`{how}{chart}, and merge the session again for {SPACE_NAMES[space]}."
    )


def _lines(made: "panoramas.Panorama") -> Iterator[str]:
    scale = f"light times {number(made.exposure_factor)}"
    unit = "cd/m²" if made.absolute else "light" if made.exposure_factor == 1 else scale
    yield (
        f"{made.file}: {counted(made.views, 'view')} on {made.width}x{made.width // 2}, in {unit}, middle "
        "row level, +y up"
    )
    if made.worst_seam is None:
        yield "No two views overlap, so that nothing says how well they agree."
    else:
        worst = made.worst_seam
        yield (
            f"{counted(len(made.seams), 'pair')} of views overlap and differ by {made.seam_stops:.3f} stops "
            f"in the median, at most by {abs(worst.stops):.3f} ({worst.one} and {worst.other})"
        )
    if made.known < 1:
        yield (
            f"{100 * made.known:.1f} % of all directions are shown; the rest is black, with A 0, and 4 "
            "in the mask"
        )
    if made.parallax:
        yield f"Things stand up to {made.parallax:.2g}° elsewhere in one view than in another."
    yield from _clipped(made)
    if made.unseen > 0:
        yield f"{100 * made.unseen:.0f} % of what lights the card of --sun is in no view: the sun has it too."
    yield from made.warnings


def _clipped(made: "panoramas.Panorama") -> Iterator[str]:
    """The saturated places: the brightest, and the number of the others."""
    for region in made.clipped[:MOST_CLIPPED]:
        where = (
            f"A disc of {region.width:.1f}° at longitude {region.longitude:.0f}, latitude "
            f"{region.latitude:.0f} is saturated in every exposure"
        )
        if region.luminance is None:
            yield f"{where}: its light is a lower bound."
        else:
            yield f"{where}: its light is {number(region.luminance)} cd/m² by --sun"
    others = len(made.clipped) - MOST_CLIPPED
    if others > 0:
        yield f"{counted(others, 'dimmer place')} besides: saturated in every exposure, a lower bound."
    if made.clipped and made.clipped[0].luminance is None:
        sun = ", or give --sun the lux of a card that faces the first" if made.absolute else ""
        yield f"Saturated places need a shorter exposure: take one{sun}."
