"""USB as the drivers see it: pyusb behind our own errors, with any pyusb backend.

Everything that speaks to a camera on USB goes through `UsbPipe`; a simulated bus is another backend.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import usb.core
import usb.util
from usb.backend import IBackend

from drivers.errors import (
    CameraClaimed,
    CameraLost,
    CameraPermission,
    CameraProtocol,
    CameraTimeout,
)
from drivers.holders import holders
from imaging.and_list import and_list
from imaging.errors import CameraError

RULES = "70-hdr-rig.rules"
"""The udev rules that let users of group `plugdev`, and the user at the machine, open cameras."""


class EndpointStalled(CameraProtocol):
    """The camera halted an endpoint (or refused a control request); the driver clears it."""


@dataclass(frozen=True)
class InterfaceKind:
    """Class, subclass and protocol of a USB interface."""

    number: int
    subclass: int
    protocol: int


STILL_IMAGE = InterfaceKind(0x06, 0x01, 0x01)
"""PTP (USB Still Image Capture Device Definition 1.0)."""
U3V_CONTROL = InterfaceKind(0xEF, 0x05, 0x00)
U3V_STREAM = InterfaceKind(0xEF, 0x05, 0x02)
"""USB3 Vision; protocol 1 would be events."""


def default_backend() -> IBackend:
    """libusb 1.0: that of the system, else the one in the libusb-package wheel."""
    import libusb_package

    return libusb_package.get_libusb1_backend()


def find(kind: InterfaceKind, backend: IBackend) -> list["UsbDevice"]:
    """Every connected device with an interface of that kind, in order of bus and address; none is opened.

    A device whose descriptors cannot be read is left out.
    """
    with errors_translated("The USB"):
        devices = list(usb.core.find(find_all=True, backend=backend) or ())
    matching = [UsbDevice(device, interface) for device in devices for interface in _interfaces(device, kind)]
    return sorted(matching, key=lambda match: (match.device.bus or 0, match.device.address or 0))


def _interfaces(device: Any, kind: InterfaceKind) -> list[Any]:
    """Interfaces of the kind, each once; empty if its descriptors cannot be read."""
    wanted = (kind.number, kind.subclass, kind.protocol)
    try:
        interfaces = [one for configuration in device for one in configuration if not one.bAlternateSetting]
    except (usb.core.USBError, NotImplementedError):
        return []
    return [
        one
        for one in interfaces
        if wanted == (one.bInterfaceClass, one.bInterfaceSubClass, one.bInterfaceProtocol)
    ]


@dataclass(frozen=True, eq=False)
class UsbDevice:
    """A device on the bus and one of its interfaces; nothing is claimed before `open`."""

    device: Any
    interface: Any

    @property
    def where(self) -> str:
        """Name of the place for messages: `USB 001:007 (04b0:0444)`."""
        device = self.device
        place = f"{device.bus or 0:03d}:{device.address or 0:03d}"
        return f"USB {place} ({device.idVendor:04x}:{device.idProduct:04x})"

    def serial(self) -> str | None:
        """The serial number of the USB descriptor, if there is one and it can be read."""
        try:
            with errors_translated(self.where):
                return usb.util.get_string(self.device, self.device.iSerialNumber) or None
        except (CameraError, ValueError):
            return None

    def open(self) -> "UsbPipe":
        """Claim the interface. CameraPermission, CameraClaimed, CameraLost."""
        try:
            with errors_translated(self.where):
                return UsbPipe(self)
        except CameraClaimed as error:
            programs = holders(self.device)
            if not programs:
                raise
            raise CameraClaimed(
                f"{self.where} is held by {and_list(programs)}: unmount it in the file manager, or close "
                "that program."
            ) from error


class UsbPipe:
    """A claimed interface: its endpoints, read and written whole transfers at a time.

    Errors of all methods: CameraTimeout, CameraLost, EndpointStalled, CameraProtocol (overflow or a broken
    transfer), CameraClaimed, CameraPermission. Time-outs in seconds.
    """

    def __init__(self, device: UsbDevice) -> None:
        self.where = device.where
        self._device, self._number = device.device, device.interface.bInterfaceNumber
        usb.util.claim_interface(self._device, self._number)
        self.endpoints: tuple[Any, ...] = tuple(device.interface)

    def endpoint(self, *, into_host: bool, interrupt: bool = False) -> Any:
        """The first endpoint of a direction and kind; CameraProtocol if the interface has none."""
        direction = usb.util.ENDPOINT_IN if into_host else usb.util.ENDPOINT_OUT
        kind = usb.util.ENDPOINT_TYPE_INTR if interrupt else usb.util.ENDPOINT_TYPE_BULK
        for endpoint in self.endpoints:
            address, attributes = endpoint.bEndpointAddress, endpoint.bmAttributes
            if (
                usb.util.endpoint_direction(address) == direction
                and usb.util.endpoint_type(attributes) == kind
            ):
                return endpoint
        raise CameraProtocol(
            f"{self.where} lacks an endpoint that its interface must have: it is not usable."
        )

    def read(self, endpoint: Any, size: int, timeout: float) -> bytes:
        """Return what arrives in one transfer, at most `size` bytes, rounded up to whole packets."""
        packet = endpoint.wMaxPacketSize or 1
        with errors_translated(self.where):
            return bytes(endpoint.read(-(-size // packet) * packet, milliseconds(timeout)))

    def read_into(self, endpoint: Any, buffer: Any, timeout: float) -> int:
        """Fill an `array.array('B')`, whole packets long; returns how many bytes came."""
        with errors_translated(self.where):
            return int(endpoint.read(buffer, milliseconds(timeout)))

    def write(self, endpoint: Any, data: bytes, timeout: float) -> int:
        """One transfer; returns how many bytes went. An empty one is a zero-length packet."""
        with errors_translated(self.where):
            return int(endpoint.write(data, milliseconds(timeout)))

    def control_in(self, request_type: int, request: int, value: int, size: int, timeout: float) -> bytes:
        """A control transfer to the host, on this interface."""
        with errors_translated(self.where):
            answer = self._device.ctrl_transfer(
                request_type, request, value, self._number, size, milliseconds(timeout)
            )
            return bytes(answer)

    def control_out(self, request_type: int, request: int, value: int, data: bytes, timeout: float) -> None:
        """A control transfer to the camera, on this interface."""
        with errors_translated(self.where):
            self._device.ctrl_transfer(
                request_type, request, value, self._number, data, milliseconds(timeout)
            )

    def clear_halt(self, endpoint: Any) -> None:
        """Let a halted endpoint go on."""
        with errors_translated(self.where):
            endpoint.clear_halt()

    def reset(self) -> None:
        """Reset the device; it has to be found and opened again."""
        with errors_translated(self.where):
            self._device.reset()

    def close(self) -> None:
        """Let go; a second time, or of a camera that is gone, does nothing."""
        usb.util.dispose_resources(self._device)


def milliseconds(seconds: float) -> int:
    """A time-out as USB has it; never 0, which would mean for ever."""
    return max(1, round(1000 * seconds))


_BY_NUMBER: dict[int, Callable[[str], CameraError]] = {
    13: lambda where: CameraPermission(
        f"{where} may not be opened by this user: install the udev rules file {RULES} that `rig doctor` "
        "names, then unplug the camera and plug it in again."
    ),
    16: lambda where: CameraClaimed(
        f"{where} is held by another program: unmount it in the file manager and close tethering programs."
    ),
    19: lambda where: CameraLost(f"{where} is no longer there: plug the camera in again and wake it up."),
    32: lambda where: EndpointStalled(f"{where} halted the transfer: switch the camera off and on again."),
    75: lambda where: CameraProtocol(f"{where} sent more than was asked for: reset the camera."),
    110: lambda where: CameraTimeout(f"{where} does not answer: wake the camera up or reset it."),
}


@contextmanager
def errors_translated(where: str) -> Iterator[None]:
    """Turn pyusb's errors into ours."""
    try:
        yield
    except usb.core.NoBackendError as error:
        raise CameraError("libusb is missing: install libusb 1.0, or the package libusb-package.") from error
    except usb.core.USBError as error:
        make = _BY_NUMBER.get(error.errno or 0)
        if make is None:
            raise CameraProtocol(f"{where}: the transfer broke off ({error.strerror}): try again.") from error
        raise make(where) from error
    except NotImplementedError as error:
        raise CameraProtocol(f"{where}: libusb cannot do this here: use another USB port.") from error
