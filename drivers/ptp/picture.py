"""Files of a shot: which one to take, and its bytes as a frame."""

from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from drivers.camera import EncodedPhoto
from drivers.errors import CameraProtocol
from drivers.ptp.codes import FormatCode
from drivers.ptp.session import Download
from imaging.files import photo, raw
from imaging.mosaic import RawMosaic

_SUFFIXES = {
    FormatCode.DNG: ".dng",
    FormatCode.EXIF_JPEG: ".jpg",
    FormatCode.TIFF: ".tif",
    FormatCode.CANON_CR3: ".cr3",
}


def suffix(one: Download) -> str:
    """What the file is, by its name, by its format where the name does not say; empty if neither does."""
    named = PurePath(one.info.filename).suffix.lower()
    if named in raw.SUFFIXES or named in photo.SUFFIXES:
        return named
    return _SUFFIXES.get(FormatCode(one.info.format), "") if one.info.format in _SUFFIXES else ""


def best_of(objects: list[Download]) -> Download:
    """The RAW file if there is one, else the photograph; CameraProtocol if there is neither."""
    for suffixes in (raw.SUFFIXES, photo.SUFFIXES):
        for one in objects:
            if suffix(one) in suffixes:
                return one
    names = ", ".join(one.info.filename for one in objects) or "nothing"
    raise CameraProtocol(f"The camera delivered no picture that rig reads ({names}): set it to RAW.")


def decode(data: bytes, one: Download) -> RawMosaic | EncodedPhoto:
    """The frame in a downloaded file, read to its end; InputError if it is damaged."""
    kind = suffix(one)
    with TemporaryDirectory(prefix="rig-") as folder:
        path = Path(folder) / f"picture{kind}"
        path.write_bytes(data)
        if kind in raw.SUFFIXES:
            return raw.read_raw(path)
        read = photo.read_photo(path)
        height, width, _ = read.pixels.shape
        return EncodedPhoto(data, kind, width, height, read.metadata)
