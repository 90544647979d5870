"""Events of a simulated GigE Vision camera, and which of them its host has acknowledged."""

import struct

from drivers.gige.gvcp import Answer, Code, Command

_FIRST_OF_MAKER = 0x9000
"""First identifier of events that are a maker's own."""


class Events:
    """sent: number of events so far."""

    def __init__(self) -> None:
        self.sent = 0
        self._unheard: set[int] = set()

    @property
    def unheard(self) -> int:
        """Number of events that were not acknowledged."""
        return len(self._unheard)

    def next(self, request_id: int, block: int, stamp: int) -> bytes:
        """Datagram of an event, of which every second one has data; stamp: ns."""
        code = (Code.EVENT, Code.EVENT_DATA)[self.sent % 2]
        payload = struct.pack(">HHHHQ", 0, _FIRST_OF_MAKER + self.sent % 2, 0, block, stamp)
        self.sent += 1
        self._unheard.add(request_id)
        return Command(code, request_id, payload + bytes(8 * (code == Code.EVENT_DATA))).pack()

    def heard(self, data: bytes) -> None:
        """Note an acknowledgement. CameraProtocol for other datagrams."""
        answer = Answer.parse(data)
        if answer.code in (Code.EVENT_ACK, Code.EVENT_DATA_ACK):
            self._unheard.discard(answer.request_id)
