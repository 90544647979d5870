"""A camera at an address: connected to, paired with this computer, and found there again when it was lost."""

import hashlib
import platform
import struct
import uuid
from pathlib import Path

from drivers.camera import CameraIdentity
from drivers.clock import Clock
from drivers.errors import (
    CameraBusy,
    CameraClaimed,
    CameraGone,
    CameraLost,
    CameraNotFound,
    CameraPermission,
    CameraRefused,
    CameraTimeout,
)
from drivers.ptp.ip.packets import VERSION, Link, PacketType, place_of
from drivers.ptp.ip.transport import IpTransport
from drivers.ptp.protocol.codec import damaged
from drivers.ptp.protocol.connection import REPLUG_SECONDS, identified
from drivers.ptp.protocol.session import QUICK_TIMEOUT, PtpSession
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import CameraError

PAIRING_SECONDS = 30.0
"""Seconds that somebody has to say yes on the camera."""
_LOOK_EVERY = 0.5
_MOST_BYTES = 1 << 10
_LONGEST_NAME = 39
_REJECTED, _BUSY = 1, 2
_MACHINE_ID = Path("/etc/machine-id")


def own_guid() -> bytes:
    """16 bytes by which cameras know this computer again, the same for as long as its system lives."""
    try:
        machine = _MACHINE_ID.read_text().strip()
    except OSError:
        machine = ""
    # Hashed, as machine-id(5) asks for: cameras show it on the network.
    return hashlib.sha256(f"hdr-rig PTP/IP {machine or uuid.getnode()}".encode()).digest()[:16]


def own_name() -> str:
    """Return what cameras call this computer in their menus."""
    return f"rig on {platform.node() or 'a computer'}"[:_LONGEST_NAME]


def connect(host: str, port: int, clock: Clock, patience: float = PAIRING_SECONDS) -> IpTransport:
    """Open both connections to a camera.

    Args:
        host: Name or IP address of the camera.
        port: TCP port of the camera.
        clock: Clock of the transport.
        patience: Time that the camera may take to accept the first connection, s.

    Returns:
        The transport, open.

    Raises:
        CameraNotFound: No answer.
        CameraPermission: The camera wants to be paired.
        CameraClaimed: Another host has the camera.
        CameraRefused: The camera accepts no connection, for another reason.
        CameraTimeout: The camera does not accept in time.
        CameraLost: The connection ends.
        CameraProtocol: An answer is damaged.
    """
    commands = Link(host, port)
    try:
        number = _init_commands(commands, patience)
        events = Link(host, port)
        try:
            events.send(PacketType.INIT_EVENT_REQUEST, struct.pack("<I", number))
            kind, fields = events.receive(QUICK_TIMEOUT, _MOST_BYTES)
            _must_be(PacketType.INIT_EVENT_ACK, kind, fields, events.where)
        except BaseException:
            events.close()
            raise
    except BaseException:
        commands.close()
        raise
    return IpTransport(commands, events, clock)


def _init_commands(link: Link, patience: float) -> int:
    """Introduce this computer; the number of the connection."""
    name = own_name().encode("utf-16-le") + b"\0\0"
    link.send(PacketType.INIT_COMMAND_REQUEST, own_guid() + name + struct.pack("<I", VERSION))
    try:
        kind, fields = link.receive(patience, _MOST_BYTES)
    except CameraTimeout as error:
        raise CameraTimeout(
            f"{link.where} did not accept the connection within {patience:g} s: confirm it on the camera, "
            f"where this computer is called {own_name()!r}."
        ) from error
    _must_be(PacketType.INIT_COMMAND_ACK, kind, fields, link.where)
    if len(fields) < 20:
        raise damaged(f"an acknowledgement of {len(fields)} bytes")
    return int.from_bytes(fields[:4], "little")


def _must_be(wanted: PacketType, kind: int, fields: bytes, where: str) -> None:
    """Raise for any other packet, an Init Fail with its reason."""
    if kind == wanted:
        return
    if kind != PacketType.INIT_FAIL or len(fields) < 4:
        raise damaged(f"a packet of type {kind} instead of an accepted connection")
    reason = int.from_bytes(fields[:4], "little")
    if reason == _REJECTED:
        raise CameraPermission(
            f"{where} turns this computer away: pair the camera with it in the camera's network menu, where "
            f"it is called {own_name()!r}."
        )
    if reason == _BUSY:
        raise CameraClaimed(f"{where} is connected to another program or device: end that connection.")
    raise CameraRefused(
        f"{where} accepts no connection (reason {reason}): choose the connection to a computer in the "
        "camera's network menu."
    )


class IpConnection:
    """Connection to the camera at one address. `identity` is None before it was first opened."""

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        self._host, self._port, self._clock = host, port, clock
        self.where = place_of(host, port)
        self.identity: CameraIdentity | None = None

    def open(self) -> StandardBody:
        """Open a session and take control; a camera that was there before may be on its way back.

        CameraGone if it does not come back, and all other CameraErrors.
        """
        if self.identity is None:
            return self._opened(PAIRING_SECONDS)
        end = self._clock.now() + REPLUG_SECONDS
        while True:
            try:
                return self._opened(QUICK_TIMEOUT)
            except (CameraNotFound, CameraLost, CameraTimeout, CameraClaimed, CameraBusy) as error:
                if self._clock.now() >= end:
                    raise CameraGone(f"Camera {self.identity.serial} does not come back: {error}") from error
            self._clock.sleep(_LOOK_EVERY)

    def _opened(self, patience: float) -> StandardBody:
        """CameraRefused if it is another camera than before."""
        transport = connect(self._host, self._port, self._clock, patience)
        try:
            session = PtpSession(transport, self._clock)
            session.open()
            body, identity = identified(session, None, self.where)
            if self.identity is not None and identity.serial != self.identity.serial:
                raise CameraRefused(
                    f"{self.where} is camera {identity.serial} now, not {self.identity.serial}: give every "
                    "camera a fixed address."
                )
            self.identity = identity
            body.enter()
        except CameraError:
            transport.close()
            raise
        return body
