"""Display-referred photographs: JPEG, PNG, TIFF, WebP and HEIF of 8 or 16 bits, and their EXIF."""

from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import imagecodecs
import numpy as np
import numpy.typing as npt
from PIL import Image

from imaging.arguments import checked
from imaging.arrays import AnyArray, Array32, Bytes
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files.heif_webp import (
    HEIF_SUFFIXES,
    WEBP_SUFFIXES,
    decode_heif,
    decode_webp,
    heif_is_read,
    heif_metadata,
    is_avif,
    is_heif,
    is_webp,
    webp_metadata,
)
from imaging.files.jpeg_png import (
    JPEG_MAGIC,
    PNG_MAGIC,
    Shell,
    jpeg_is_whole,
    jpeg_shell,
    png_is_whole,
    png_shell,
)
from imaging.files.silence import quiet
from imaging.files.tags.gain_map import ASIDE, holds_gain_map
from imaging.files.tags.icc import profile_of
from imaging.files.tags.xmp import noted
from imaging.files.tiff.directory import TiffError, TiffReader
from imaging.files.tiff.exif import decode_exif, encode_exif, read_exif
from imaging.files.tiff.image import UnfitError, decode_tiff
from imaging.sensor.mosaic import FrameMetadata

SUFFIXES = frozenset((".jpg", ".jpeg", ".png", ".tif", ".tiff")) | WEBP_SUFFIXES

PNG_LEVEL = 1
"""Deflate level: the higher ones take three times as long for files that are 7 % smaller."""
_ROWS = 64
"""Rows that are computed with at a time: copies of a large picture would fill the memory."""
_MOST_DEFLATED = 1032
"""Bytes that deflate can make of one."""

_TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


@dataclass(frozen=True)
class Photo:
    """pixels: float32 [H, W, 3], code values divided by the largest, 0..1; bit_depth: 8 or 16.

    The pixel grid is as stored: the orientation of the metadata is not applied. alpha: float32 [H, W], how
    opaque each pixel is, 0..1, None where all is opaque; colours are over black. profile:
    name of the colour space that the file is in, and the pixels were; "": sRGB, or not stated. doubt: the end
    of a sentence about what of the file was not read, or "".
    """

    pixels: Array32
    bit_depth: int
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    alpha: Array32 | None = None
    profile: str = ""
    doubt: str = ""

    @property
    def transparent(self) -> float:
        """Share of the pixels, 0..1, that are so in part or wholly."""
        return 0.0 if self.alpha is None else float(np.mean(self.alpha < 1))


def is_photo(path: Path) -> bool:
    """Return whether the suffix is one of JPEG, PNG, TIFF or WebP, or of HEIF where its package is
    installed.
    """
    suffix = path.suffix.lower()
    return suffix in SUFFIXES or (suffix in HEIF_SUFFIXES and heif_is_read())


