"""Every camera that is connected, whatever it speaks, and what it says of itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from usb.backend import IBackend

from drivers import choice, gentl, gige, plugins, u3v
from drivers.at_once import Call
from drivers.camera import Camera, CameraIdentity, Capabilities
from drivers.choice import Place
from drivers.clock import Clock
from drivers.gige import Network
from imaging.errors import CameraError, RigError
from imaging.progress import Progress, unreported

_REMOTE = ("PTP/IP", "GigE Vision")
"""Protocols whose cameras are asked side by side."""


@dataclass(frozen=True)
class ConnectedCamera:
    """One connected camera; `error` says why it could not be asked for what is then None.

    protocol: PTP, PTP/IP, libgphoto2, USB3 Vision, GigE Vision, GenTL, or the name of a plug-in.
    verified: what our driver for its make has been tried against. chosen: which driver it got, and why, where
    there are two.
    """

    protocol: str
    where: str
    identity: CameraIdentity | None = None
    capabilities: Capabilities | None = None
    verified: str = ""
    chosen: str = ""
    error: str = ""

    @property
    def trouble(self) -> str:
        """Reason why it cannot shoot for rig, as a sentence; empty if it can."""
        if self.error or self.capabilities is None or not self.capabilities.obstacle:
            return self.error
        assert self.identity is not None  # it was asked before what it can do
        name = f"{self.identity.make} {self.identity.model} {self.identity.serial}"
        return f"{name} cannot shoot for rig: {self.capabilities.obstacle}."


def find_cameras(
    backend: IBackend, clock: Clock, network: Network | None = None, places: Sequence[Place] = ()
) -> list[Camera]:
    """A driver for every connected camera, not open.

    A plug-in or a GenTL producer that fails has no cameras here; `ask_all` says why.

    Args:
        backend: USB bus.
        clock: Clock of the drivers.
        network: Network whose cameras are found too, with those of GenTL producers, of plug-ins and of
            libgphoto2; None: only cameras on the USB and at `places`.
        places: Addresses of PTP/IP cameras.

    Returns:
        The drivers of the cameras, by protocol.

    Raises:
        CameraError: The USB or libgphoto2 cannot list its cameras.
    """
    cameras = (camera for _, camera, _ in _by_protocol(backend, clock, network, places))
    return [camera for camera in cameras if not isinstance(camera, CameraError)]


def _by_protocol(
    backend: IBackend, clock: Clock, network: Network | None, places: Sequence[Place]
) -> Iterator[tuple[str, Camera | CameraError, str]]:
    """Protocol, driver or the reason for its absence, and the reason for the choice."""
    # A simulated bus has no network, and none of this machine's cameras, beside it.
    yield from choice.find_cameras(backend, clock, places, library=network is not None)
    serials = set()
    for machine in u3v.find_cameras(backend, clock):
        serials.add(machine.serial)
        yield "USB3 Vision", machine, ""
    if network is None:
        return
    for remote in gige.find_cameras(network, clock):
        serials.add(remote.serial)
        yield "GigE Vision", remote, ""
    producers: dict[str, gentl.Producer] = {}
    for made in gentl.find_cameras(clock):
        if not isinstance(made, CameraError):
            # A producer finds those above, too, and those of other producers.
            first = producers.setdefault(made.serial, made.producer)
            if made.serial in serials or first is not made.producer:
                continue
        yield "GenTL", made, ""
    for name, other in plugins.find_cameras(clock):
        yield name, other, ""


def ask_all(
    backend: IBackend,
    clock: Clock,
    progress: Progress = unreported,
    *,
    network: Network | None = None,
    places: Sequence[Place] = (),
) -> Iterator[ConnectedCamera]:
    """Open each connected camera, ask what it is, close it.

    Args:
        backend: USB bus.
        clock: Clock of the drivers.
        progress: Callback for the address of the current camera, the cameras asked, and all of them.
        network: Network whose cameras are asked too, with those of GenTL producers, of plug-ins and of
            libgphoto2; None: only cameras on the USB and at `places`.
        places: Addresses of PTP/IP cameras.

    Returns:
        An iterator over the cameras; one that fails is there with its error, and so is a plug-in or a GenTL
        producer without cameras to offer.

    Raises:
        CameraError: The USB or libgphoto2 cannot list its cameras.
    """
    progress("looking for cameras", 0, 0)
    cameras = list(_by_protocol(backend, clock, network, places))
    # Those of a network are apart from one another, and each may take its time, or 5 s not to answer.
    calls = {
        number: Call(partial(_asked, protocol, camera, chosen))
        for number, (protocol, camera, chosen) in enumerate(cameras)
        if protocol in _REMOTE and not isinstance(camera, CameraError)
    }
    for done, (protocol, camera, chosen) in enumerate(cameras):
        if isinstance(camera, CameraError):
            yield ConnectedCamera(protocol, "", error=str(camera))
            continue
        progress(camera.where or protocol, done, len(cameras))
        yield calls[done].result() if done in calls else _asked(protocol, camera, chosen)


def _asked(protocol: str, camera: Camera, chosen: str) -> ConnectedCamera:
    """Open a camera, ask what it is, and close it."""
    where, identity = camera.where, None
    try:
        identity = camera.identify()
        verified = camera.verified()
        return ConnectedCamera(protocol, where, identity, camera.capabilities(), verified, chosen)
    except RigError as error:
        return ConnectedCamera(protocol, where, identity, error=str(error))
    finally:
        camera.close()
