"""One shot of a still camera, from its trigger to the files that are stored."""

from contextlib import suppress
from dataclasses import dataclass, field, replace

from drivers.camera import CameraFile
from drivers.errors import CameraLost, CameraProtocol, CameraRefused
from drivers.ptp.dials import Setting
from drivers.ptp.picture import best_of, camera_file, developed_beside, suffix
from drivers.ptp.protocol.session import Download
from drivers.ptp.vendors.standard import StandardBody
from imaging.errors import CameraError, InputError


@dataclass
class Shot:
    """A shot that was triggered. ends: when its shutter closes, by the clock; time: for which it is open, s.

    earlier: the objects that were in the camera before. body: the session that took the order. objects: its
    files, once they are there. doubtful: whether the camera was unplugged with an earlier shot in it too,
    while this one was not stored yet.
    """

    time: float
    ends: float
    earlier: frozenset[int]
    body: StandardBody
    objects: list[Download] = field(default_factory=list)
    doubtful: bool = False


@dataclass
class StoredShot:
    """A shot that is stored: its files, the session that knows their handles, how the camera was set."""

    objects: list[Download]
    body: StandardBody
    setting: Setting


def handle_of(body: StandardBody, file: Download) -> int:
    """Handle of a file in a new session; CameraRefused if it is gone."""
    for handle in body.handles_of(file):
        with suppress(CameraRefused):
            if body.session.object_info(handle) == file.info:
                return handle
    raise CameraRefused(f"{body.session.where} no longer has {file.info.filename}: take the shot again.")


def fetched(body: StandardBody, stored: StoredShot) -> CameraFile:
    """The pictures of the shot, all bytes of the best one; the camera may then forget all of them."""
    best = best_of(stored.objects)
    try:
        frame = camera_file(body.fetch(best), best)
    except InputError:
        best.data.clear()
        try:
            frame = camera_file(body.fetch(best), best)
        except InputError as error:
            raise CameraProtocol(f"{body.session.where} delivered a damaged file twice: {error}") from error
    frame = replace(frame, developed=_developed(body, best, stored))
    for file in stored.objects:
        with suppress(CameraError):  # the picture is here; what is stuck shows in the next shot
            body.discard(file)
    for file in stored.objects:
        file.data = bytearray()  # the frame has a copy
    return frame


def _developed(body: StandardBody, best: Download, stored: StoredShot) -> tuple[str, bytes] | None:
    """The photograph beside the RAW file; None if it is missing or incomplete.

    A camera that is lost over it is asked for all of the shot again.
    """
    file = developed_beside(best, stored.objects)
    if file is None:
        return None
    try:
        return suffix(file), body.fetch(file)
    except CameraLost:
        raise
    except CameraError:  # the exposure is here: it is not worth a shot
        return None
