"""Radiance pictures (.hdr): linear light as RGBE (Ward, "Real Pixels", Graphics Gems II, 1991)."""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import imagecodecs
import numpy as np

from imaging.arrays import Array32
from imaging.colour.spaces import rec709_from_rgb
from imaging.compute.memory import check_picture
from imaging.errors import InputError
from imaging.files.exr.reading import read_exr
from imaging.files.silence import quiet

SUFFIX = ".hdr"
_MAGICS = (b"#?RADIANCE", b"#?RGBE")
_LONGEST_HEADER = 1 << 16
_SIZE = re.compile(rb"-Y (\d{1,9}) \+X (\d{1,9})")


@dataclass(frozen=True, eq=False)
class Light:
    """pixels: linear Rec.709, float32 [H, W, 3]; alpha: how opaque each is, 0..1, float32 [H, W], None where
    all is opaque. Colours are over black.
    """

    pixels: Array32
    alpha: Array32 | None = None

    @property
    def transparent(self) -> float:
        """Share of the pixels, 0..1, that are so in part or wholly."""
        return 0.0 if self.alpha is None else float(np.mean(self.alpha < 1))


def read_light(path: Path) -> Array32:
    """Linear Rec.709 of an EXR or Radiance file, by its suffix, float32 [H, W, 3]; errors as `read_hdr`."""
    return read_with_alpha(path).pixels


def read_with_alpha(path: Path) -> Light:
    """Light and alpha of an EXR or Radiance file, by its suffix; errors as `read_hdr`."""
    if path.suffix.lower() == SUFFIX:
        return Light(read_hdr(path))
    image = read_exr(path)
    try:
        return Light(np.asarray(image.rgb(), np.float32), image.alpha)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def read_hdr(path: Path) -> Array32:
    """Read linear Rec.709, float32 [H, W, 3]: the file's exposure and colour correction are divided out.

    Other primaries that it names are converted; without any they are those of Rec.709. InputError if it is
    no such file, is damaged, larger than the memory, in XYZE, or not in rows from the top left.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(f"{path} cannot be read ({reason}): correct the path or its permissions.") from error
    if not data.startswith(_MAGICS):
        raise InputError(f"{path} is not a Radiance file: choose one that is.")
    head, blank, rest = data[:_LONGEST_HEADER].partition(b"\n\n")
    size = _SIZE.fullmatch(rest.partition(b"\n")[0].strip())
    if not blank or size is None:
        raise InputError(f"{path} is damaged, or not in rows from the top left: write or copy it again.")
    lines = [line.decode("latin-1").partition("=") for line in head.splitlines()]
    if any(name == "FORMAT" and "xyze" in value for name, _, value in lines):
        raise InputError(f"{path} is in XYZE, which rig does not read: convert it to RGBE or EXR.")
    height, width = (int(side) for side in size.groups())
    check_picture(str(path), width, height)
    try:
        with quiet():
            light = np.array(imagecodecs.rgbe_decode(data), np.float32)
        if light.shape != (height, width, 3):
            raise ValueError
        light *= _scale(lines)
    except (imagecodecs.RgbeError, ValueError) as error:
        raise InputError(f"{path} is damaged or cut off: write or copy it again.") from error
    matrix = _rec709_from_own(lines)
    return light if matrix is None else np.asarray(light @ matrix.T, np.float32)


def _scale(lines: list[tuple[str, str, str]]) -> Array32:
    """Return what the pixels are to be multiplied by; ValueError for factors that cannot be."""
    factors = np.ones(3)
    for name, _, value in lines:
        if name in ("EXPOSURE", "COLORCORR"):
            factors = factors * _numbers(value, 1 if name == "EXPOSURE" else 3)
    if not np.all((factors > 1e-30) & (factors < 1e30)):
        raise ValueError("no exposure")
    return np.asarray(1 / factors, np.float32)


def _rec709_from_own(lines: list[tuple[str, str, str]]) -> Array32 | None:
    """Matrix from the primaries that the file names to Rec.709; None without any, or with nonsense."""
    for name, _, value in lines:
        if name == "PRIMARIES":
            try:
                x = _numbers(value, 8)
                return rec709_from_rgb(list(zip(x[::2], x[1::2], strict=True))).astype(np.float32)
            except ValueError:
                return None
    return None


def _numbers(text: str, count: int) -> list[float]:
    values = [float(part) for part in text.split()]
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ValueError("other numbers")
    return values
