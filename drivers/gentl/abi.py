"""The C interface of a GenTL producer (EMVA GenTL 1.5), called with ctypes, and its errors as ours.

While the producer works or waits, other threads of Python run.
"""

import ctypes
from ctypes import POINTER, c_char, c_char_p, c_int32, c_size_t, c_ubyte, c_uint32, c_uint64, c_void_p
from enum import IntEnum
from pathlib import Path
from typing import Any

from drivers.errors import (
    CameraBusy,
    CameraClaimed,
    CameraLost,
    CameraProtocol,
    CameraRefused,
    CameraTimeout,
)
from imaging.errors import CameraError

NO_LIMIT = (1 << 64) - 1
NEW_BUFFER_EVENT = 1
FLUSH_ALL = 4
"""ACQ_QUEUE_ALL_DISCARD: no buffer is in any queue."""
CONTROL = 3
"""DEVICE_ACCESS_CONTROL: others may look on."""


class DeviceInfo(IntEnum):
    """DEVICE_INFO_CMD."""

    VENDOR = 1
    MODEL = 2
    TLTYPE = 3
    SERIAL_NUMBER = 7


class StreamInfo(IntEnum):
    """STREAM_INFO_CMD."""

    PAYLOAD_SIZE = 7
    DEFINES_PAYLOADSIZE = 9
    BUF_ANNOUNCE_MIN = 12


class BufferInfo(IntEnum):
    """BUFFER_INFO_CMD."""

    TIMESTAMP = 3
    IS_INCOMPLETE = 7
    SIZE_FILLED = 9
    WIDTH = 10
    HEIGHT = 11
    XPADDING = 14
    FRAMEID = 16
    IMAGEOFFSET = 18
    PAYLOADTYPE = 19
    PIXELFORMAT = 20
    DATA_LARGER_THAN_BUFFER = 29
    CONTAINS_CHUNKDATA = 30


class Code(IntEnum):
    """GC_ERROR."""

    SUCCESS = 0
    NOT_IMPLEMENTED = -1003
    RESOURCE_IN_USE = -1004
    ACCESS_DENIED = -1005
    INVALID_HANDLE = -1006
    NO_DATA = -1008
    IO = -1010
    TIMEOUT = -1011
    NOT_AVAILABLE = -1014
    INVALID_ADDRESS = -1015
    BUSY = -1022


_KINDS: dict[int, tuple[type[CameraError], str]] = {
    Code.NOT_IMPLEMENTED: (CameraRefused, "update its maker's software"),
    Code.RESOURCE_IN_USE: (CameraClaimed, "close the other program that uses it"),
    Code.ACCESS_DENIED: (CameraClaimed, "close the other program that uses it"),
    Code.INVALID_HANDLE: (CameraLost, "check its cable, and plug it in again"),
    Code.IO: (CameraLost, "check its cable, and plug it in again"),
    Code.TIMEOUT: (CameraTimeout, "check its cable"),
    Code.NOT_AVAILABLE: (CameraRefused, "leave that feature alone"),
    Code.INVALID_ADDRESS: (CameraRefused, "leave that feature alone"),
    Code.BUSY: (CameraBusy, "wait, and try again"),
}

