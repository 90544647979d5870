"""`rig cameras`: what is connected, and what it can do."""

from dataclasses import asdict
from typing import Annotated

import typer

from capture.rigfile import network_address
from drivers import discovery
from rig.cameras import usb_bus
from rig.options.camera_addresses import CameraOption, rig_or_addresses
from rig.options.common import JsonOption
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted


def cameras(
    context: typer.Context,
    sim: Annotated[
        str | None,
        typer.Option("--sim", metavar="NAME", help="The cameras of a simulated rig, on a simulated bus."),
    ] = None,
    camera: CameraOption = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """List the connected cameras and what they can do.

    Opens each camera, queries its capabilities, and closes it. If a camera is missing, rig doctor says why.

    Example: rig cameras --sim demo
    """
    with running("cameras") as status:
        sim, addresses = rig_or_addresses(context, sim, camera)
        bus, network = usb_bus.open_bus(sim), usb_bus.open_network(sim, addresses)
        places = network_address.ptpip_places(addresses)
        listed = list(discovery.ask_all(bus.backend, bus.clock, status, network=network, places=places))
    lines = [line for one in listed for line in _lines(one)] or [
        "No camera: rig doctor shows what is missing."
    ]
    failed = [one for one in listed if one.error]
    missing = f"{counted(len(failed), 'camera')} could not be asked: {failed[0].error}" if failed else None
    data = {"cameras": [asdict(one) for one in listed]}
    return CommandResult(data, lines, missing, usable=len(failed) < len(listed))


def _lines(camera: "discovery.ConnectedCamera") -> list[str]:
    """A camera in three lines."""
    identity, able = camera.identity, camera.capabilities
    if identity is None or able is None:
        who = f"{identity.serial}  {identity.make} {identity.model}  " if identity else ""
        where = camera.where or camera.protocol
        named = who or not camera.error.startswith(where)  # a place that cannot be reached is in its error
        return [f"{who}{where}: {camera.error}" if named else camera.error]
    size = f"{able.width}x{able.height}, {able.bit_depth} bit, " if able.width and able.bit_depth else ""
    parts = [f"{_time(able.times[0])} to {_time(able.times[-1])} s" if able.times else ""]
    parts += [f"f/{able.f_numbers[0]:g} to f/{able.f_numbers[-1]:g}" if able.f_numbers else ""]
    parts += [f"ISO {able.isos[0]:g} to {able.isos[-1]:g}" if able.isos else ""]
    at = camera.where or camera.protocol
    if not at.startswith(camera.protocol):
        at = f"{camera.protocol} at {at}"
    settings = f"{size}{', '.join(part for part in parts if part)}"
    lines = [
        f"{identity.serial}  {identity.make} {identity.model}  ({at})",
        f"    {settings}" if settings else "",
    ]
    lines += [f"    cannot shoot for rig: {able.obstacle}" if able.obstacle else ""]
    lines += [f"    driver: {camera.chosen}" if camera.chosen else ""]
    lines += [f"    driver verified against: {camera.verified}"]
    return [line for line in lines if line]


def _time(seconds: float) -> str:
    """An exposure time as cameras show it."""
    return f"1/{1 / seconds:.0f}" if seconds < 0.3 else f"{seconds:g}"
