"""Photographs in other colour spaces than sRGB: the profile that a file names, and the way to sRGB.

A photograph in Display P3 or Adobe RGB becomes what the same photograph is in sRGB, by littleCMS and
relative colorimetry, so that every later stage sees one space; of a grey one it is the curve that counts.
Profiles: ICC.1:2022; what a PNG says without one: its specification, 11.3.2 and 12.13; Adobe RGB by EXIF: DCF
2.0, option file R03.
"""

import struct
import zlib
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO

import imagecodecs
import numpy as np
import numpy.typing as npt
from PIL import ImageCms

from imaging.arrays import Array32
from imaging.colour.spaces import srgb_decode, srgb_encode
from imaging.errors import InputError
from imaging.files.heif_webp import embedded_icc, heif_colour, is_heif, is_webp
from imaging.files.jpeg_png import JPEG_MAGIC, PNG_MAGIC, jpeg_segments, jpeg_shell, png_chunks
from imaging.files.tags import cicp
from imaging.files.tiff.directory import Directory, TiffError, TiffReader, integers, numbers
from imaging.files.tiff.exif import is_adobe_rgb
from imaging.files.tiff.image import INVERTED
from imaging.files.tiff.pages import photograph

LARGEST = 1 << 22
"""Bytes of a profile beyond which it is damage."""
SAME = 1.5 / 255
"""Code values by which a space may differ from sRGB and count as it."""
SAME_POINT = 2e-3
"""CIE xy by which white and primaries may differ from those of sRGB and count as them."""
EXACT = 2e-3
"""Largest miss of primaries and curves for a profile of linear light to count as exact."""

_WHITE, _REC709 = [0.3127, 0.3290], [0.64, 0.33, 0.30, 0.60, 0.15, 0.06]
_ICC_TAG, _APP2 = 34675, 0xE2
_BITS, _PHOTOMETRIC, _TRANSFER, _WHITE_POINT, _PRIMARIES, _TRANSFER_RANGE = 258, 262, 301, 318, 319, 342
_PNG_COLOUR = (b"IHDR", b"cICP", b"iCCP", b"sRGB", b"gAMA", b"cHRM")
_NOTHING = (b"", "")
_SRGB_GAMMA = 0.45455
"""Gamma written beside the sRGB chunk, for readers that do not know that one."""
_ROWS, _TOP = 64, 65535
_CICP, _NCLX = "cICP chunk", "nclx colour"
_SRGB_CURVE = np.rint(_TOP * srgb_decode(np.linspace(0, 1, 4096))).astype(np.uint16)


@dataclass(frozen=True, eq=False)
class Profile:
    """A way to sRGB. name: as the profile says. curves: float32 [3, 65536], light of every code of 16 bits,
    and matrix [3, 3], to linear Rec.709; None where the profile is not made of these. icc: the profile.
    """

    name: str
    icc: bytes
    curves: Array32 | None
    matrix: Array32 | None

    def apply(self, pixels: Array32) -> None:
        """Turn code values [H, W, 3], 0..1, into those of sRGB, in place; what is beyond them is clipped."""
        for top in range(0, len(pixels), _ROWS):
            strip = pixels[top : top + _ROWS]
            if self.curves is None or self.matrix is None:
                strip[:] = np.clip(np.nan_to_num(_through(strip, self.icc, _srgb())), 0.0, 1.0)
                continue
            place = np.rint(strip * _TOP).astype(np.uint16)
            light = np.stack([self.curves[c][place[..., c]] for c in range(3)], axis=-1) @ self.matrix.T
            strip[:] = _encoding()[np.rint(light.clip(0.0, 1.0) * _TOP).astype(np.uint16)]


def profile_of(data: bytes) -> Profile | None:
    """The colour profile of a JPEG, PNG or TIFF file; None where it is sRGB, absent or damaged.

    InputError, without the name of the file, if it declares samples that rig does not read.
    """
    icc, name = _embedded(data)
    if name in (_CICP, _NCLX):
        return _by_cicp(icc[:4], icc[4], name)
    return None if len(icc) > LARGEST else _profile(icc, name)


def _by_cicp(body: bytes, bits: int, where: str) -> Profile | None:
    space = cicp.space_of(body, bits, where)
    if space is None:
        return None
    name, light, matrix = space
    with np.errstate(invalid="ignore"):
        same = np.abs(srgb_encode(light) - np.linspace(0, 1, _TOP + 1)).max() < SAME
    if same and np.abs(matrix - np.eye(3)).max() < EXACT:
        return None
    return Profile(name, b"", np.tile(light.astype(np.float32), (3, 1)), matrix.astype(np.float32))


