"""`rig simulate`: a simulated camera that other programs can shoot with."""

import re
import socket
import threading
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from typing import Annotated

import typer

from rig.options.common import JsonOption, SeedOption, WrongUsage
from rig.terminal.failures import Stopped
from rig.terminal.result import CommandResult, running
from rig.terminal.text import counted


class Address(tuple[str, int]):
    """Host and port."""


def address(text: str) -> Address:
    """`HOST:PORT`; typer.BadParameter otherwise."""
    match = re.fullmatch(r"([^\s:]+):(\d{1,5})", text.strip())
    if not match or int(match[2]) > 65535:
        raise typer.BadParameter("write an address as 127.0.0.1:15740")
    return Address((match[1], int(match[2])))


def simulate(
    context: typer.Context,
    ptpip: Annotated[
        Address | None,
        typer.Option(
            parser=address, metavar="HOST:PORT", help="Where to listen for PTP/IP; port 0 takes a free one."
        ),
    ] = None,
    gige: Annotated[
        str | None,
        typer.Option(
            metavar="IPV4",
            help="The address of this host, such as 127.0.0.2, to be a GigE Vision camera at instead.",
        ),
    ] = None,
    profile: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="The camera to simulate: generic, canon-eos-6d, canon-eos-r7, nikon-z6 or sony-a7m4.",
        ),
    ] = "generic",
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Simulate a PTP/IP or a GigE Vision camera.

    Serves the first camera of the rig demo to PTP/IP clients, such as gphoto2, or to GigE Vision hosts, such
    as Aravis, until Ctrl-C. There is no password: listen on 127.0.0.1 unless the network is your own. For a
    USB3 Vision camera the host would have to be a USB device, which rig does not make of it.

    Example: rig simulate --ptpip 127.0.0.1:15740 --profile nikon-z6
    """
    if (ptpip is None) == (gige is None):
        raise WrongUsage("give --ptpip HOST:PORT or --gige IPV4, one of them", context)
    if gige is not None:
        return _gige(gige, seed)
    assert ptpip is not None
    with ExitStack() as stack:
        with running("simulate") as status:
            from drivers.sim import rigs
            from drivers.sim.camera.camera import SimulatedCamera
            from drivers.sim.ptp import profiles
            from drivers.sim.ptp.ptpip import PtpIpServer, listen
            from drivers.sim.ptp.responder import Responder
            from drivers.sim.usb.timeline import LiveTimeline
            from imaging.errors import InputError

            body = profiles.profile(profile)
            try:
                listening = stack.enter_context(listen(*ptpip))
            except OSError as error:
                reason = str(error.strerror).partition(" (")[0]
                raise InputError(
                    f"{ptpip[0]}:{ptpip[1]} cannot be listened on ({reason}): choose another one."
                ) from error
            rig = rigs.simulate("demo", seed)
            status("rendering the scene", 0, 0)
            view = rig.radiance(0, 0)
            camera = SimulatedCamera(rig.bodies[0], lambda frame: view)
            responder = Responder(camera, body, stack.enter_context(closing(LiveTimeline())))
            # Of its own, as several of them may be the cameras of one rig.
            responder.serial = f"SIM-{profile.upper()}-{listening.getsockname()[1]}"
            server = stack.enter_context(PtpIpServer(responder, listening))
        with suppress(KeyboardInterrupt, Stopped):  # Ctrl-C ends it well from the moment it is announced
            with running("simulate") as status:
                status.say(
                    f'{body.model} is at {server.host}:{server.port}, try: gphoto2 --camera "PTP/IP Camera" '
                    f"--port ptpip:{server.host}:{server.port}:{server.port} --summary"
                )
            threading.Event().wait()
        shots = responder.shooting.shots
    data = {
        "profile": profile,
        "serial": responder.serial,
        "host": server.host,
        "port": server.port,
        "shots": shots,
    }
    return CommandResult(data, [f"{body.model} took {counted(shots, 'shot')}"])


def _gige(host: str, seed: int) -> CommandResult:
    """Be a GigE Vision camera at that address until Ctrl-C."""
    with ExitStack() as stack:
        with running("simulate") as status:
            from drivers.sim import rigs
            from drivers.sim.camera.camera import SimulatedCamera
            from drivers.sim.gige.clock import NetworkTime
            from drivers.sim.gige.device import GigeDevice
            from drivers.sim.usb.timeline import LiveTimeline
            from imaging.errors import InputError

            try:
                number = socket.inet_aton(host).hex()
            except OSError:
                raise InputError(f"{host!r} is no address: write one of this host as 127.0.0.2.") from None
            rig = rigs.simulate("demo", seed)
            status("rendering the scene", 0, 0)
            view = rig.radiance(0, 0)
            # A serial number of its own, as several may be in one rig.
            camera = SimulatedCamera(replace(rig.bodies[0], serial=f"SIM-{number}"), lambda frame: view)
            timeline = stack.enter_context(closing(LiveTimeline()))
            try:
                device = stack.enter_context(
                    GigeDevice(camera, timeline, host, network_time=NetworkTime(seed=seed))
                )
            except OSError as error:
                raise InputError(
                    f"{host} cannot be listened on at port 3956 ({error.strerror or error}): name an "
                    "address of this host at which no other camera is."
                ) from error
        with suppress(KeyboardInterrupt, Stopped):  # as above
            with running("simulate") as status:
                status.say(f"{device.serial} is at {host}, try: rig cameras --camera gige:{host}")
            threading.Event().wait()
        shots = len(device.opened)
    return CommandResult(
        {"gige": host, "serial": device.serial, "shots": shots},
        [f"{device.serial} took {counted(shots, 'shot')}"],
    )
