"""`rig init`: the connected cameras as a rig file."""

from pathlib import Path
from typing import Annotated

import typer

from capture.rigfile import network_address, template
from drivers import discovery
from imaging.errors import InputError
from imaging.files import store
from imaging.session import records
from rig.cameras import usb_bus
from rig.options.camera_addresses import CameraOption, rig_or_addresses
from rig.options.common import JsonOption
from rig.terminal.result import CommandResult, running
from rig.terminal.text import command_line, counted


def init(
    context: typer.Context,
    path: Annotated[Path, typer.Argument(metavar="RIG.toml", help="The file to write; never overwritten.")],
    sim: Annotated[
        str | None,
        typer.Option("--sim", metavar="NAME", help="Use the cameras of a simulated rig."),
    ] = None,
    camera: CameraOption = None,
    as_json: JsonOption = False,
) -> CommandResult:
    """Write a rig file for the connected cameras.

    It lists the cameras of the rig and how it shoots: edit it as needed, then shoot with
    rig capture RIG.toml OUT.

    Example: rig init RIG.toml --sim demo
    """
    with running("init") as status:
        if path.exists() or path.is_symlink():
            raise InputError(f"{path} exists already: name another file, or move it away.")
        sim, addresses = rig_or_addresses(context, sim, camera)
        bus, network = usb_bus.open_bus(sim), usb_bus.open_network(sim, addresses)
        places = network_address.ptpip_places(addresses)
        listed = list(discovery.ask_all(bus.backend, bus.clock, status, network=network, places=places))
        board = None if bus.rig is None else records.Board.model_validate(bus.rig.board.description())
        text = template.rig_file_text(listed, board, addresses)
        store.write_bytes(path, text.encode())
    failed = [one for one in listed if one.trouble]
    asked = len(listed) - len(failed)
    missing = f"{counted(len(failed), 'camera')} left out: {failed[0].trouble}" if failed else None
    on = [] if sim is None else ["--sim", sim]
    lines = [
        f"{path}: {counted(asked, 'camera')}",
        f"Next: edit it as needed, then {command_line('rig', 'capture', path, 'S', '--dry-run', *on)}",
    ]
    serials = [one.identity.serial for one in listed if one.identity is not None and not one.trouble]
    return CommandResult({"rig": str(path), "cameras": serials}, lines, missing)
