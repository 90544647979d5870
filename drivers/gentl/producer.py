"""The producers that are installed, and the cameras that they find."""

import atexit
import ctypes
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from drivers.gentl.abi import DeviceInfo, Library
from imaging.errors import CameraError

ENVIRONMENT = "GENICAM_GENTL64_PATH"
"""The folders of producers; the installers of makers' SDKs set it."""
_PATIENCE = 1000
"""Milliseconds for which an interface is asked for its cameras."""


@dataclass(frozen=True)
class ListedCamera:
    """A camera: the producer and its interface that it is reached by, and who it is."""

    producer: "Producer"
    interface: int
    device: str
    serial: str
    make: str
    model: str
    transport: str
    """TLType: U3V, GEV, CXP, CL and others."""


class Producer:
    """A library that is initialised for as long as this process runs, its interfaces opened."""

    def __init__(self, path: Path) -> None:
        self.library = Library(path)
        self.library.call("GCInitLib")
        try:
            self._system = self.library.handle("TLOpen")
        except CameraError:
            with suppress(CameraError):
                self.library.call("GCCloseLib")  # else it cannot be initialised again
            raise
        self._interfaces: dict[str, int] = {}
        atexit.register(self._close)

    def cameras(self) -> list[ListedCamera]:
        """Cameras currently listed, in the producer's order."""
        changed, count = ctypes.c_ubyte(), ctypes.c_uint32()
        self.library.call("TLUpdateInterfaceList", self._system, ctypes.byref(changed), _PATIENCE)
        self.library.call("TLGetNumInterfaces", self._system, ctypes.byref(count))
        entries: list[ListedCamera] = []
        for at in range(count.value):
            name = self.library.text("TLGetInterfaceID", self._system, at)
            if name not in self._interfaces:
                opened = self.library.handle("TLOpenInterface", self._system, name.encode())
                self._interfaces[name] = opened
            entries += self._on(self._interfaces[name])
        return entries

    def _on(self, interface: int) -> Iterator[ListedCamera]:
        library, changed, count = self.library, ctypes.c_ubyte(), ctypes.c_uint32()
        library.call("IFUpdateDeviceList", interface, ctypes.byref(changed), _PATIENCE)
        library.call("IFGetNumDevices", interface, ctypes.byref(count))
        for at in range(count.value):
            name = library.text("IFGetDeviceID", interface, at)
            texts = {
                what: library.info_text("IFGetDeviceInfo", interface, name.encode(), what)
                for what in DeviceInfo
            }
            yield ListedCamera(
                self,
                interface,
                name,
                texts[DeviceInfo.SERIAL_NUMBER] or name,
                texts[DeviceInfo.VENDOR],
                texts[DeviceInfo.MODEL],
                texts[DeviceInfo.TLTYPE],
            )

    def _close(self) -> None:
        try:
            for interface in self._interfaces.values():
                self.library.call("IFClose", interface)
            self.library.call("TLClose", self._system)
            self.library.call("GCCloseLib")
        except CameraError:
            pass  # the process ends: no caller is left


def installed() -> list[Path]:
    """The producers in the folders of the environment, each once, in their order."""
    folders = [Path(one) for one in os.environ.get(ENVIRONMENT, "").split(os.pathsep) if one]
    return list(dict.fromkeys(path.resolve() for one in folders for path in sorted(one.glob("*.cti"))))


producer = cache(Producer)
"""Load the producer of a file, once per process: a library is initialised once. CameraRefused if it is not
one.
"""
