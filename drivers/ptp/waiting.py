"""Waiting for the objects of one shot, by events where they come and by asking where they do not."""

from drivers.errors import CameraBusy, CameraProtocol, CameraRefused, CameraTimeout
from drivers.ptp.protocol.codes import EventCode, FormatCode
from drivers.ptp.protocol.session import Download, PtpSession

GRACE = 0.1
"""Seconds without news after which a shot that is complete has all its objects: RAW+JPEG gives two."""
LATE = 1.0
"""Seconds without news after which a CaptureComplete that is still missing counts as lost."""
_LISTEN = 0.05
_ASK_AFTER, _ASK_EVERY = 0.4, 0.25
_MOST_EVENTS = 1000


def deadline(exposure: float) -> float:
    """Seconds that a shot of that exposure time may take: exposure, a dark frame as long, and writing."""
    return 2 * exposure + 30.0


def wait_for_objects(session: PtpSession, ignored: set[int], exposure: float) -> list[Download]:
    """All files of the shot just begun, that is those not in `known`, to which they are added.

    ObjectAdded and CaptureComplete may come in either order, late or never: some time after the exposure
    the camera is asked for its objects. CameraTimeout past the deadline, CameraRefused if its card is full.
    """
    clock = session.clock
    start = news = clock.now()
    ask_at, events = start + exposure + _ASK_AFTER, 0
    files: list[Download] = []
    complete = full = False
    while True:
        now = clock.now()
        if files and now - news >= (GRACE if complete else LATE):
            return files
        if now >= start + deadline(exposure):
            raise CameraTimeout(f"{session.where} delivered no picture: check its card, focus and mode dial.")
        if now >= ask_at or (complete and not files and now - news >= GRACE):
            added = [handle for handle in _asked(session) if handle not in ignored]
            ask_at = clock.now() + _ASK_EVERY
        else:
            added = []
        for event in session.events(_LISTEN):
            events += 1
            if event.code == EventCode.OBJECT_ADDED and event.parameters:
                added.append(event.parameters[0])
            elif event.code == EventCode.CAPTURE_COMPLETE:
                complete, news = True, clock.now()
            elif event.code == EventCode.STORE_FULL:
                full = True
        if events > _MOST_EVENTS:
            raise CameraProtocol(f"{session.where} sends events without end: switch it off and on.")
        if full and not files:  # with this picture, or before it
            added += _asked(session)
        for handle in added:
            if handle not in ignored:
                files.extend(_files(session, handle))
                ignored.add(handle)
                news = clock.now()
        if full and not files:
            raise CameraRefused(f"{session.where} has no room for the picture: free its card.")


def drain(session: PtpSession, ignored: set[int]) -> None:
    """Forget the events of earlier shots."""
    for event in session.events(0.001):
        if event.code == EventCode.OBJECT_ADDED and event.parameters:
            ignored.add(event.parameters[0])


def _asked(session: PtpSession) -> tuple[int, ...]:
    """The handles of all objects, none while the camera is too busy to say."""
    try:
        return session.handles()
    except CameraBusy:
        return ()


def _files(session: PtpSession, handle: int) -> list[Download]:
    """The object if it is a file; nothing for a folder that the shot made, or for an invalid handle."""
    try:
        info = session.object_info(handle)
    except CameraRefused:
        return []
    if info.format == FormatCode.ASSOCIATION:
        return []
    return [Download(handle, info, bytearray())]
