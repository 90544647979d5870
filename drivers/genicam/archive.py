"""A GenICam description as it lies zipped in a camera."""

import io
import zipfile
import zlib

from drivers.errors import CameraProtocol

LARGEST_XML = 32 << 20
"""Bytes of the largest description that is read."""


def unzipped(data: bytes) -> bytes:
    """The first file of an archive. CameraProtocol if it is damaged, or too large."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            first = archive.infolist()[0]
            if first.file_size > LARGEST_XML:
                raise CameraProtocol(f"its description unzips to {first.file_size} bytes")
            return archive.read(first)
    except (
        zipfile.BadZipFile,
        zlib.error,
        IndexError,
        NotImplementedError,
        RuntimeError,
        OSError,
        EOFError,
        ValueError,
    ) as error:
        raise CameraProtocol(f"its description cannot be unzipped ({error})") from error
