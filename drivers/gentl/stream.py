"""Frames of a GenTL data stream: buffers that are announced, queued, filled, and copied."""

import ctypes
from contextlib import suppress

import numpy as np

from drivers.errors import CameraProtocol, CameraRefused, CameraTimeout
from drivers.genicam.chunks import CHUNKS
from drivers.genicam.nodemap import NodeMap
from drivers.genicam.session import Frame, FrameLeader
from drivers.gentl.abi import FLUSH_ALL, NEW_BUFFER_EVENT, NO_LIMIT, BufferInfo, Library, StreamInfo
from imaging.arrays import Bytes
from imaging.errors import CameraError

_BUFFERS = 4
_LARGEST = 1 << 31
"""Bytes of the largest frame."""
_IMAGE = 1
"""The payload type of an image, in GenTL as in the leaders of GigE Vision and USB3 Vision."""
_IMAGES = (0, _IMAGE, 4)
"""PAYLOADTYPE_INFO_IDS of buffers that hold an image: not stated, an image, an image with chunks."""
_NOT_GIVEN_BACK: list[Bytes] = []
"""Buffers that a producer would not revoke: it may still write there, so that their memory has to stay."""


class _NewBuffer(ctypes.Structure):
    """EVENT_NEW_BUFFER_DATA."""

    _fields_ = (("buffer", ctypes.c_void_p), ("user", ctypes.c_void_p))


class GentlStream:
    """A data stream of a device."""

    def __init__(self, library: Library, handle: int, nodes: NodeMap, where: str, *, chunks: bool) -> None:
        """nodes: the features of the device; chunks: whether those of its transport can be parsed."""
        self._library, self._handle, self._nodes, self._where = library, handle, nodes, where
        self._chunks = chunks
        self._buffers: dict[int, Bytes] = {}
        self._runs = False
        self._events = library.handle("GCRegisterEvent", handle, NEW_BUFFER_EVENT, where=where)

    def start(self) -> None:
        """Announce buffers as large as the frames are now, queue them, and let them be filled."""
        self.stop()
        size = self._size()
        if any(len(buffer) != size for buffer in self._buffers.values()) or not self._buffers:
            self._announce(size)
        for handle in self._buffers:
            self._call("DSQueueBuffer", self._handle, handle)
        self._call("EventFlush", self._events)
        self._runs = True
        self._call("DSStartAcquisition", self._handle, 0, NO_LIMIT)

    def stop(self) -> None:
        """Stop filling buffers; a buffer in progress is dropped."""
        if self._runs:
            self._runs = False
            self._call("DSStopAcquisition", self._handle, 0)
            self._call("DSFlushQueue", self._handle, FLUSH_ALL)

    def next_frame(self, timeout: float) -> Frame:
        """The next frame, copied, complete or not. CameraTimeout if none has come within `timeout` s.

        CameraRefused: the buffer holds something else than an image.
        """
        event, size = _NewBuffer(), ctypes.c_size_t(ctypes.sizeof(_NewBuffer))
        arguments = self._events, ctypes.byref(event), ctypes.byref(size), max(1, round(1e3 * timeout))
        try:
            self._call("EventGetData", *arguments)
        except CameraTimeout as error:
            raise CameraTimeout(
                f"{self._where} sent no frame within {timeout:.3g} s: check trigger and exposure."
            ) from error
        handle = int(event.buffer or 0)
        if handle not in self._buffers:
            raise CameraProtocol(f"{self._where} hands over a buffer that is not ours: update its software.")
        kind, frame = self._info(handle, BufferInfo.PAYLOADTYPE), self._frame(handle)
        self._call("DSQueueBuffer", self._handle, handle)
        if kind not in _IMAGES:
            raise CameraRefused(
                f"{self._where} sends payloads of type {kind:#06x}, not images: switch off compression and "
                "GenDC in its maker's program."
            )
        return frame

    def close(self) -> None:
        """Let go of it, as far as that goes with a device that may be gone."""
        for step in (
            self.stop,
            lambda: self._call("GCUnregisterEvent", self._handle, NEW_BUFFER_EVENT),
            self._revoke,
            lambda: self._call("DSClose", self._handle),
        ):
            with suppress(CameraError):
                step()
        _NOT_GIVEN_BACK.extend(self._buffers.values())

    def _frame(self, handle: int) -> Frame:
        fields = {one: self._info(handle, one) for one in BufferInfo if one != BufferInfo.SIZE_FILLED}
        buffer = self._buffers[handle]
        filled = min(self._info(handle, BufferInfo.SIZE_FILLED, len(buffer)), len(buffer))
        chunks = bool(fields[BufferInfo.CONTAINS_CHUNKDATA]) and self._chunks
        leader = FrameLeader(
            fields[BufferInfo.FRAMEID],
            _IMAGE | (CHUNKS if chunks else 0),
            fields[BufferInfo.TIMESTAMP],
            fields[BufferInfo.PIXELFORMAT],
            fields[BufferInfo.WIDTH],
            fields[BufferInfo.HEIGHT],
            padding=fields[BufferInfo.XPADDING],
        )
        problem = None
        if fields[BufferInfo.IS_INCOMPLETE]:
            problem = "its producer reports missing parts"
        elif fields[BufferInfo.DATA_LARGER_THAN_BUFFER]:
            problem = "it is larger than announced"
        return Frame(leader, buffer[fields[BufferInfo.IMAGEOFFSET] : filled].copy(), problem)

    def _info(self, handle: int, what: BufferInfo, otherwise: int = 0) -> int:
        return self._library.info_number("DSGetBufferInfo", self._handle, handle, what, otherwise=otherwise)

    def _size(self) -> int:
        """Bytes of a frame."""
        size = 0
        if self._library.info_number("DSGetInfo", self._handle, StreamInfo.DEFINES_PAYLOADSIZE):
            size = self._library.info_number("DSGetInfo", self._handle, StreamInfo.PAYLOAD_SIZE)
        size = size or int(self._nodes.number("PayloadSize"))
        if not 0 < size <= _LARGEST:
            raise CameraProtocol(f"{self._where} announces frames of {size} bytes: reset the camera.")
        return size

    def _announce(self, size: int) -> None:
        self._revoke()
        least = self._library.info_number("DSGetInfo", self._handle, StreamInfo.BUF_ANNOUNCE_MIN)
        for _ in range(max(_BUFFERS, least)):
            buffer = np.empty(size, np.uint8)
            announced = self._library.handle(
                "DSAnnounceBuffer", self._handle, buffer.ctypes.data, size, None, where=self._where
            )
            self._buffers[announced] = buffer

    def _revoke(self) -> None:
        """Take the buffers back; only then may their memory go."""
        for handle in list(self._buffers):
            memory, user = ctypes.c_void_p(), ctypes.c_void_p()
            self._call("DSRevokeBuffer", self._handle, handle, ctypes.byref(memory), ctypes.byref(user))
            del self._buffers[handle]

    def _call(self, name: str, *arguments: object) -> None:
        self._library.call(name, *arguments, where=self._where)
