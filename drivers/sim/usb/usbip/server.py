"""A USB/IP server of the virtual bus: Linux attaches its devices with `usbip attach`, as if on USB."""

import math
import socket
import threading

from drivers.sim.serving import Refused, TcpServer, exactly, hang_up
from drivers.sim.usb.bus import BUS_NUMBER, VirtualBus
from drivers.sim.usb.port import Device, Port
from drivers.sim.usb.usbip import packets
from drivers.sim.usb.usbip.packets import Submit, Unlink
from drivers.sim.usb.usbip.transfers import Transfers

_PATIENCE = 10.0
"""Seconds that a request may take: the client is unidentified until then."""
_GRACE = 1.0
"""Seconds in which a client that has hung up is noticed."""
_MOST_DATA = 1 << 24
"""Bytes of the longest transfer to a device, and of the answers that a client may leave unread."""


def listen(host: str = "127.0.0.1", port: int = packets.PORT) -> socket.socket:
    """Open the socket of a server, by default on loopback; port 0 takes a free one. OSError."""
    return socket.create_server((host, port))


class UsbIpServer(TcpServer):
    """Serves the devices of a bus on a live timeline until it is closed, each to one client at a time.

    A device that a client lets go is reset; one that is unplugged hangs up on its client, and has the same
    bus id when it is back.
    """

    def __init__(self, bus: VirtualBus, listening: socket.socket) -> None:
        """listening: of `listen`; it is closed with the server."""
        self._bus, self._timeline = bus, bus.timeline
        self._sockets: list[Device] = []
        """Devices that were plugged in at some time, each into a socket of its own."""
        self._attached: set[str] = set()
        super().__init__(listening, "usbip")

    def bus_ids(self) -> dict[str, str]:
        """The serial numbers of what is plugged in, by bus id."""
        with self._timeline.lock:
            return {bus_id: port.device.description.serial for bus_id, port in self._ports().items()}

    def _ports(self) -> dict[str, Port]:
        return {f"{BUS_NUMBER}-{self._socket(port.device)}": port for port in self._bus.enumerate_devices()}

    def _socket(self, device: Device) -> int:
        """The number of the device's socket, from 1."""
        for number, known in enumerate(self._sockets, 1):
            if known is device:
                return number
        self._sockets.append(device)
        return len(self._sockets)

    def _serve(self, link: socket.socket) -> None:
        link.settimeout(_PATIENCE)
        request = packets.request_of(exactly(link, packets.REQUEST_SIZE))
        if request == packets.LIST:
            with self._timeline.lock:
                ports = self._ports().items()
                devices = {name: (_place(port), port.device.description) for name, port in ports}
            link.sendall(packets.listed(devices))
        elif request == packets.IMPORT:
            name = exactly(link, packets.BUS_ID_SIZE).partition(b"\0")[0].decode(errors="replace")
            self._attach(link, name)

    def _attach(self, link: socket.socket, bus_id: str) -> None:
        timeline, attached = self._timeline, self._attached
        timeline.wait(lambda: bus_id not in attached, _GRACE)
        with timeline.lock:
            port = self._ports().get(bus_id)
            taken = bus_id in attached
            if port is not None and not taken:
                attached.add(bus_id)
        if port is None or taken:
            link.sendall(
                packets.answer(packets.IMPORT, packets.NOT_AVAILABLE if taken else packets.NO_DEVICE)
            )
            return
        try:
            device = packets.exported(bus_id, _place(port), port.device.description)
            link.sendall(packets.answer(packets.IMPORT) + device)
            link.settimeout(None)
            link.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._transfer(link, Transfers(port))
        finally:
            with timeline.lock:
                if not port.gone:
                    port.reset()
                attached.remove(bus_id)
                timeline.changed()

    def _transfer(self, link: socket.socket, transfers: Transfers) -> None:
        """Take the client's commands until it ends, or the device is unplugged. Refused, OSError."""
        sending = threading.Thread(
            target=self._send, args=(link, transfers), name="usbip sender", daemon=True
        )
        sending.start()
        try:
            while True:
                self._take(link, transfers)
                self._timeline.wait(lambda: transfers.over or transfers.backlog <= _MOST_DATA, math.inf)
        finally:
            with self._timeline.lock:
                transfers.over = True
                self._timeline.changed()
            hang_up(link)
            sending.join()

    def _take(self, link: socket.socket, transfers: Transfers) -> None:
        """The next command."""
        command = packets.command_of(exactly(link, packets.COMMAND_SIZE))
        bus, address = _place(transfers.port)
        if command is None or command.device != bus << 16 | address:
            raise Refused
        data = b""
        if isinstance(command, Submit) and not command.to_host:
            if command.length > _MOST_DATA:
                raise Refused
            data = exactly(link, command.length)
        with self._timeline.lock:
            if transfers.port.gone:
                raise Refused
            if isinstance(command, Unlink):
                transfers.unlink(command)
            else:
                transfers.submit(command, data)

    def _send(self, link: socket.socket, transfers: Transfers) -> None:
        """Send what the transfers answer, until there is no more to come."""
        try:
            while True:
                self._timeline.wait(transfers.ready, math.inf)
                with self._timeline.lock:
                    answers = transfers.take()
                    over = transfers.over or transfers.port.gone
                if over:
                    return
                link.sendall(answers)
        except OSError:
            return  # The client has gone.
        finally:
            with self._timeline.lock:
                transfers.over = True
                self._timeline.changed()
            hang_up(link)  # which ends the thread that takes its commands


def _place(port: Port) -> tuple[int, int]:
    return BUS_NUMBER, port.address
