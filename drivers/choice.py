"""Choice between two drivers of a still camera, rig's own PTP and libgphoto2, by what each can do with it."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import NamedTuple

from usb.backend import IBackend

from drivers import ptp
from drivers.at_once import all_at_once
from drivers.camera import Camera
from drivers.clock import Clock
from drivers.errors import CameraRefused
from drivers.gphoto2 import camera as gphoto2
from drivers.gphoto2.library import is_installed
from imaging.errors import CameraError

BY_RIG = "rig's own PTP, which can set and trigger it"
UNKNOWN = "libgphoto2, since rig's own PTP driver does not know the handshake of this make"
ALONE = "rig's own PTP in its standard form, as libgphoto2 cannot set and trigger it"
ONLY = "libgphoto2, as it is no PTP camera"
NAMED = "libgphoto2, as it is named"


class Place(NamedTuple):
    """Address of a PTP/IP camera, which discovery cannot find. library: drive it by libgphoto2."""

    host: str
    port: int
    library: bool = False


def find_cameras(
    backend: IBackend, clock: Clock, places: Sequence[Place], *, library: bool
) -> Iterator[tuple[str, Camera, str]]:
    """Protocol, driver, and why it is that one, for each still camera on the USB and at some addresses.

    Where libgphoto2 is installed and may be asked, and both drivers know a camera, that is opened and asked.

    Args:
        backend: USB bus.
        clock: Clock of the drivers.
        places: Addresses of PTP/IP cameras.
        library: True if libgphoto2 may be asked.

    Returns:
        An iterator over the cameras. The reason is empty where there was no choice.

    Raises:
        CameraError: The USB or libgphoto2 cannot list its cameras.
    """
    library = library and is_installed()
    known = {one.port: one for one in gphoto2.find_cameras(clock)} if library else {}
    for camera in ptp.find_cameras(backend, clock):
        other = known.pop(_port_of(camera.where), None)
        yield "PTP", *chosen(camera, other)
    for remote, why in all_at_once(partial(_at, place, clock, library) for place in places):
        yield "PTP/IP", remote, why
    for other in known.values():
        yield "libgphoto2", other, ONLY


def _at(place: Place, clock: Clock, library: bool) -> tuple[Camera, str]:
    """Driver of the camera at a place, and why it is that one."""
    (camera,) = ptp.cameras_at([place[:2]], clock)
    (other,) = gphoto2.cameras_at([place[:2]], clock)
    return (other, NAMED) if place.library else chosen(camera, other if library else None)


def chosen(camera: ptp.PtpCamera, other: Camera | None) -> tuple[Camera, str]:
    """The driver that can set and trigger the camera, and why: its own where that knows the make.

    A body of another make may list the standard's order to expose and yet want a handshake first, which
    libgphoto2 may know. A camera that cannot be asked stays with its own driver, which says what is wrong.
    """
    lacks = None if other is None else _obstacle(camera)
    if lacks is None or other is None:
        return camera, ""
    if not lacks and camera.knows_make():
        return camera, BY_RIG
    camera.close()  # libgphoto2 has to have the camera to itself
    able = _obstacle(other) == ""
    other.close()
    if not able:
        return camera, "" if lacks else ALONE
    why = lacks.partition(":")[0]  # without the fix, which is not needed
    return other, f"libgphoto2, as rig's own PTP finds that {why}" if lacks else UNKNOWN


def _obstacle(camera: Camera) -> str | None:
    """Return why it cannot shoot for rig, empty where it can; None where it cannot be asked."""
    try:
        return camera.capabilities().obstacle
    except CameraRefused as error:
        return str(error).rstrip(".")
    except CameraError:
        return None


def _port_of(where: str) -> str:
    """Return what libgphoto2 calls the device that `drivers.usb.UsbDevice.where` names."""
    return f"usb:{where.removeprefix('USB ')[:7].replace(':', ',')}"
