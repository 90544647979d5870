"""Remote shooting by the standard, on which the makers' protocols build."""

from collections.abc import Callable

from drivers.ptp.protocol.codec import Event
from drivers.ptp.protocol.codes import EventCode, Operation
from drivers.sim.ptp.operations import Handler, Reply, Request
from drivers.sim.ptp.properties import SimulatedProperties
from drivers.sim.ptp.shooting import Announcement, News, Shooting


def always(request: Request) -> bool:
    """Release condition of operations that always release the shutter."""
    return True


class Manner:
    """InitiateCapture, and events on the interrupt endpoint."""

    memory_handles: tuple[int, ...] | None = None
    """Handles of objects in working memory, where a shot may stay until the host has fetched it: of the main
    file, and of the JPEG beside it.
    """
    polled = False
    """True if events wait until the host polls them, so that none is lost."""

    def __init__(
        self, shooting: Shooting, properties: SimulatedProperties, tell: Callable[[Event], None]
    ) -> None:
        self.shooting, self.properties, self.tell = shooting, properties, tell

    def operations(self) -> dict[int, Handler]:
        """Return what it adds to the operations that every responder has."""
        return {Operation.INITIATE_CAPTURE: Handler(self._capture, shoots=always)}

    def device_properties(self) -> tuple[int, ...]:
        """The properties that DeviceInfo names."""
        return self.properties.codes()

    def fills_memory(self) -> bool:
        """Return whether a shot is in working memory."""
        return any(self.shooting.store.count(handle) for handle in self.memory_handles or ())

    def begin(self) -> None:
        """A session was opened; what the one before left in memory is gone."""
        for handle in self.memory_handles or ():
            while self.shooting.store.delete(handle):
                pass

    def announce(self, announcement: Announcement) -> None:
        """Announce a shot to the host."""
        if announcement.news is News.OBJECT_ADDED:
            self.tell(Event(EventCode.OBJECT_ADDED, announcement.transaction, (announcement.handle,)))
        else:
            self.tell(Event(EventCode.CAPTURE_COMPLETE, announcement.transaction))

    def changed(self, code: int) -> None:
        """Report the consequences of a property set by the host: other dials of the same setting."""
        dials = self.shooting.dials
        turned = dials.get(code)
        for other in dials.values():
            if turned is not None and other.code != code and other.setting == turned.setting:
                self.tell(Event(EventCode.DEVICE_PROP_CHANGED, 0, (other.code,)))

    def fetched(self, handle: int) -> None:
        """The host has read the last byte of an object."""

    def _capture(self, request: Request) -> Reply:
        return Reply(self.shooting.shoot(request.transaction, request.faults))
