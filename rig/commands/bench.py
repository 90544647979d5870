"""`rig bench`: the table of a paper, of its own data set."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from recon.decide.presets import QualityName
from rig.benchmarks import protocol as papers
from rig.benchmarks import protocols
from rig.options.common import JsonOption, SeedOption
from rig.terminal.result import CommandResult, running
from rig.terminal.tables import table
from rig.terminal.text import counted

ProtocolName = Literal["rawnerf", "hdr-nerf", "hdr-plenoxels", "hdr-pretrain", "realx3d", "eth3d"]


def bench(
    protocol: Annotated[ProtocolName, typer.Argument(help="The data set, and how its paper measures.")],
    data: Annotated[
        Path, typer.Argument(metavar="DIR", help="A scene of the data set, or the folder of its scenes.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="Folder for sessions and figures; bench-PROTOCOL if not given.")
    ] = None,
    quality: Annotated[QualityName, typer.Option(help="Preset, as of rig reconstruct.")] = "standard",
    views: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Training views, evenly chosen; all if not given.")
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Measure rig on the data set of a paper.

    Imports, calibrates, trains and measures each scene by the protocol of the paper, and prints a table with
    the published figures. Finished scenes are kept, so the same command resumes.

    Example: rig bench rawnerf scenes/ --quality best
    """
    with running("bench") as status:
        chosen = protocols.PROTOCOLS[protocol]
        place = out or Path(f"bench-{protocol}")
        choices = papers.Choices(quality, seed, views)
        outcome = papers.run_scenes(chosen, papers.scenes_in(chosen, data), place, choices, status)
    lines = [*_table(chosen, outcome), chosen.note]
    missing = None
    if outcome.failed:
        first = next(iter(outcome.failed.values()))
        count = len(outcome.failed) + len(outcome.figures)
        missing = f"{len(outcome.failed)} of {counted(count, 'scene')} could not be measured: {first}"
    result = {
        "protocol": protocol,
        "out": str(place),
        "quality": quality,
        "views": views,
        "seed": seed,
        "scenes": outcome.figures,
        "mean": outcome.means(),
        "published": {name: dict(figures) for name, figures in chosen.published.items()},
        "failed": outcome.failed,
    }
    return CommandResult(result, lines, missing, usable=bool(outcome.figures))


def _table(protocol: "papers.Protocol", outcome: "papers.Outcome") -> list[str]:

    def row(name: str, figures: "papers.Figures") -> tuple[str, ...]:
        cells = [
            f"{figures[key]:.{column.digits}f}" if key in figures else ""
            for key, column in protocol.columns.items()
        ]
        return (name, *cells)

    ours = [row(name, figures) for name, figures in outcome.figures.items()]
    if ours:
        ours.append(row("mean", outcome.means()))
    published = [row(name, figures) for name, figures in protocol.published.items()]
    columns = ["", *(column.title for column in protocol.columns.values())]
    return table([("", ours), ("published", published)], columns, {"": 1})
