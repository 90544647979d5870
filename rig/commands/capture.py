"""`rig capture`: shoot a session."""

from pathlib import Path
from typing import Annotated

import typer

from rig.commands.options import JsonOption, SeedOption, Stops, stops
from rig.progress import Meter
from rig.running import Outcome, leaving_nothing, running, shortfall
from rig.sessions import has_shots
from rig.words import counted, size


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
            help="Stops relative to the rig's middle exposure, as -4,-2,0,2,4; auto: the rig's own bracket.",
        ),
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
    if dry_run:
        with running("plan"):
            return _planned(sim, out, seed, frames, chosen)
    with running("capture", go_on=f"run the same command again with --resume to complete {out}") as meter:
        return run_capture(
            sim, out, meter, seed=seed, frames=frames, chosen=chosen, resume=resume, rough=rough
        )


def run_capture(
    sim: str,
    out: Path,
    meter: Meter,
    *,
    seed: int,
    frames: int | None = None,
    chosen: tuple[float, ...] | None = None,
    resume: bool = False,
    rough: bool = False,
) -> Outcome:
    """Capture and say what came of it."""
    with leaving_nothing(out, unless=has_shots):
        from capture.simulated import capture_simulated
        from drivers.sim.faults import ROUGH

        mix = ROUGH if rough else None
        result = capture_simulated(
            sim, out, seed=seed, frames=frames, bracket=chosen, resume=resume, mix=mix, progress=meter
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


def _planned(sim: str, out: Path, seed: int, frames: int | None, chosen: tuple[float, ...] | None) -> Outcome:
    """What a capture would shoot."""
    from drivers.sim.rigs import simulate
    from imaging.errors import InputError

    rig = simulate(sim, seed)
    positions = rig.frames if frames is None else frames
    if positions > rig.frames:
        raise InputError(f"The simulated rig {sim} has {rig.frames} positions: --frames can be at most that.")
    steps = (
        [str(exposure) for exposure in rig.bracket]
        if chosen is None
        else [f"{stop:+g} stops" if stop else "middle" for stop in chosen]
    )
    capabilities = rig.cameras[0].capabilities()
    shots = len(rig.cameras) * positions * len(steps)
    pixels = capabilities.width * capabilities.height
    data = {
        "session": str(out),
        "cameras": [record.name for record in rig.records()],
        "frames": positions,
        "bracket": steps,
        "shots": shots,
        "width": capabilities.width,
        "height": capabilities.height,
        "bytes_at_most": shots * pixels * 2,
    }
    lines = [
        f"{counted(len(rig.cameras), 'camera')}, {counted(positions, 'position')}, "
        f"{counted(len(steps), 'exposure')} each ({', '.join(steps)}): {counted(shots, 'shot')} of "
        f"{capabilities.width} x {capabilities.height}, at most {size(shots * pixels * 2)}, into {out}"
    ]
    return Outcome(data, lines)
