"""A PTP transaction, whatever carries it: how it ends, and what a carrier can be asked for."""

from dataclasses import dataclass
from typing import Protocol

from drivers.errors import CameraTimeout
from drivers.ptp.protocol.codec import Command, Event, Response
from imaging.errors import CameraError

TIMEOUT = 20.0
"""Seconds that a camera may take over one transfer of an ordinary transaction."""
MOST_BYTES = 16 << 20
"""Bytes of an answer beyond which the camera talks nonsense, unless more were asked for."""


@dataclass(frozen=True)
class Answer:
    """Outcome of a transaction and its data; None without a data phase."""

    response: Response
    data: bytes | None


class ResponseLost(CameraTimeout):
    """All data came, and no response after them; some bodies send none, and have forgotten the data."""

    def __init__(self, error: CameraTimeout, data: bytes) -> None:
        super().__init__(str(error))
        self.data = data


class Transport(Protocol):
    """Carries transactions to one camera, one at a time, and events from it. where: for messages."""

    where: str

    def transact(
        self, command: Command, data: bytes | None = None, *, timeout: float = TIMEOUT, most: int = MOST_BYTES
    ) -> Answer:
        """One transaction, whatever the response code. `timeout` is for each transfer, in seconds.

        CameraProtocol, CameraTimeout, CameraLost; after the first two it needs `recover`.
        """
        ...

    def recover(self, error: CameraError, transaction: int) -> bool:
        """Come back in step after `error`; False if that cost the session, which is then to open.

        CameraLost if the camera has to be opened anew, or is gone.
        """
        ...

    def reset(self) -> None:
        """Reset the camera: it drops its session and all pending work."""
        ...

    def events(self, timeout: float) -> list[Event]:
        """The events that have come, or the first to come within `timeout` seconds. CameraLost."""
        ...

    def close(self) -> None:
        """Let go of the camera; a second time does nothing."""
        ...
