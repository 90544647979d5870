"""`rig node`: the cameras of this host for a rig that another host leads."""

import os
import signal
from contextlib import ExitStack, closing, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from capture.nodes import joining, node_settings, token
from capture.nodes import node as nodes
from capture.nodes.request import NodeRequest
from imaging.files import store
from rig.commands.simulate import Address, address
from rig.options.camera_addresses import CameraOption, addresses_of
from rig.options.common import JsonOption
from rig.options.request import Asked, Shown
from rig.terminal.failures import Stopped
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted

DISK = Path("~/.cache/hdr-rig/nodes")
NO_OPTIONS = NodeRequest()
OPTIONS = Asked(
    sim=Shown(how={"metavar": "NAME"}),
    profile=Shown(how={"metavar": "NAME"}),
    seed=Shown(how={"min": 0, "metavar": "N"}),
)


def node(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the node, as in RIG.toml: node = NAME.")
    ],
    ray: Annotated[
        Address,
        typer.Option(
            parser=address,
            metavar="HOST:PORT",
            help="The leader, where ray start --head runs, and its port.",
        ),
    ],
    disk: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            show_default=f"{DISK}/NAME",
            help="Folder for frames until the leader has fetched them.",
        ),
    ] = None,
    camera: CameraOption = None,
    request: Annotated[NodeRequest, OPTIONS] = NO_OPTIONS,
    as_json: JsonOption = False,
) -> CommandResult:
    """Serve the cameras of this host to the leader.

    Joins the Ray cluster (pip install -e '.[cluster]') of the leader, which captures with rig capture
    RIG.toml; this node then drives the cameras whose tables name it. Runs until Ctrl-C. Access to the cluster
    needs its token, which the first node creates; the traffic between the hosts is not encrypted.

    Example: rig node left --ray 192.168.1.10:6379
    """
    with ExitStack() as stack:
        with running("node") as status:
            settings = node_settings.settings_of(
                name=name,
                disk=(DISK / name if disk is None else disk).expanduser().absolute(),
                addresses=addresses_of(camera, None),
                **vars(request),
            )
            store.require_writable(settings.disk)
            status("looking for cameras", 0, 0)
            with closing(nodes.Node(node_settings.place_of(settings), nodes.Assignment(()))) as here:
                report = here.report()
            for one in report.strangers:
                status.say(f"{one.serial}  {one.make} {one.model}")
            for refused in report.refused:
                status.say(f"{refused}.")
            if not token.ask_for_token({**os.environ}):
                status.say(f"{token.MODE} is off: any program on this network can run programs on this host.")
            elif (made := token.make_token()) is not None:
                status.say(
                    f"A token was made, without which no host can connect: copy {made} to the same place on "
                    "every other host, and begin the cluster there, with RAY_AUTH_MODE=token."
                )
            status("joining", 0, 0)
            where = f"{ray[0]}:{ray[1]}"
            joined = stack.enter_context(joining.joined_as(settings, where))
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # leave in order, too
        lines = [f"Node {name} has left."]
        with suppress(KeyboardInterrupt, Stopped):  # Ctrl-C ends it well from the moment it is announced
            with running("node") as status:
                cameras = counted(len(report.strangers), "camera")
                status.say(f"Node {name} serves {cameras} to {where}; Ctrl-C ends it.")
            joined.wait_for_end()
            lines = [f"The Ray cluster at {where} is gone, and node {name} with it."]
    data = {"node": name, "ray": where, "cameras": [asdict(one) for one in report.strangers]}
    return CommandResult(data, lines)
