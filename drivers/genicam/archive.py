"""A GenICam description as it lies zipped in a camera."""

import io
import zipfile
import zlib

from drivers.errors import CameraProtocol

LARGEST_XML = 32 << 20
"""Bytes of the largest description that is read."""


def unzipped(data: bytes) -> bytes:
    """The first file of an archive, past folders. CameraProtocol if it is damaged, too large, or has none."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            files = [one for one in archive.infolist() if not one.is_dir()]
            first = next((one for one in files if one.filename.lower().endswith(".xml")), None) or files[0]
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
