"""Files of a shot: which one to take, and what its header says."""

from pathlib import PurePath

from drivers.camera import CameraFile
from drivers.errors import CameraProtocol
from drivers.ptp.protocol.codes import FormatCode
from drivers.ptp.protocol.session import Download
from imaging.files import photo, raw

_SUFFIXES = {
    FormatCode.DNG: ".dng",
    FormatCode.EXIF_JPEG: ".jpg",
    FormatCode.TIFF: ".tif",
    FormatCode.CANON_CR3: ".cr3",
}


def suffix(file: Download) -> str:
    """File suffix by the name, or by the format where the name has none; empty without either."""
    named = PurePath(file.info.filename).suffix.lower()
    if named in raw.SUFFIXES or named in photo.SUFFIXES:
        return named
    return _SUFFIXES.get(FormatCode(file.info.format), "") if file.info.format in _SUFFIXES else ""


def best_of(objects: list[Download]) -> Download:
    """The RAW file if there is one, else the photograph; CameraProtocol if there is neither."""
    for suffixes in (raw.SUFFIXES, photo.SUFFIXES):
        for file in objects:
            if suffix(file) in suffixes:
                return file
    names = ", ".join(file.info.filename for file in objects) or "nothing"
    raise CameraProtocol(f"The camera delivered no picture that rig reads ({names}): set it to RAW.")


def has_raw(objects: list[Download]) -> bool:
    """Return whether one of them is a RAW file."""
    return any(suffix(file) in raw.SUFFIXES for file in objects)


def developed_beside(best: Download, objects: list[Download]) -> Download | None:
    """The photograph of a shot that has a RAW file too, or None."""
    if suffix(best) not in raw.SUFFIXES:
        return None
    return next((file for file in objects if suffix(file) in photo.SUFFIXES), None)


def camera_file(data: bytes, file: Download) -> CameraFile:
    """A downloaded file by its header; InputError if that, or its end, shows it to be damaged or cut off.

    Its pixels are not decoded here: the camera would wait for that.
    """
    kind = suffix(file)
    if kind in raw.SUFFIXES:
        header = raw.read_raw_header(data, kind)
        return CameraFile(data, kind, header.width, header.height, header.metadata, header.white.bit_length())
    width, height, metadata = photo.read_photo_header(data, file.info.filename)
    return CameraFile(data, kind, width, height, metadata)