@lru_cache(maxsize=16)
def _profile(icc: bytes, name: str) -> Profile | None:
    cicp.refuse_hdr(_transfer(icc), "colour profile")
    if icc[16:20] == b"GRAY":
        return _grey_profile(icc)
    if icc[16:20] != b"RGB ":
        return None
    try:
        grid = np.linspace(0.0, 1.0, 9, dtype=np.float32)
        cube = np.stack(np.meshgrid(grid, grid, grid), axis=-1).reshape(-1, 1, 3)
        if np.abs(np.clip(_through(cube, icc, _srgb()), 0, 1) - cube).max() < SAME:
            return None
        linear, ramp = _linear(), np.linspace(0.0, 1.0, _TOP + 1, dtype=np.float32)
        single = [
            _through(ramp[:, None, None] * np.eye(3, dtype=np.float32)[c], icc, linear)[:, 0]
            for c in range(3)
        ]
        matrix = np.stack([column[-1] for column in single], axis=1)
        with np.errstate(all="ignore"):  # a channel without light has no curve
            curves = np.stack([column @ column[-1] / (column[-1] @ column[-1]) for column in single])
        decoded = np.stack([curves[c][np.rint(cube[:, 0, c] * _TOP).astype(int)] for c in range(3)], axis=-1)
        exact = np.abs(decoded @ matrix.T - _through(cube, icc, linear)[:, 0]).max() < EXACT
    except (imagecodecs.CmsError, ValueError, FloatingPointError):
        return None
    parts = (curves.astype(np.float32), matrix.astype(np.float32)) if exact else (None, None)
    return Profile(name or _name(icc), icc, *parts)


def _grey_profile(icc: bytes) -> Profile | None:
    """A profile of one channel: its curve, the same for three."""
    ramp = np.linspace(0.0, 1.0, _TOP + 1, dtype=np.float32)
    try:
        light = _through(ramp[:, None], icc, _linear(), "gray")[:, 0, 1].clip(0, 1)
    except (imagecodecs.CmsError, ValueError, IndexError):
        return None
    if not np.all(np.isfinite(light)) or np.abs(srgb_encode(light) - ramp).max() < SAME:
        return None
    return Profile(_name(icc), icc, np.tile(light, (3, 1)), np.eye(3, dtype=np.float32))


def _transfer(icc: bytes) -> int:
    """TransferCharacteristics of the tag `cicp` of a profile (ICC.1:2022, 9.2.17); 2 where it has none."""
    count = int.from_bytes(icc[128:132])
    for at in range(132, min(132 + 12 * count, len(icc)), 12):
        if icc[at : at + 4] == b"cicp":
            place = int.from_bytes(icc[at + 4 : at + 8])
            return next(iter(icc[place + 9 : place + 10]), cicp.UNSPECIFIED)
    return cicp.UNSPECIFIED


@lru_cache(maxsize=1)
def _linear() -> bytes:
    return bytes(imagecodecs.cms_profile("rgb", whitepoint=_WHITE, primaries=_REC709, gamma=1.0))


@lru_cache(maxsize=1)
def _encoding() -> Array32:
    """sRGB codes of light in steps of 16 bits, which are to within 1e-4 of it: far faster than powers."""
    return np.asarray(srgb_encode(np.linspace(0.0, 1.0, _TOP + 1)), np.float32)


@lru_cache(maxsize=1)
def _srgb() -> bytes:
    return bytes(imagecodecs.cms_profile("srgb"))


def _through(codes: Array32, icc: bytes, to: bytes, space: str = "rgb") -> Array32:
    return np.asarray(
        imagecodecs.cms_transform(
            np.ascontiguousarray(codes, np.float32),
            icc,
            to,
            colorspace=space,
            outcolorspace="rgb",
            outdtype="float32",
            intent=imagecodecs.CMS.INTENT.RELATIVE_COLORIMETRIC,
        ),
        np.float32,
    )


def _name(icc: bytes) -> str:
    try:
        description = ImageCms.getProfileDescription(ImageCms.ImageCmsProfile(BytesIO(icc)))
    except (ImageCms.PyCMSError, OSError, ValueError):
        description = ""
    name = " ".join("".join(c if c.isprintable() else " " for c in description).split())[:60]
    return name or "a space without a name"


def _embedded(data: bytes) -> tuple[bytes, str]:
    """The profile in a file; or one made of what the file says in its place, and its name.

    Empty where the space is sRGB or nothing is said.
    """
    try:
        if data.startswith(JPEG_MAGIC):
            return _of_jpeg(data)
        if data.startswith(PNG_MAGIC):
            return _of_png(data)
        if is_webp(data):
            return embedded_icc(data), ""
        if is_heif(data):
            return _of_heif(data)
        return _of_tiff(photograph(TiffReader(BytesIO(data)))[1])
    except (TiffError, zlib.error, struct.error, imagecodecs.CmsError, ValueError):
        return _NOTHING


