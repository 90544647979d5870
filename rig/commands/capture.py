"""`rig capture`: shoot a session."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rig.commands.options import JsonOption, SeedOption, Stops, shutter, stops
from rig.commands.rehearsal import rehearse
from rig.progress import Meter
from rig.running import Outcome, leaving_nothing, running, shortfall
from rig.sessions import has_shots
from rig.words import counted

if TYPE_CHECKING:
    from capture.planner import Wanted


def capture(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The session folder to make.")],
    sim: Annotated[
        str, typer.Option(metavar="NAME", help="The simulated rig: demo, demo-ldr, toy or toy-ldr.")
    ],
    seed: SeedOption = 0,
    frames: Annotated[
        int | None, typer.Option(min=1, help="How many positions of the rig; all if not given.")
    ] = None,
    bracket: Annotated[
        Stops | None,
        typer.Option(
            parser=stops,
            metavar="auto|STOPS",
            help="Stops relative to the rig's middle exposure, as -4,-2,0,2,4; auto: the fewest that the "
            "metered scene needs; the rig's own bracket if not given.",
        ),
    ] = None,
    snr: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=60.0,
            metavar="DB",
            show_default="20",
            help="With --bracket auto: signal to noise that the darkest of the scene has to reach.",
        ),
    ] = None,
    slowest: Annotated[
        float | None,
        typer.Option(
            parser=shutter, metavar="TIME", help="With --bracket auto: no exposure longer, as 1/30 or 2s."
        ),
    ] = None,
    total: Annotated[
        float | None,
        typer.Option(
            parser=shutter,
            metavar="TIME",
            help="With --bracket auto: no bracket longer, all exposures added.",
        ),
    ] = None,
    highest_iso: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="With --bracket auto: no ISO higher.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Complete the session in OUT.")] = False,
    rough: Annotated[
        bool,
        typer.Option(
            "--rough", help="Let a twentieth of what the cameras are asked for go wrong on the bus."
        ),
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say what would be shot and write nothing.")
    ] = False,
    as_json: JsonOption = False,
) -> Outcome:
    """Shoot a session.

    Every camera of the rig takes a bracket at every position. Every finished shot is safe on the
    disk; a capture that was stopped is completed by --resume.

    Example: rig capture --sim demo S --seed 1
    """
    chosen = tuple(bracket) if bracket else None
    auto = _wanted(bracket, snr, slowest, total, highest_iso)
    if dry_run:
        with running("plan"):
            return rehearse(sim, out, seed=seed, frames=frames, chosen=chosen, auto=auto)
    with running("capture", go_on=f"run the same command again with --resume to complete {out}") as meter:
        return run_capture(
            sim, out, meter, seed=seed, frames=frames, chosen=chosen, auto=auto, resume=resume, rough=rough
        )


def _wanted(
    bracket: Stops | None,
    snr: float | None,
    slowest: float | None,
    total: float | None,
    highest_iso: int | None,
) -> Wanted | None:
    """What an automatic bracket has to reach; InputError where its options are given without it."""
    from capture.planner import Wanted
    from imaging.errors import InputError

    if bracket is not None and not bracket:
        return Wanted(20.0 if snr is None else snr, slowest, total, highest_iso)
    given = {"--snr": snr, "--slowest": slowest, "--total": total, "--highest-iso": highest_iso}
    for option, value in given.items():
        if value is not None:
            raise InputError(f"{option} only limits a bracket that is planned: add --bracket auto.")
    return None


def run_capture(
    sim: str,
    out: Path,
    meter: Meter,
    *,
    seed: int,
    frames: int | None = None,
    chosen: tuple[float, ...] | None = None,
    auto: Wanted | None = None,
    resume: bool = False,
    rough: bool = False,
) -> Outcome:
    """Capture and say what came of it."""
    with leaving_nothing(out, unless=has_shots):
        from capture.simulated import capture_simulated
        from drivers.sim.faults import ROUGH

        mix = ROUGH if rough else None
        result = capture_simulated(
            sim,
            out,
            seed=seed,
            frames=frames,
            bracket=chosen,
            auto=auto,
            resume=resume,
            mix=mix,
            progress=meter,
        )
    there = result.taken + result.kept
    kept = f", {result.kept} of them taken before" if result.kept else ""
    lines = [f"{out}: {there} of {counted(result.planned, 'shot')}{kept}"]
    lines += [f"  {problem}" for problem in result.problems]
    missing = shortfall(result.require_complete)
    if missing is None:
        lines.append(f"Next: rig calibrate {out}")
    data = {
        "session": str(out),
        "planned": result.planned,
        "taken": result.taken,
        "kept": result.kept,
        "missing_shots": list(result.missing),
        "problems": list(result.problems),
    }
    return Outcome(data, lines, missing, usable=there > 0)