@checked
def read_photo(path: str | Path) -> Photo:
    """Read the first image of a JPEG, PNG, TIFF, WebP or HEIF file, recognised by its content.

    Grey becomes three equal channels. A photograph in another colour space is converted to sRGB
    (`imaging.files.tags.icc`). Transparent pixels are composited over black, in linear light as the PNG
    specification (12.16) has it; the sRGB curve decodes them, whatever the camera's.

    Args:
        path: File.

    Returns:
        Code values 0..1, float32 [H, W, 3], with alpha, bit depth, profile and metadata.

    Raises:
        InputError: The file is of another kind, damaged, of other than 8 or 16 bits, or larger than the
            memory.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error
    return decode_photo(data, str(path))


def decode_photo(data: bytes, name: str) -> Photo:
    """The same of bytes in memory; `name` is what errors call them."""
    codes = decode_codes(data, name)
    largest = np.float32(np.iinfo(codes.dtype).max)
    pixels = _three_channels(codes).astype(np.float32)
    pixels /= largest
    try:
        profile = profile_of(data)
    except InputError as error:
        raise InputError(f"{name} {error}.") from None
    if profile is not None:
        profile.apply(pixels)
    alpha = _onto_black(pixels, codes[..., -1]) if codes.shape[2] in (2, 4) else None
    metadata = _metadata(BytesIO(data)) or FrameMetadata()
    space, doubt = "" if profile is None else profile.name, ASIDE if holds_gain_map(data) else ""
    return Photo(pixels, 8 * codes.dtype.itemsize, metadata, alpha, space, doubt)


def read_photo_header(data: bytes, name: str) -> tuple[int, int, FrameMetadata]:
    """Width, height and metadata of the bytes of a photograph; of JPEG and PNG no pixel is decoded.

    InputError as `read_photo`, also where the file is seen to be cut off; damage among the pixels is not.
    """
    file = BytesIO(data)
    if data.startswith(JPEG_MAGIC):
        shell, whole = jpeg_shell(file), jpeg_is_whole(data)
    elif data.startswith(PNG_MAGIC):
        shell, whole = png_shell(file), png_is_whole(file)
    else:
        decoded = decode_photo(data, name)
        height, width, _ = decoded.pixels.shape
        return width, height, decoded.metadata
    if not (whole and shell.width and shell.height):
        raise InputError(f"{name} is damaged or cut off: copy it again from the camera.")
    return shell.width, shell.height, _said_by(shell)


def decode_codes(data: bytes, name: str, fix: str = "copy it again from the camera") -> AnyArray:
    """Code values of a JPEG, PNG or TIFF file, uint8 or uint16 [H, W, C]; errors as `read_photo`.

    C: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha. fix: what to do about damage.
    """
    if not data:
        raise InputError(f"{name} is empty: {fix}.")
    try:
        decode = _decoder(data)
        if decode is None:
            raise InputError(f"{name} is not a JPEG, PNG or TIFF file: convert it to one of them.")
        codes = np.asarray(decode(data, name))
        if codes.ndim == 2:
            codes = codes[..., None]
        if codes.ndim != 3 or codes.size == 0:
            raise ValueError("no image")
        return codes
    except InputError:
        raise
    except UnfitError as error:
        raise InputError(f"{name} {error}.") from error
    except Exception as error:  # the decoders raise whatever damaged bytes make them trip over
        raise InputError(f"{name} is damaged or cut off: {fix}.") from error


def read_metadata(path: Path) -> FrameMetadata:
    """Read camera and exposure of any supported file (photograph, RAW, EXR, HDR), without its pixels.

    InputError if there is no such file or it is of no kind that rig reads.
    """
    from imaging.files import radiance_hdr, raw  # they load LibRaw, which a photograph does not need
    from imaging.files.exr.reading import read_exr_header

    if raw.is_raw(path):
        return raw.read_raw_metadata(path)
    if path.suffix.lower() == ".exr":
        return FrameMetadata(exposure=read_exr_header(path).exposure)
    if path.suffix.lower() == radiance_hdr.SUFFIX:
        return FrameMetadata()
    try:
        with path.open("rb") as file:
            metadata = _metadata(file)
    except OSError as error:
        raise _unreadable(path, error) from error
    if metadata is None:
        raise InputError(f"{path} is not a photograph, RAW or EXR file: convert it to one of them.")
    return metadata


def encode_jpeg(pixels: Bytes, quality: int = 95, metadata: FrameMetadata | None = None) -> bytes:
    """JPEG bytes of uint8 [H, W, 3] or [H, W], colour not subsampled, with EXIF if there is metadata."""
    if pixels.dtype != np.uint8:
        raise ValueError(f"a JPEG has uint8 pixels, not {pixels.dtype}")
    extra = {} if metadata is None else {"exif": encode_exif(metadata)}
    buffer = BytesIO()
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.save(buffer, "JPEG", quality=quality, subsampling=0, **extra)
    return buffer.getvalue()


def encode_png(pixels: Bytes | npt.NDArray[np.uint16]) -> bytes:
    """PNG bytes of uint8 or uint16 [H, W], [H, W, 3] or [H, W, 4], red first, straight alpha last."""
    if pixels.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a PNG has uint8 or uint16 pixels, not {pixels.dtype}")
    return bytes(imagecodecs.png_encode(np.ascontiguousarray(pixels), level=PNG_LEVEL))


def _unreadable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or str(error)).lower()
    return InputError(f"{path} cannot be read ({reason}): correct the path or its permissions.")


def _decoder(data: bytes) -> Any:
    if data.startswith(JPEG_MAGIC):
        return _jpeg
    if data.startswith(PNG_MAGIC):
        return _png
    if is_webp(data):
        return lambda data, name: decode_webp(data, name).codes
    if is_avif(data):
        raise UnfitError("is an AVIF picture, which rig does not read: convert it to JPEG or TIFF")
    if is_heif(data):
        if not heif_is_read():
            raise UnfitError("is a HEIF picture: install pillow-heif, or convert it to JPEG")
        return lambda data, name: decode_heif(data, name).codes
    return decode_tiff if data.startswith(_TIFF_MAGICS) else None


def _onto_black(pixels: Array32, alpha: AnyArray) -> Array32 | None:
    """Mix codes [H, W, 3] with black, in place, by alpha [H, W]; that as 0..1, None where all is opaque."""
    top = np.float32(np.iinfo(alpha.dtype).max)
    if (alpha == np.iinfo(alpha.dtype).max).all():
        return None
    cover = alpha.astype(np.float32) / top
    for rows in range(0, len(pixels), _ROWS):
        strip, share = pixels[rows : rows + _ROWS], cover[rows : rows + _ROWS]
        glassy = share < 1
        if glassy.any():
            strip[glassy] = srgb_encode(srgb_decode(strip[glassy]) * share[glassy, None])
    return cover


def _three_channels(codes: AnyArray) -> AnyArray:
    """[H, W, 3] of [H, W, C], without alpha."""
    return codes[..., :3] if codes.shape[2] >= 3 else codes[..., :1].repeat(3, axis=2)


def _jpeg(data: bytes, name: str) -> AnyArray:
    shell = jpeg_shell(BytesIO(data))
    if not jpeg_is_whole(data):
        raise ValueError("cut off")
    check_picture(name, shell.width, shell.height)
    with quiet():
        codes = np.asarray(imagecodecs.jpeg8_decode(data))
    if codes.dtype != np.uint8 or (codes.ndim == 3 and codes.shape[2] not in (1, 3)):
        raise UnfitError("is a JPEG of other than 8-bit grey or RGB: convert it to 8-bit RGB")
    return codes


def _png(data: bytes, name: str) -> AnyArray:
    shell = png_shell(BytesIO(data))
    if not png_is_whole(BytesIO(data)) or shell.width * shell.height > 8 * _MOST_DEFLATED * len(data):
        raise ValueError("cut off")
    check_picture(name, shell.width, shell.height, 4)
    with quiet():
        return np.asarray(imagecodecs.png_decode(data))


def _metadata(file: BinaryIO) -> FrameMetadata | None:
    """EXIF and XMP of an open file, empty if it has none or damaged; None if it is no photograph."""
    head = file.read(12)
    if head.startswith(JPEG_MAGIC):
        return _said_by(jpeg_shell(file))
    if head.startswith(PNG_MAGIC):
        return _said_by(png_shell(file))
    if head.startswith(_TIFF_MAGICS):
        try:
            return read_exif(TiffReader(file))
        except TiffError:
            return FrameMetadata()
    if is_webp(head):
        return webp_metadata(head + file.read())
    return _heif_metadata(head + file.read()) if is_heif(head) and heif_is_read() else None


def _said_by(shell: Shell) -> FrameMetadata:
    return noted(decode_exif(shell.exif) if shell.exif else FrameMetadata(), shell.xmp)


def _heif_metadata(data: bytes) -> FrameMetadata:
    try:
        return heif_metadata(data)
    except (
        ValueError,
        RuntimeError,
        OSError,
        EOFError,
    ):  # of a damaged file, which decoding its pixels reports
        return FrameMetadata()
