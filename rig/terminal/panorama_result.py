"""Results of `rig merge --panorama`, as its terminal and `--json` say them."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

from calib.exports.panorama import panorama as panoramas
from calib.exports.panorama import sun as suns
from rig.terminal.result import CommandResult
from rig.terminal.text import counted, number


def panorama_result(session: Path, made: "panoramas.Panorama") -> CommandResult:
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
        "warnings": list(made.warnings),
    }
    return CommandResult(data, list(_lines(made)))


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
    yield from (_clipped(region) for region in made.clipped)
    if made.unseen > 0:
        yield f"{100 * made.unseen:.0f} % of what lights the card of --sun is in no view: the sun has it too."
    yield from made.warnings


def _clipped(region: "suns.ClippedRegion") -> str:
    where = (
        f"A disc of {region.width:.1f}° at longitude {region.longitude:.0f}, latitude {region.latitude:.0f} "
        "is saturated in every exposure"
    )
    if region.luminance is not None:
        return f"{where}: its light is {number(region.luminance)} cd/m² by --sun"
    return (
        f"{where}: its light is a lower bound. Take a shorter exposure, or give --sun the lux of a card that "
        "faces it."
    )
