"""Every camera that is connected, whatever it speaks, and what it says of itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from usb.backend import IBackend

from drivers import gige, plugins, ptp, u3v
from drivers.camera import Camera, CameraIdentity, Capabilities
from drivers.clock import Clock
from drivers.gige import Network
from imaging.errors import CameraError, RigError
from imaging.progress import Progress, unreported


@dataclass(frozen=True)
class ConnectedCamera:
    """One connected camera; `error` says why it could not be asked for what is then None.

    protocol: PTP, PTP/IP, USB3 Vision, GigE Vision, or the name of a plug-in.
    verified: what our driver for its make has been tried against.
    """

    protocol: str
    where: str
    identity: CameraIdentity | None = None
    capabilities: Capabilities | None = None
    verified: str = ""
    error: str = ""

    @property
    def trouble(self) -> str:
        """Why it cannot shoot for rig, as a sentence; empty where it can."""
        if self.error or self.capabilities is None or not self.capabilities.obstacle:
            return self.error
        assert self.identity is not None  # it was asked before what it can do
        name = f"{self.identity.make} {self.identity.model} {self.identity.serial}"
        return f"{name} cannot shoot for rig: {self.capabilities.obstacle}."


Places = Sequence[tuple[str, int]]
"""Host and port of each PTP/IP camera: nothing finds them by itself."""


def find_cameras(
    backend: IBackend, clock: Clock, network: Network | None = None, places: Places = ()
) -> list[Camera]:
    """A driver for every camera on the USB, at these places and, where a network is given, there and of
    plug-ins, not open.

    A plug-in that fails has no cameras here; `ask_all` says why.
    """
    found = (camera for _, camera in _by_protocol(backend, clock, network, places))
    return [camera for camera in found if not isinstance(camera, CameraError)]


def _by_protocol(
    backend: IBackend, clock: Clock, network: Network | None, places: Places
) -> Iterator[tuple[str, Camera | CameraError]]:
    for still in ptp.find_cameras(backend, clock):
        yield "PTP", still
    for still in ptp.cameras_at(places, clock):
        yield "PTP/IP", still
    for machine in u3v.find_cameras(backend, clock):
        yield "USB3 Vision", machine
    if network is None:  # a simulated bus has nothing beside it
        return
    for remote in gige.find_cameras(network, clock):
        yield "GigE Vision", remote
    yield from plugins.find_cameras(clock)


def ask_all(
    backend: IBackend,
    clock: Clock,
    progress: Progress = unreported,
    *,
    network: Network | None = None,
    places: Places = (),
) -> Iterator[ConnectedCamera]:
    """Open each camera on the USB, the network, at these places and of plug-ins, ask what it is, close it."""
    progress("looking for cameras", 0, 0)
    found = list(_by_protocol(backend, clock, network, places))
    for done, (protocol, camera) in enumerate(found):
        if isinstance(camera, CameraError):
            yield ConnectedCamera(protocol, "", error=str(camera))
            continue
        progress(camera.where or protocol, done, len(found))
        where, identity = camera.where, None
        try:
            identity = camera.identify()
            verified = camera.verified()
            listed = ConnectedCamera(protocol, where, identity, camera.capabilities(), verified)
        except RigError as error:
            listed = ConnectedCamera(protocol, where, identity, error=str(error))
        finally:
            camera.close()
        yield listed
