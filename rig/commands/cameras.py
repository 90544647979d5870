"""`rig cameras`: what is connected, and what it can do."""

from dataclasses import asdict
from typing import Annotated, Any

import typer

from rig.buses import bus_of
from rig.commands.options import JsonOption
from rig.terminal.outcome import Outcome, running
from rig.terminal.text import counted


def cameras(
    sim: Annotated[
        str | None,
        typer.Option("--sim", metavar="NAME", help="The cameras of a simulated rig, on a simulated bus."),
    ] = None,
    as_json: JsonOption = False,
) -> Outcome:
    """List the connected cameras and what they can do.

    Opens each one, asks, and lets it go. A camera that is missing here: rig doctor says why.

    Example: rig cameras --sim demo
    """
    with running("cameras") as meter:
        from drivers.discovery import ask_all

        meter("looking for cameras", 0, 0)
        bus = bus_of(sim)
        listed = []
        for one in ask_all(bus.backend, bus.clock):
            listed.append(one)
            meter(one.where or one.protocol, len(listed), 0)
    lines = [line for one in listed for line in _lines(one)] or [
        "No camera: rig doctor shows what is missing."
    ]
    failed = [one for one in listed if one.error]
    missing = f"{counted(len(failed), 'camera')} could not be asked: {failed[0].error}" if failed else None
    data = {"cameras": [asdict(one) for one in listed]}
    return Outcome(data, lines, missing, usable=len(failed) < len(listed))


def _lines(one: Any) -> list[str]:
    """A camera in three lines."""
    if one.error:
        who = f"{one.identity.serial}  {one.identity.make} {one.identity.model}  " if one.identity else ""
        return [f"{who}{one.where}: {one.error}"]
    who, able = one.identity, one.capabilities
    size = f"{able.width}x{able.height}, {able.bit_depth} bit, " if able.width and able.bit_depth else ""
    parts = [f"{_time(able.times[0])} to {_time(able.times[-1])} s" if able.times else ""]
    parts += [f"f/{able.f_numbers[0]:g} to f/{able.f_numbers[-1]:g}" if able.f_numbers else ""]
    parts += [f"ISO {able.isos[0]:g} to {able.isos[-1]:g}" if able.isos else ""]
    at = f"{one.protocol} at {one.where}" if one.where else one.protocol
    settings = f"{size}{', '.join(part for part in parts if part)}"
    lines = [f"{who.serial}  {who.make} {who.model}  ({at})", f"    {settings}" if settings else ""]
    lines += [f"    cannot shoot for rig: {able.obstacle}" if able.obstacle else ""]
    lines += [f"    driver verified against: {one.verified}"]
    return [line for line in lines if line]


def _time(seconds: float) -> str:
    """An exposure time as cameras show it."""
    return f"1/{1 / seconds:.0f}" if seconds < 0.3 else f"{seconds:g}"
