"""Arguments and options that several commands share."""

import math
from pathlib import Path
from typing import Annotated

import typer

from imaging.errors import InputError

SessionArgument = Annotated[
    Path, typer.Argument(metavar="SESSION", help="A session folder, as created by rig capture or rig import.")
]
ReconstructionsArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="RECON...",
        help="Reconstructions: SESSION/reconstructions/NAME, or a session for its newest.",
    ),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, and nothing else.")
]
"""Read by `main`, which prints: the commands themselves only declare it."""
QuietOption = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        help="Print only warnings and errors (and the output of --json).",
    ),
]
"""Every command has it (`rig.cli`)."""
RayOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        envvar="RAY_ADDRESS",
        help="Run on this Ray cluster instead, such as auto or ray://HOST:10001; its nodes see the "
        "sessions at the same paths.",
    ),
]
CoresOption = Annotated[int, typer.Option(min=1, max=256, metavar="N", help="With --ray: cores per task.")]
SeedOption = Annotated[int, typer.Option(min=0, metavar="N", help="The same seed gives the same bytes.")]


def budget(text: str) -> str:
    """`90s`, `5m`, `300MB`, `100k`, `35dB` or the like, unchanged; typer.BadParameter if it is nonsense."""
    from recon.decide.cost.budget import Budget

    try:
        Budget.parse(text)
    except InputError as error:
        raise typer.BadParameter(str(error)) from None
    return text.strip()


def shutter(text: str) -> float:
    """`1/30`, `0.5` or `2s` as seconds; typer.BadParameter otherwise."""
    from capture.rigfile.shutter_time import seconds_of

    try:
        return seconds_of(text)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None


class WrongUsage(typer.BadParameter):
    """Options that do not go together; the message begins with a capital letter and ends without a stop."""

    def format_message(self) -> str:
        """The message as it is."""
        return self.message


class Stops(tuple[float, ...]):
    """Exposures relative to a rig's middle one, ascending; empty for `auto`."""


def stops(text: str) -> Stops:
    """`auto`, or stops as `-4,-2,0,2`; typer.BadParameter otherwise."""
    if text.strip() == "auto":
        return Stops()
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = (math.nan,)
    if not all(math.isfinite(value) and abs(value) <= 30 for value in values):
        raise typer.BadParameter("write auto, or stops relative to the middle exposure as -4,-2,0,2,4")
    if len(set(values)) < len(values):
        raise typer.BadParameter("the exposures of a bracket have to differ")
    return Stops(sorted(values))
