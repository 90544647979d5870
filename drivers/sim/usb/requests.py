"""Control requests to a device on the virtual bus: the standard ones (USB 2.0, 9.4), and its class's."""

from drivers.sim.usb.port import Port, Setup

_HALT = 0
"""The feature of an endpoint that is halted."""
_PORT_RESET = 4
_SELF_POWERED = b"\1\0"


def control(port: Port, setup: Setup, data: bytes) -> bytes:
    """Run a control request with the timeline's lock held; returns the data to the host. Stall."""
    answer = _standard(port, setup)
    return port.device.on_control(setup, data) if answer is None else answer


def _standard(port: Port, setup: Setup) -> bytes | None:
    """The answer to a standard request; None to others, and to those that no device here knows."""
    description, value, index = port.device.description, setup.value, setup.index
    there = index in description.endpoints()
    match setup.request_type, setup.request:
        case 0x80, 0:
            return _SELF_POWERED
        case 0x81, 0 if index in description.numbers():
            return bytes(2)
        case 0x82, 0 if there:
            return bytes((index in port.halted(), 0))
        case 0x02, 1 if value == _HALT and there:
            port.clear_halt(index)
            return b""
        case 0x02, 3 if value == _HALT and there:
            port.halt(index)
            return b""
        case 0x23, 3 if value == _PORT_RESET:
            # A request to the hub, by which clients of USB/IP ask for a reset.
            port.reset()
            return b""
        case 0x80, 6:
            return description.sent(value >> 8, value & 0xFF)
        case 0x80, 8:
            return b"\1"
        case 0x00, 9 if value in (0, 1):
            port.reset()
            return b""
        case 0x81, 10 if index in description.numbers():
            return bytes((port.alternates.get(index, 0),))
        case 0x01, 11 if value in (one.alternate for one in description.alternates(index)):
            port.alternates[index] = value
            return b""
    return None