def _of_tiff(tags: Directory) -> tuple[bytes, str]:
    """The profile of a photograph; else what TIFF 6.0, section 20, has of white, primaries and curve."""
    value = tags.get(_ICC_TAG)
    if isinstance(value, bytes):
        return value, ""
    points, curve = [*_WHITE, *_REC709], _curve_of(tags)
    stated = [*(numbers(tags, _WHITE_POINT) or _WHITE), *(numbers(tags, _PRIMARIES) or _REC709)]
    if len(stated) == len(points) and not np.abs(np.subtract(stated, points)).max() < SAME_POINT:
        return _made(stated, curve), "the space of their tags PrimaryChromaticities and TransferFunction"
    return _NOTHING if curve is None else (_made(points, curve), "the space of their tag TransferFunction")


def _curve_of(tags: Directory) -> npt.NDArray[np.uint16] | None:
    """TransferFunction as three rows of light, 0..65535, over codes from black to white; None if it has none.

    InputError, without the name of the file, if its codes differ from those of the photograph.
    """
    curve = integers(tags, _TRANSFER)
    if not curve:
        return None
    bits = next(iter(integers(tags, _BITS)), 8)
    if integers(tags, _TRANSFER_RANGE) or len(curve) not in (2**bits, 3 * 2**bits) or max(curve) > _TOP:
        raise InputError(
            "has a TransferFunction of other codes than its own (TransferRange): convert it to sRGB"
        )
    table = np.broadcast_to(np.reshape(curve, (-1, 2**bits)), (3, 2**bits))
    if integers(tags, _PHOTOMETRIC)[:1] == (INVERTED,):
        table = table[:, ::-1]
    places = np.linspace(0, 2**bits - 1, min(2**bits, 4096))  # littleCMS takes no curve of 65536 places
    rows = [np.interp(places, np.arange(2**bits), row) for row in table]
    return np.rint(rows).astype(np.uint16)


def _of_jpeg(data: bytes) -> tuple[bytes, str]:
    """The chunks of APP2 in their order; else what EXIF says of Adobe RGB."""
    file, prefix = BytesIO(data), b"ICC_PROFILE\0"
    bodies = [body for body in jpeg_segments(file, _APP2) if body.startswith(prefix) and len(body) > 14]
    if bodies:
        return b"".join(body[14:] for body in sorted(bodies, key=lambda body: body[12])), ""
    if not is_adobe_rgb(jpeg_shell(file).exif):
        return _NOTHING
    primaries = [0.64, 0.33, 0.21, 0.71, 0.15, 0.06]
    return _made([*_WHITE, *primaries], 563 / 256), "Adobe RGB (1998), as EXIF has it"


def _of_heif(data: bytes) -> tuple[bytes, str]:
    """The profile; else the numbers of `nclx`. InputError where these say HDR, beside a profile too."""
    icc, nclx = heif_colour(data)
    if nclx:
        cicp.refuse_hdr(nclx[1], _NCLX)
    return (icc, "") if icc or not nclx else (nclx + b"\x08", _NCLX)


def _of_png(data: bytes) -> tuple[bytes, str]:
    file = BytesIO(data)
    chunks = {kind: file.read(length) for kind, length in png_chunks(file) if kind in _PNG_COLOUR}
    cicp_bytes = chunks.get(b"cICP", b"")
    if cicp_bytes and cicp_bytes[:2] != bytes((cicp.UNSPECIFIED, cicp.UNSPECIFIED)):
        return cicp_bytes.ljust(4, b"\0")[:4] + bytes((16 if chunks[b"IHDR"][8:9] == b"\x10" else 8,)), _CICP
    if b"iCCP" in chunks:
        packed = chunks[b"iCCP"].partition(b"\0")[2][1:]
        return zlib.decompressobj().decompress(packed, LARGEST + 1), ""
    if b"sRGB" in chunks or not {b"gAMA", b"cHRM"} & set(chunks):
        return _NOTHING
    gamma = struct.unpack(">I", chunks[b"gAMA"])[0] / 100_000 if b"gAMA" in chunks else None
    points = [*_WHITE, *_REC709]
    if b"cHRM" in chunks:
        points = [value / 100_000 for value in struct.unpack(">8I", chunks[b"cHRM"])]
    near = np.abs(np.subtract(points, [*_WHITE, *_REC709])).max() < SAME_POINT
    if gamma is None:
        return _NOTHING if near else (_made(points, None), "the space of their cHRM chunk")
    if not 0.2 < gamma <= 2 or (near and abs(gamma - _SRGB_GAMMA) < 1e-3):
        return _NOTHING
    return _made(points, 1 / gamma), "the space of their gAMA and cHRM chunks"


def _made(points: list[float], gamma: float | npt.NDArray[np.uint16] | None) -> bytes:
    """Build a profile from white, red, green and blue, CIE xy, and a power or a table; None: the curve of
    sRGB.
    """
    table = _SRGB_CURVE if gamma is None else gamma
    curve = {"gamma": table} if isinstance(table, float) else {"transferfunction": table}
    return bytes(imagecodecs.cms_profile("rgb", whitepoint=points[:2], primaries=points[2:], **curve))
