"""A GenICam description as it lies in a camera: its place, and its archive."""

import io
import re
import zipfile
import zlib

from drivers.errors import CameraProtocol

LARGEST_XML = 32 << 20
"""Bytes of the largest description that is read."""
_URL = re.compile(r"local:(?:///)?([^;]*);\s*(?:0x)?([0-9a-f]+);\s*(?:0x)?([0-9a-f]+)", re.IGNORECASE)


def parse_url(url: str) -> tuple[str, int, int] | None:
    """File name, address and size of `Local:NAME;ADDRESS;SIZE`; None for a place outside of the device."""
    match = _URL.match(url)
    return None if match is None else (match[1], int(match[2], 16), int(match[3], 16))


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
