"""One shot of a still camera, from its trigger to the files that are stored."""

from dataclasses import dataclass, field

from drivers.ptp.dials import Setting
from drivers.ptp.protocol.session import Download
from drivers.ptp.vendors.standard import StandardBody


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
