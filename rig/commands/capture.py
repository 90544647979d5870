"""`rig capture`: shoot a session."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from capture.bracket.goals import BracketGoals
from capture.record import shooting
from capture.request import RigRequest
from capture.rigfile import rigfile
from imaging import choices
from imaging.errors import InputError
from imaging.session import session as sessions
from imaging.session.paths import has_shots
from rig.cameras import forecast_in_words, rehearsal
from rig.cameras.usb_bus import source_of
from rig.options.common import JsonOption, SeedOption, Stops, WrongUsage, shutter, stops
from rig.options.defaults import is_typed, is_users, without_users
from rig.options.request import Asked, Shown
from rig.terminal.progress import StatusLine
from rig.terminal.result import CommandResult, missing_parts, removed_on_failure, running
from rig.terminal.text import command_line, counted

if TYPE_CHECKING:
    from capture.record.forecast import Forecast

Bracket = tuple[float, ...] | BracketGoals | None

NO_OPTIONS, NO_GOALS = RigRequest(), BracketGoals()
OPTIONS = Asked(
    beside=("kind", "compression", "operator", "positions", "backend", "network", "clock"),
    frames=Shown(how={"min": 1, "metavar": "N"}),
    bracket=Shown(
        kind=Stops | None,
        more="Write stops as -4,-2,0,2,4; auto takes the goals below.",
        how={"parser": stops, "metavar": "auto|STOPS"},
    ),
    ray=Shown(how={"metavar": "ADDRESS", "envvar": "RAY_ADDRESS"}),
)
_AUTO = "With --bracket auto."
GOALS = Asked(
    snr=Shown(more=_AUTO, how={"min": 0.0, "max": 60.0, "metavar": "DB"}),
    slowest=Shown(more=_AUTO, how={"parser": shutter, "metavar": "TIME"}),
    total=Shown(more=_AUTO, how={"parser": shutter, "metavar": "TIME"}),
    highest_iso=Shown(kind=int | None, more=_AUTO, how={"min": 1, "metavar": "ISO"}),
)


def capture(
    context: typer.Context,
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="[RIG.toml] OUT",
            help="The rig file, as written by rig init (not needed with --sim); and the session folder to "
            "create or add to.",
        ),
    ],
    sim: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Use simulated cameras: demo, gallery or toy (a small rig); demo-ldr and so on take JPEG "
            "photographs. With RIG.toml, they replace its cameras.",
        ),
    ] = None,
    seed: SeedOption = 0,
    request: Annotated[RigRequest, OPTIONS] = NO_OPTIONS,
    goals: Annotated[BracketGoals, GOALS] = NO_GOALS,
    rough: Annotated[
        bool,
        typer.Option("--rough", help="With --sim: inject bus errors into 5 % of camera requests."),
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would be shot; write nothing.")
    ] = False,
    darks: Annotated[
        bool,
        typer.Option("--darks", help="Add dark frames to OUT: lenses covered, the exposures of the scene."),
    ] = False,
    flats: Annotated[
        bool,
        typer.Option(
            "--flats",
            help="Add flat fields to OUT: an evenly lit surface at a dozen levels up to 90 % of white.",
        ),
    ] = False,
    board: Annotated[
        bool,
        typer.Option(
            "--board", help="Add pictures of a calibration board to OUT, one metered exposure per pose."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> CommandResult:
    """Shoot a session.

    Every camera of the rig takes a bracket at every position. Every finished shot is safe on disk; an
    interrupted capture is completed by --resume. Calibration frames go into the same session, before
    or after the scene.

    Example: rig capture RIG.toml S --bracket auto --slowest 1/4
    """
    rig_file, out = _places(context, paths, sim)
    kind = _kind(context, {"dark": darks, "flat": flats, "board": board})
    if sim is None and ((seed and is_typed(context, "seed")) or rough):
        raise WrongUsage("--seed and --rough are for simulated rigs: add --sim, or leave them out", context)
    typed = {name for name in ("bracket", *vars(goals)) if is_typed(context, name)}
    users = {name for name in vars(goals) if is_users(context, name)}
    if request.resume and not typed and _is_planned(out):  # the plan has its own bracket
        request, users = without_users(context, request, "bracket"), set()
    limits = {name: value for name, value in vars(goals).items() if name in typed | users}
    if kind != "scene" and typed and (request.bracket == () or typed != {"bracket"}):
        raise WrongUsage("An automatic bracket, and its limits, are for scenes: leave them out", context)
    rig = None if rig_file is None else rigfile.read_rig_file(rig_file)
    bracket = _bracket(request.bracket, limits, typed, rig)
    if kind != "scene" and not typed:
        bracket = None  # the user's defaults are for scenes
    request = replace(request, kind=kind, bracket=bracket)
    if dry_run:
        with running("plan") as status:
            return rehearsal.rehearse(sim, out, status, request, rig=rig, seed=seed)
    with running("capture", go_on="run the same command again with --resume") as status:
        return run_capture(sim, out, status, request, rig=rig, seed=seed, rough=rough, announced=not as_json)


def _places(context: typer.Context, paths: list[Path], sim: str | None) -> tuple[Path | None, Path]:
    """The rig file, if there is one, and the session folder."""
    if len(paths) > 2:
        raise WrongUsage(f"Got unexpected extra argument ({paths[2]})", context)
    if len(paths) == 2:
        return paths[0], paths[1]
    if sim is not None:
        return None, paths[0]
    if paths[0].suffix == ".toml":
        raise WrongUsage("Missing argument 'OUT', the session folder", context)
    raise WrongUsage(f"Missing option '--sim', or the rig file before {paths[0]}", context)


def _is_planned(out: Path) -> bool:
    """Return whether the scene of a session is planned."""
    if not (out / "session.json").is_file():
        return False
    return any(plan.kind == "scene" for plan in sessions.Session.open(out).plans())


def _kind(context: typer.Context, wanted: dict[choices.Subject, bool]) -> choices.Subject:
    """Kind of shots: the scene, or one of the frames for calibration."""
    chosen = [kind for kind, is_wanted in wanted.items() if is_wanted]
    if len(chosen) > 1:
        raise WrongUsage("--darks, --flats and --board are shot one after the other: give one", context)
    return chosen[0] if chosen else "scene"


def _bracket(
    bracket: Bracket, limits: Mapping[str, Any], typed: Collection[str], rig: rigfile.RigFile | None
) -> Bracket:
    """The stops or the goals that are asked for, if any; no stops: an automatic bracket.

    Goals that are left out are those of the rig file. typed: names of what the command line states; the
    others are the user's defaults, which are dropped where they do not go with it. InputError where limits
    are given to stops.
    """
    usual = rig is not None and rig.tables.bracket.exposures == "auto"
    limited = [name for name in limits if name in typed]
    if bracket and limited and "bracket" not in typed:
        bracket = None
    if bracket == () or (bracket is None and usual and limits):
        return replace(NO_GOALS if rig is None else rig.tables.bracket.wanted, **limits)
    if limited and not usual:
        option = "--" + limited[0].replace("_", "-")
        raise InputError(f"{option} only limits a bracket that is planned: add --bracket auto.")
    if limited:
        raise InputError("explicit stops are not planned: leave out --bracket or its limits.")
    return bracket


def run_capture(
    sim: str | None,
    out: Path,
    status: StatusLine,
    request: RigRequest,
    *,
    seed: int,
    rig: rigfile.RigFile | None = None,
    rough: bool = False,
    announced: bool = False,
) -> CommandResult:
    """Capture and say what came of it. announced: with a line of forecast before the first shot."""

    def announce(forecast: Forecast) -> None:
        if announced or not forecast.fits:
            pause = 0.0 if rig is None or sim is not None else rig.tables.pause
            status.say(forecast_in_words.forecast_line(forecast, pause))

    with (
        removed_on_failure(out, unless=has_shots),
        source_of(sim, seed, rig, request, status, rough=rough) as source,
    ):
        result = shooting.shoot(source, out, request, progress=status, say=status.say, announce=announce)
    there = result.taken + result.earlier
    earlier = f", {result.earlier} of them taken before" if result.earlier else ""
    lines = [f"{out}: {there} of {counted(result.planned, 'shot')}{earlier}"]
    lines += [] if result.run is None else [forecast_in_words.outcome_line(result.run)]
    lines += [f"  {problem}" for problem in (*result.problems, *result.unknown)]
    missing = missing_parts(result.require_complete)
    if missing is None and (session := sessions.Session.open(out)).shots("scene"):
        only = () if session.lamps() is None else ("--only", "sensor")  # a dome's views have no poses
        lines.append(f"Next: {command_line('rig', 'calibrate', out, *only)}")
    data = {
        "session": str(out),
        "planned": result.planned,
        "taken": result.taken,
        "earlier": result.earlier,
        "missing_shots": list(result.missing),
        "problems": list(result.problems),
        "unknown": list(result.unknown),
        "run": None if result.run is None else result.run.model_dump(mode="json"),
    }
    return CommandResult(data, lines, missing, usable=there > 0, already_there=not result.taken)
