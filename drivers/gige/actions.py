"""Triggering of several cameras by one network command, at once or at a common time.

An ACTION command makes every camera expose that knows its keys. Cameras that are synchronised by IEEE 1588
(PTPv2) get a time: the command then may come a little sooner or later, or twice, to one or the other, and
what is left between their shutters is what is left between their clocks. Names of features as in SFNC, with
those of version 1 of GigE Vision where they differ. Verified against the simulator.
"""

import bisect
import itertools
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

from drivers.errors import CameraProtocol, CameraRefused
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.settings import set_if_there
from drivers.genicam.timestamps import Latch
from drivers.gige import gvcp
from drivers.gige.gvcp import Action, Answer, Code
from drivers.gige.registers import CAN_SCHEDULE, NANOSECONDS, Bootstrap, Registers

DEVICE_KEY, GROUP_KEY, GROUP_MASK = 0x52494721, 1, 1
"""Keys of all cameras that rig sets up."""
AHEAD = 0.05
"""Seconds from a command to the time that it names."""
_ATTEMPTS, _PATIENCE = 5, 0.005
"""Attempts at ordering a camera, and seconds to wait for its answer: they end before the time."""
_NEW_ANCHOR = 10.0
"""Seconds after which the times of host and network are compared anew: the host's clock drifts."""
_SAME_TIME, _DRIFT = 1e-3, 2e-4
"""Seconds by which cameras may seem to differ and share a time, as answers take theirs; and per second."""


def action_source(nodes: NodeMap, where: str) -> str:
    """The trigger source that is an action: the first that the camera has. CameraRefused."""
    sources = [source for source in nodes.entries("TriggerSource") if source.startswith("Action")]
    if not sources or not nodes.available("ActionDeviceKey"):
        raise CameraRefused(f"{where} has no action commands: trigger it by software or over a line.")
    return sources[0]


def heed(nodes: NodeMap, source: str) -> None:
    """Configure the camera for our action command and for the network time."""
    set_if_there(nodes, "ActionSelector", int(source.removeprefix("Action")))
    nodes.set("ActionDeviceKey", DEVICE_KEY)
    nodes.set("ActionGroupKey", GROUP_KEY)
    nodes.set("ActionGroupMask", GROUP_MASK)
    if not set_if_there(nodes, "PtpEnable", True):
        set_if_there(nodes, "GevIEEE1588", True)


def keeps_time(nodes: NodeMap) -> bool | None:
    """Return whether it is synchronised by now; None for a camera that never is."""
    for name, latch in (("PtpStatus", "PtpDataSetLatch"), ("GevIEEE1588Status", "GevIEEE1588DataSetLatch")):
        if nodes.available(name):
            # Where there is such a command, the status is that of the moment when it was last given.
            if nodes.writable(latch):
                nodes.execute(latch)
            return nodes.text(name) in ("Master", "Slave")
    return None


def can_schedule(control: Registers) -> bool:
    """Return whether the device takes commands that name a time, in ns as its clock then counts."""
    schedules = control.read_number(Bootstrap.CAPABILITY, 4) & CAN_SCHEDULE
    return bool(schedules) and control.read_number(Bootstrap.TICK_FREQUENCY, 8) == NANOSECONDS


class NetworkTime:
    """The time of synchronised cameras, on the clock of the host; for any thread.

    It is compared with the host's at one camera and then taken to run as fast, for all cameras alike: their
    reports of a shot differ by their shutters, not by how well each was compared.
    """

    def __init__(self) -> None:
        self._anchors: list[Latch] = []
        self._lock = threading.Lock()

    def agrees(self, reading: Latch) -> bool:
        """Return whether a camera's clock shows this time; the first one's is it."""
        with self._lock:
            if not self._anchors:
                self._anchors.append(reading)
                return True
            last = self._anchors[-1]
            elapsed = reading.host - last.host
            off = abs((reading.device - last.device) * 1e-9 - elapsed)
            if off > _SAME_TIME + reading.uncertainty + last.uncertainty + _DRIFT * abs(elapsed):
                return False
            if elapsed > _NEW_ANCHOR:
                self._anchors.append(reading)
            return True

    def on_host(self, stamp: int) -> float:
        """Return when it was that time, ns, in seconds of the host's clock; `agrees` was asked before."""
        with self._lock:
            place = bisect.bisect_right([anchor.device for anchor in self._anchors], stamp)
            anchor = self._anchors[max(place - 1, 0)]
            return anchor.host + (stamp - anchor.device) * 1e-9


def fire(addresses: Sequence[str], host: str, when: int | None) -> None:
    """Trigger the cameras at these addresses: at `when`, ns of the network's time, or at once.

    Those that do not answer get the command again; one that is not reached has no frame. host: our address.
    """
    ids = itertools.count(1)
    action = Action(DEVICE_KEY, GROUP_KEY, GROUP_MASK, when)
    waiting = set(addresses)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        with suppress(OSError):  # the system chooses another
            link.bind((host, 0))
        for _ in range(_ATTEMPTS):
            datagram = action.command(next(ids), acknowledge=True).pack()
            for address in sorted(waiting):
                with suppress(OSError):  # there is no way there at the moment
                    link.sendto(datagram, (address, gvcp.PORT))
            deadline = time.monotonic() + _PATIENCE
            while waiting and (remaining := deadline - time.monotonic()) > 0:
                link.settimeout(remaining)
                with suppress(OSError, CameraProtocol):
                    data, (address, _) = link.recvfrom(2048)
                    if Answer.parse(data).code == Code.ACTION_ACK:
                        waiting.discard(address)
            if not waiting:
                return