_HANDLE, _OUT = c_void_p, POINTER(c_void_p)
_SIZE, _TYPE = POINTER(c_size_t), POINTER(c_int32)
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "GCInitLib": (),
    "GCCloseLib": (),
    "GCGetLastError": (_TYPE, c_void_p, _SIZE),
    "GCReadPort": (_HANDLE, c_uint64, c_void_p, _SIZE),
    "GCWritePort": (_HANDLE, c_uint64, c_void_p, _SIZE),
    "GCGetNumPortURLs": (_HANDLE, POINTER(c_uint32)),
    "GCGetPortURLInfo": (_HANDLE, c_uint32, c_int32, _TYPE, c_void_p, _SIZE),
    "GCRegisterEvent": (_HANDLE, c_int32, _OUT),
    "GCUnregisterEvent": (_HANDLE, c_int32),
    "EventGetData": (_HANDLE, c_void_p, _SIZE, c_uint64),
    "EventFlush": (_HANDLE,),
    "TLOpen": (_OUT,),
    "TLClose": (_HANDLE,),
    "TLUpdateInterfaceList": (_HANDLE, POINTER(c_ubyte), c_uint64),
    "TLGetNumInterfaces": (_HANDLE, POINTER(c_uint32)),
    "TLGetInterfaceID": (_HANDLE, c_uint32, c_void_p, _SIZE),
    "TLOpenInterface": (_HANDLE, c_char_p, _OUT),
    "IFClose": (_HANDLE,),
    "IFUpdateDeviceList": (_HANDLE, POINTER(c_ubyte), c_uint64),
    "IFGetNumDevices": (_HANDLE, POINTER(c_uint32)),
    "IFGetDeviceID": (_HANDLE, c_uint32, c_void_p, _SIZE),
    "IFGetDeviceInfo": (_HANDLE, c_char_p, c_int32, _TYPE, c_void_p, _SIZE),
    "IFOpenDevice": (_HANDLE, c_char_p, c_int32, _OUT),
    "DevClose": (_HANDLE,),
    "DevGetPort": (_HANDLE, _OUT),
    "DevGetDataStreamID": (_HANDLE, c_uint32, c_void_p, _SIZE),
    "DevOpenDataStream": (_HANDLE, c_char_p, _OUT),
    "DSClose": (_HANDLE,),
    "DSGetInfo": (_HANDLE, c_int32, _TYPE, c_void_p, _SIZE),
    "DSAnnounceBuffer": (_HANDLE, c_void_p, c_size_t, c_void_p, _OUT),
    "DSRevokeBuffer": (_HANDLE, _HANDLE, _OUT, _OUT),
    "DSQueueBuffer": (_HANDLE, _HANDLE),
    "DSFlushQueue": (_HANDLE, c_int32),
    "DSStartAcquisition": (_HANDLE, c_int32, c_uint64),
    "DSStopAcquisition": (_HANDLE, c_int32),
    "DSGetBufferInfo": (_HANDLE, _HANDLE, c_int32, _TYPE, c_void_p, _SIZE),
}
"""Signatures of the functions in use; every function returns a GC_ERROR."""


class Library:
    """The functions of one producer. `where` names it in messages."""

    def __init__(self, path: Path) -> None:
        """CameraRefused: it is no producer, or cannot be loaded."""
        self.where = path.stem
        try:
            self._functions = ctypes.CDLL(str(path))
            for name, arguments in _ARGUMENTS.items():
                function = getattr(self._functions, name)
                function.argtypes, function.restype = arguments, c_int32
        except (OSError, AttributeError) as error:
            why = str(error).removeprefix(f"{path}: ")
            raise CameraRefused(
                f"{path} is no GenTL producer that can be used ({why}): install its maker's software again."
            ) from error

    def call(self, name: str, *arguments: Any, where: str = "") -> None:
        """Call a function. CameraError: it fails; `where` names what it was asked of."""
        code = getattr(self._functions, name)(*arguments)
        if code != Code.SUCCESS:
            kind, fix = _KINDS.get(code, (CameraProtocol, "update its maker's software"))
            raise kind(f"{where or self.where}: {name} fails with {self._why(code)}: {fix}.")

    def handle(self, name: str, *arguments: Any, where: str = "") -> int:
        """Return what a function opens."""
        opened = c_void_p()
        self.call(name, *arguments, ctypes.byref(opened), where=where)
        return opened.value or 0

    def text(self, name: str, *arguments: Any) -> str:
        """A text that a function hands out in two steps, its size and then itself."""
        size = c_size_t(0)
        self.call(name, *arguments, None, ctypes.byref(size))
        text = ctypes.create_string_buffer(max(size.value, 1))
        self.call(name, *arguments, text, ctypes.byref(size))
        return text.value.decode("utf-8", "replace")

    def info_text(self, name: str, *arguments: Any) -> str:
        """A text of an info function, empty where the producer has none."""
        kind = c_int32()
        try:
            return self.text(name, *arguments, ctypes.byref(kind))
        except CameraError:
            return ""

    def info_number(self, name: str, *arguments: Any, otherwise: int = 0) -> int:
        """A number of an info function, of whatever width; `otherwise` where the producer has none."""
        kind, number, size = c_int32(), c_uint64(0), c_size_t(8)
        try:
            self.call(name, *arguments, ctypes.byref(kind), ctypes.byref(number), ctypes.byref(size))
        except CameraError:
            return otherwise
        return number.value & ((1 << 8 * min(size.value, 8)) - 1)

    def _why(self, code: int) -> str:
        """Return what the producer says of its last error."""
        last, size = c_int32(), c_size_t(1024)
        text = (c_char * 1024)()
        failed = self._functions.GCGetLastError(ctypes.byref(last), text, ctypes.byref(size))
        says = "" if failed else text.value.decode("utf-8", "replace").strip().rstrip(".")
        return f"{code} ({says})" if says else str(code)
