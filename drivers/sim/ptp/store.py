"""Storage of a simulated camera: a card with folders and files, and its working memory."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from drivers.ptp.protocol.codec import pack_moment
from drivers.ptp.protocol.codes import EVERY_FORMAT, EVERY_PARENT, ROOT_PARENT, FormatCode
from drivers.ptp.protocol.datasets import ObjectInfo, StorageInfo

STORAGE = 0x00010001
_ROOT, _FOLDER, _FIRST_FILE = 0x10000000, 0x10010000, 0x10010001
_GENERIC_FOLDER = 1


@dataclass(frozen=True)
class Photograph:
    """A file before it is stored."""

    data: bytes
    format: int
    suffix: str
    width: int
    height: int
    taken: datetime


class Store:
    """Objects by handle. Folders DCIM and, inside it, the camera's are there before the first photograph."""

    def __init__(self, folder: str, prefix: str, capacity: int = 1 << 34) -> None:
        self.capacity = capacity
        self.full = False
        """True while it accepts no more, whatever its capacity, until something is deleted."""
        self._prefix = prefix
        self._next = self._files = 0
        self._bytes: dict[int, bytes] = {}
        self._infos: dict[int, ObjectInfo] = {}
        self._behind: list[tuple[int, bytes, ObjectInfo]] = []
        """Files in working memory that wait until the one before under the same handle is deleted."""
        for handle, parent, name in ((_ROOT, 0, "DCIM"), (_FOLDER, _ROOT, folder)):
            self._infos[handle] = ObjectInfo(
                storage=STORAGE,
                format=FormatCode.ASSOCIATION,
                parent=parent,
                association_type=_GENERIC_FOLDER,
                filename=name,
            )

    @property
    def free(self) -> int:
        """Bytes."""
        return 0 if self.full else self.capacity - sum(map(len, self._bytes.values()))

    def info(self) -> StorageInfo:
        """The card: removable RAM with a DCIM tree, to be read and written."""
        return StorageInfo(4, 3, 0, self.capacity, self.free, self.pictures(self.free), "SD", "")

    def pictures(self, room: int) -> int:
        """Return how many pictures fit into that many bytes, going by the largest so far."""
        return min(room // max(map(len, self._bytes.values()), default=1 << 25), 0xFFFFFFFE)

    def add(self, photograph: Photograph, memory_handle: int | None = None, beside: bool = False) -> int:
        """Store a file and return its handle; `memory_handle` keeps it in working memory, off the card.

        A second one under that handle is seen when the first is deleted. beside: it has the name of the file
        before, with its own suffix.
        """
        self._next += 0 if beside else 1
        self._files += 1
        handle = _FIRST_FILE + self._files - 1 if memory_handle is None else memory_handle
        moment = pack_moment(photograph.taken)
        info = ObjectInfo(
            storage=STORAGE if memory_handle is None else 0,
            format=photograph.format,
            size=len(photograph.data),
            thumb_format=FormatCode.EXIF_JPEG,
            width=photograph.width,
            height=photograph.height,
            bit_depth=24 if photograph.format == FormatCode.EXIF_JPEG else 16,
            parent=_FOLDER if memory_handle is None else 0,
            filename=f"{self._prefix}{self._next:04d}{photograph.suffix}",
            capture_date=moment,
            modification_date=moment,
        )
        if handle in self._bytes:
            self._behind.append((handle, photograph.data, info))
        else:
            self._bytes[handle], self._infos[handle] = photograph.data, info
        return handle

    def count(self, handle: int) -> int:
        """Return how many files there are under a handle of working memory, seen or waiting."""
        return (handle in self._bytes) + [behind for behind, _, _ in self._behind].count(handle)

    def object_info(self, handle: int) -> ObjectInfo | None:
        """Information on an object, or None."""
        return self._infos.get(handle)

    def data(self, handle: int) -> bytes | None:
        """The bytes of a file; None for anything else."""
        return self._bytes.get(handle)

    def handles(self, wanted: int = EVERY_FORMAT, parent: int = EVERY_PARENT) -> tuple[int, ...]:
        """Objects on the card of a format and in a folder, as GetObjectHandles counts those."""
        return tuple(self._matching(wanted, parent))

    def delete(self, handle: int) -> bool:
        """Delete a file; whether it was one."""
        if self._bytes.pop(handle, None) is None:
            return False
        del self._infos[handle]
        self.full = False
        for place, (behind, data, info) in enumerate(self._behind):
            if behind == handle:
                self._bytes[handle], self._infos[handle] = data, info
                del self._behind[place]
                break
        return True

    def _matching(self, wanted: int, parent: int) -> Iterable[int]:
        for handle, info in self._infos.items():
            if info.storage != STORAGE or (wanted != EVERY_FORMAT and info.format != wanted):
                continue
            folder = 0 if parent == ROOT_PARENT else parent
            if parent == EVERY_PARENT or info.parent == folder:
                yield handle
