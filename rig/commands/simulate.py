"""`rig simulate`: a simulated camera that other programs can shoot with."""

import re
import socket
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from typing import Annotated

import typer

from drivers.sim import rigs
from drivers.sim.camera import camera as cameras
from drivers.sim.gige import clock
from drivers.sim.gige import device as gige_devices
from drivers.sim.ptp import profiles, usb_device
from drivers.sim.ptp import ptpip as ptp_ip
from drivers.sim.ptp import responder as responders
from drivers.sim.u3v import device as u3v_devices
from drivers.sim.usb import bus as buses
from drivers.sim.usb import timeline as timelines
from drivers.sim.usb.usbip import packets
from drivers.sim.usb.usbip import server as usb_ip
from imaging.errors import InputError
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
            parser=address,
            metavar="HOST:PORT",
            help="Address to listen on for PTP/IP; port 0 uses a free one.",
        ),
    ] = None,
    gige: Annotated[
        str | None,
        typer.Option(
            metavar="IPV4",
            help="Simulate a GigE Vision camera at this address of the host, such as 127.0.0.2, instead.",
        ),
    ] = None,
    usbip: Annotated[
        Address | None,
        typer.Option(
            parser=address,
            metavar="HOST:PORT",
            help="Address to listen on for USB/IP instead, through which Linux attaches the camera as a USB "
            "device; the usual port is 3240.",
        ),
    ] = None,
    profile: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="The still camera to simulate: generic (for --ptpip the default), canon-eos-6d, "
            "canon-eos-r7, nikon-z6 or sony-a7m4; without it, --usbip is a USB3 Vision camera.",
        ),
    ] = None,
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> CommandResult:
    """Simulate a camera.

    Serves the first camera of the rig demo to PTP/IP clients, such as gphoto2, to GigE Vision hosts, such as
    Aravis, or over USB/IP to any Linux host as a USB3 Vision or a USB still camera, until Ctrl-C. There is no
    password: listen on 127.0.0.1 unless the network is your own.

    Example: rig simulate --ptpip 127.0.0.1:15740 --profile nikon-z6
    """
    if (ptpip, gige, usbip).count(None) != 2:
        raise WrongUsage("give --ptpip HOST:PORT, --gige IPV4 or --usbip HOST:PORT, one of them", context)
    if gige is not None:
        if profile is not None:
            raise WrongUsage("--profile is for --ptpip and --usbip", context)
        return _gige(gige, seed)
    if usbip is not None:
        return _usbip(usbip, profile, seed)
    assert ptpip is not None
    return _ptpip(ptpip, profile or "generic", seed)


def _listening(where: Address, listen: Callable[[str, int], socket.socket]) -> socket.socket:
    """The socket of a server there. InputError."""
    try:
        return listen(*where)
    except OSError as error:
        reason = str(error.strerror).partition(" (")[0]
        raise InputError(
            f"{where[0]}:{where[1]} cannot be opened for listening ({reason}): choose another one."
        ) from error


def _ptpip(where: Address, profile: str, seed: int) -> CommandResult:
    """Be a still camera on the network until Ctrl-C."""
    with ExitStack() as stack:
        with running("simulate") as status:
            body = profiles.profile(profile)
            listening = stack.enter_context(_listening(where, ptp_ip.listen))
            rig = rigs.simulate("demo", seed)
            status("rendering the scene", 0, 0)
            view = rig.radiance(0, 0)
            camera = cameras.SimulatedCamera(rig.bodies[0], lambda frame: view)
            responder = responders.Responder(
                camera, body, stack.enter_context(closing(timelines.LiveTimeline()))
            )
            # Of its own, as several of them may be the cameras of one rig.
            responder.serial = f"SIM-{profile.upper()}-{listening.getsockname()[1]}"
            server = stack.enter_context(ptp_ip.PtpIpServer(responder, listening))
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
            try:
                number = socket.inet_aton(host).hex()
            except OSError:
                raise InputError(
                    f"{host!r} is not an address: write one of this host, such as 127.0.0.2."
                ) from None
            rig = rigs.simulate("demo", seed)
            status("rendering the scene", 0, 0)
            view = rig.radiance(0, 0)
            # A serial number of its own, as several may be in one rig.
            camera = cameras.SimulatedCamera(
                replace(rig.bodies[0], serial=f"SIM-{number}"), lambda frame: view
            )
            timeline = stack.enter_context(closing(timelines.LiveTimeline()))
            try:
                device = stack.enter_context(
                    gige_devices.GigeDevice(camera, timeline, host, network_time=clock.NetworkTime(seed=seed))
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


def _usbip(where: Address, profile: str | None, seed: int) -> CommandResult:
    """Be a camera on the USB of the hosts that attach it until Ctrl-C: a still one, or without a profile USB3
    Vision.
    """
    with ExitStack() as stack:
        with running("simulate") as status:
            body = None if profile is None else profiles.profile(profile)
            listening = stack.enter_context(_listening(where, usb_ip.listen))
            host, port = listening.getsockname()
            serial = f"SIM-{socket.inet_aton(host).hex()}-{port}"  # of its own, as above
            rig = rigs.simulate("demo", seed)
            status("rendering the scene", 0, 0)
            view = rig.radiance(0, 0)
            camera = cameras.SimulatedCamera(replace(rig.bodies[0], serial=serial), lambda frame: view)
            timeline = stack.enter_context(closing(timelines.LiveTimeline()))
            bus = buses.VirtualBus(timeline)
            device: u3v_devices.U3vDevice | usb_device.PtpDevice = (
                u3v_devices.U3vDevice(camera, timeline)
                if body is None
                else usb_device.PtpDevice(responders.Responder(camera, body, timeline))
            )
            bus.plug(device)
            server = stack.enter_context(usb_ip.UsbIpServer(bus, listening))
            (bus_id,) = server.bus_ids()
        with suppress(KeyboardInterrupt, Stopped):  # as above
            with running("simulate") as status:
                at_port = "" if port == packets.PORT else f"--tcp-port {port} "
                status.say(
                    f"{serial} is at {host}:{port}, try as root: modprobe vhci-hcd && "
                    f"usbip {at_port}attach -r {host} -b {bus_id}"
                )
            threading.Event().wait()
        shots = (
            len(device.opened)
            if isinstance(device, u3v_devices.U3vDevice)
            else device.responder.shooting.shots
        )
    data = {
        "usbip": bus_id,
        "profile": profile,
        "serial": serial,
        "host": host,
        "port": port,
        "shots": shots,
    }
    return CommandResult(data, [f"{serial} took {counted(shots, 'shot')}"])
