"""A camera under its serial number: opened, lost, and found again at whatever address it has then."""

from typing import Literal, Protocol

from usb.backend import IBackend
from usb.util import dispose_resources

from drivers import usb
from drivers.camera import CameraIdentity
from drivers.clock import Clock
from drivers.errors import CameraGone, CameraLost
from drivers.ptp.protocol.codes import USB_VENDORS, CanonOperation, SonyOperation, VendorId
from drivers.ptp.protocol.session import PtpSession
from drivers.ptp.protocol.transport import UsbTransport
from drivers.ptp.vendors.canon import CanonBody
from drivers.ptp.vendors.nikon import NikonBody
from drivers.ptp.vendors.sony import SonyBody
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import CameraError

REPLUG_SECONDS = 10.0
"""Seconds for which a camera that vanished is looked for."""
_LOOK_EVERY = 0.1


_NAMES = {"nikon": VendorId.NIKON, "canon": VendorId.CANON, "sony": VendorId.SONY}
"""Makers by the first word of DeviceInfo's manufacturer."""


class Connection(Protocol):
    """Connection to one camera, at whatever address. `identity` is None before it was first opened."""

    where: str
    identity: CameraIdentity | None

    def open(self) -> StandardBody:
        """Open a session and take control. CameraGone if it does not come back, and all CameraErrors."""
        ...


def body_for(session: PtpSession, usb_vendor: int | None) -> StandardBody:
    """The layer for a make, if the body lists its operations.

    By DeviceInfo's vendor extension; where that does not say by USB vendor id, or by the maker's name for a
    body that is not on USB.
    """
    vendor = session.info.vendor_extension
    if vendor not in (VendorId.NIKON, VendorId.CANON, VendorId.SONY):
        if usb_vendor is None:
            vendor = _NAMES.get(session.info.manufacturer.partition(" ")[0].lower(), vendor)
        else:
            vendor = USB_VENDORS.get(usb_vendor, vendor)
    if vendor == VendorId.NIKON:
        return NikonBody(session)
    if vendor == VendorId.CANON and session.supports(CanonOperation.SET_REMOTE_MODE):
        return CanonBody(session)
    if vendor == VendorId.SONY and session.supports(SonyOperation.SDIO_CONNECT):
        return SonyBody(session)
    return StandardBody(session)


def identified(
    session: PtpSession, usb_vendor: int | None, serial: str
) -> tuple[StandardBody, CameraIdentity]:
    """The layer for a body whose session is open, and who it is; `serial` where it does not say."""
    info, body = session.info, body_for(session, usb_vendor)
    kind: Literal["raw", "ldr"] = "raw" if body.delivers_raw() else "ldr"
    return body, CameraIdentity(info.serial or serial, info.manufacturer, info.model, kind)


class UsbConnection:
    """The way to a camera on the USB, wherever it is plugged in."""

    def __init__(self, device: usb.UsbDevice, backend: IBackend, clock: Clock) -> None:
        self._connected: usb.UsbDevice | None = device
        self._backend, self._clock = backend, clock
        self._usb = (device.device.idVendor, device.device.idProduct)
        self._usb_serial: str | None = None
        self.where = device.where
        self.identity: CameraIdentity | None = None

    def open(self) -> StandardBody:
        """Open a session and take control; after the first time, wherever the camera is now.

        CameraGone if it does not come back, and all other CameraErrors.
        """
        if self._connected is None:
            return self._searched()
        try:
            body = self._opened(self._connected)
        except CameraLost:
            self._connected = None
            raise
        self._connected = None
        return body

    def _searched(self) -> StandardBody:
        """The camera wherever it is; what kept it from being opened there, if it does not come back."""
        end, refused = self._clock.now() + REPLUG_SECONDS, None
        while True:
            for device in usb.find(usb.STILL_IMAGE, self._backend):
                if self._may_be(device):
                    try:
                        return self._opened(device)
                    except CameraError as error:
                        refused = error
            if self._clock.now() >= end:
                if refused is not None:
                    raise refused
                name = self.identity.serial if self.identity else self.where
                raise CameraGone(f"Camera {name} is no longer there: plug it in again and wake it up.")
            self._clock.sleep(_LOOK_EVERY)

    def _may_be(self, device: usb.UsbDevice) -> bool:
        """Return whether it looks the same from outside; others may be in use and are not touched.

        A camera that never stated a serial number cannot be distinguished from others of its model.
        """
        same = (device.device.idVendor, device.device.idProduct) == self._usb
        if self._usb_serial is None:
            return same and self.identity is not None
        return same and device.serial() == self._usb_serial

    def _opened(self, device: usb.UsbDevice) -> StandardBody:
        """CameraLost if it is another camera than this connection's."""
        usb_serial = device.serial()
        if self.identity is None and usb_serial is not None:
            # Known from now on, so that a plug pulled before the first answer does not cost the camera.
            self._usb_serial = usb_serial
        try:
            pipe = device.open()
        except CameraError:
            dispose_resources(device.device)  # asking for the serial number opened it
            raise
        try:
            session = PtpSession(UsbTransport(pipe, self._clock), self._clock)
            session.open()
            body, identity = identified(session, self._usb[0], usb_serial or device.where)
            if self.identity is not None and identity.serial != self.identity.serial:
                raise CameraLost(f"{device.where} is camera {identity.serial}, not {self.identity.serial}.")
            self.identity = identity
            self._usb_serial, self.where = usb_serial, device.where
            body.enter()
        except BaseException:
            pipe.close()
            raise
        return body
