"""An opened USB3 Vision device: both of its pipes, its registers, features and stream."""

from typing import Any

from usb.backend import IBackend

from drivers.clock import Clock
from drivers.errors import CameraNotFound, CameraRefused
from drivers.genicam.chunks import ByteOrder
from drivers.genicam.nodemap import NodeMap
from drivers.u3v.control import ControlChannel
from drivers.u3v.registers import AbrmClock, Bootstrap, read_bootstrap, read_xml
from drivers.u3v.stream import StreamChannel
from drivers.usb import U3V_CONTROL, U3V_STREAM, UsbDevice, find
from imaging.errors import CameraError


def connected(backend: IBackend) -> dict[str, UsbDevice]:
    """The devices by serial number, by bus and address; those that may not be opened are left out."""
    by_serial: dict[str, UsbDevice] = {}
    for device in find(U3V_CONTROL, backend):
        serial = device.serial()
        if serial is not None:
            by_serial.setdefault(serial, device)
    return by_serial


class U3vSession:
    """The device from open to close; errors are those of its parts."""

    control: ControlChannel
    bootstrap: Bootstrap
    nodes: NodeMap
    stream: StreamChannel
    device_clock: AbrmClock
    chunk_order: ByteOrder = "little"

    def __init__(self, device: UsbDevice, clock: Clock) -> None:
        self.where = device.where
        self._control_pipe = device.open()
        try:
            self.control = control = ControlChannel(self._control_pipe, clock)
            self.bootstrap = read_bootstrap(control)
            self.make, self.model = self.bootstrap.manufacturer, self.bootstrap.model
            self.device_clock = AbrmClock(control)
            if self.bootstrap.sirm is None:
                raise CameraRefused(f"{self.where} cannot stream: it is no camera that can be used.")
            self.nodes = NodeMap(read_xml(control, self.bootstrap.manifest), control, self.where)
            pipe = UsbDevice(device.device, self._stream_interface(device.device)).open()
            self.stream = StreamChannel(pipe, control, self.bootstrap.sirm, clock)
        except CameraError:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the device; a second time does nothing."""
        self._control_pipe.close()

    def _stream_interface(self, device: Any) -> Any:
        """The streaming interface of the same device, so that both share what was opened."""
        wanted = (U3V_STREAM.number, U3V_STREAM.subclass, U3V_STREAM.protocol)
        for configuration in device:
            for interface in configuration:
                if wanted == (
                    interface.bInterfaceClass,
                    interface.bInterfaceSubClass,
                    interface.bInterfaceProtocol,
                ):
                    return interface
        raise CameraRefused(f"{self.where} has no streaming interface: it is no camera that can be used.")


def open_session(serial: str, backend: IBackend, clock: Clock, patience: float = 0.0) -> U3vSession:
    """Open the device with that serial number; it may take `patience` s to appear. CameraNotFound."""
    deadline = clock.now() + patience
    while True:
        device = connected(backend).get(serial)
        if device is not None:
            return U3vSession(device, clock)
        if clock.now() >= deadline:
            raise CameraNotFound(f"camera {serial} is not connected: plug it in.")
        clock.sleep(min(0.1, max(deadline - clock.now(), 0.001)))
