"""The pixels of one shot: a file of any kind read as numbers between 0 and 1, scaled down if asked."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from imaging.arrays import AnyArray, Array32, Mask
from imaging.demosaicking.demosaic import demosaic
from imaging.files.photo import read_photo
from imaging.files.radiance_hdr import read_with_alpha
from imaging.files.raw import read_raw
from imaging.merge.linear_frame import LinearFrame, decode, from_codes, from_light, from_raw
from imaging.merge.masks import read_mask
from imaging.sensor.cfa import Cfa
from imaging.sensor.sensor_calibration import SensorCalibration
from imaging.session.calibration import Response
from imaging.session.records import ImageKind
from recon.data.shot import HeldPlanes, Shot
from recon.data.tone import encode

_DECODED: ContextVar[dict[tuple[object, ...], tuple[Shot, Cfa | None]] | None] = ContextVar(
    "decoded", default=None
)


@dataclass(frozen=True)
class ShotSource:
    """A shot's file, and all that its pixels depend on beside it.

    max_width: px, of the shot; wider ones are scaled down. sensors: of the calibration, for RAW. mask: a
    picture (`imaging.merge.masks`) whose black pixels are not valid in the shot.
    """

    path: Path
    name: str
    kind: ImageKind
    response: Response
    max_width: int | None = None
    sensors: tuple[SensorCalibration, ...] = ()
    mask: Path | None = None

    def decoded(self, k: float) -> tuple[Shot, Cfa | None]:
        """Decode the file anew, as `read_shot` without a cache."""
        shot, cfa, size = self._read(k)
        shot = shot.showing(saturated=_held(shot.saturated), dark=_held(shot.dark), valid=_held(shot.valid))
        if self.mask is None:
            return shot, cfa
        counts = read_mask(self.mask, *size)
        height, width = shot.pixels.shape[:2]
        if self.kind == "raw" and 2 * width <= counts.shape[1]:
            counts = _even(counts)
        elif cfa is not None:
            counts = whole_tiles(counts, cfa)
        if counts.shape != (height, width):
            # A pixel of the smaller image counts if all that it is made of does.
            counts = area_mean(counts, (width, height)) > 0.999
        return shot.showing(valid=shot.valid & (counts if shot.pixels.ndim == 2 else counts[..., None])), cfa

    def _read(self, k: float) -> tuple[Shot, Cfa | None, tuple[int, int]]:
        """The shot, the CFA of its mosaic, and height and width of the file."""
        if self.kind == "raw":
            raw = from_raw(read_raw(self.path), k, self.sensors)
            shot, cfa = _mosaic(raw, self.name, self.max_width)
            return shot, cfa, (raw.signal.shape[0], raw.signal.shape[1])
        if self.kind == "ldr":
            photo = read_photo(self.path)
            codes, alpha = np.ascontiguousarray(photo.pixels, np.float32), photo.alpha
            frame = from_codes(codes, k, self.response)
            planes = HeldPlanes(codes, frame.saturated, frame.dark, frame.valid, alpha)
            shot = Shot(self.name, k, planes, frame.noise)
            size = _smaller(codes, self.max_width)
            small = shot if size is None else _smaller_photograph(shot, frame.signal, self.response, size)
            return small, None, (codes.shape[0], codes.shape[1])
        image = read_with_alpha(self.path)
        frame = from_light(image.pixels, k)
        never = np.zeros(frame.signal.shape, bool)
        shot = Shot(self.name, k, HeldPlanes(frame.signal, never, never, frame.valid, image.alpha))
        size = _smaller(frame.signal, self.max_width)
        whole = frame.signal.shape[0], frame.signal.shape[1]
        return shot if size is None else _smaller_light(shot, size), None, whole


def read_shot(source: ShotSource, k: float) -> tuple[Shot, Cfa | None]:
    """One file as a Shot of exposure scale `k`, and the CFA of its mosaic if it is one."""
    cache_of = _DECODED.get()
    if cache_of is None:
        return source.decoded(k)
    # A session is named from here by its user, and from its root by the scene in it.
    files = [os.path.realpath(file) for file in (source.path, source.mask) if file is not None]
    written = tuple((file, os.stat(file).st_mtime_ns) for file in files)
    what = (written, replace(source, path=Path(), mask=None), k)
    if what not in cache_of:
        cache_of[what] = source.decoded(k)
    return cache_of[what]


@contextmanager
def decoded_once() -> Iterator[None]:
    """Cache decoded files within the block; an unchanged file is not decoded again.

    For a training that is evaluated and reported at once: each of them reads the same shots, which stay in
    memory until the block ends, as those of one data set do anyway.
    """
    if _DECODED.get() is not None:  # within such a block
        yield
        return
    before = _DECODED.set({})
    try:
        yield
    finally:
        _DECODED.reset(before)


def _held(mask: Mask) -> Mask:
    """A mask as it is, or where it is the same everywhere as a view of one byte that cannot be written to."""
    alike = bool(mask.all()) or not mask.any()
    return np.broadcast_to(mask.flat[0], mask.shape) if alike else mask


def narrowed(
    shot: Shot, kind: ImageKind, cfa: Cfa | None, response: Response, width: int
) -> tuple[Shot, Cfa | None]:
    """A shot at a smaller width, as its file would be read.

    Args:
        shot: As read.
        kind: Of its camera's files.
        cfa: Of the shot, where it is a mosaic.
        response: Of its camera, between code values and linear light; for photographs alone.
        width: Of the result at most, px.

    Returns:
        The shot, and the CFA of what is still a mosaic; None of anything else.
    """
    if kind == "raw":
        small, smaller_cfa = _mosaic(shot.linear(None, cfa), shot.file, width)
        if cfa is not None and smaller_cfa is None:  # what was demosaicked has numbers also behind a mask
            height, wide = small.shape[:2]
            there = area_mean(_even(shot.valid), (wide, height)) > 0.5
            small = small.showing(valid=small.valid & there[..., None])
        return replace(small, band=shot.band), smaller_cfa
    size = _smaller(shot.pixels, width)
    if size is None:
        return shot, cfa
    if kind == "hdr":
        return _smaller_light(shot, size), cfa
    return _smaller_photograph(shot, decode(shot.pixels, response), response, size), cfa


def _smaller_photograph(shot: Shot, signal: Array32, response: Response, size: tuple[int, int]) -> Shot:
    """A photograph whose linear `signal` is averaged over areas."""
    saturated, dark = (area_mean(mask, size) > 0.5 for mask in (shot.saturated, shot.dark))
    return shot.showing(
        pixels=encode(area_mean(signal, size), response),
        saturated=saturated,
        dark=dark,
        valid=area_mean(shot.valid, size) > 0.999,
        alpha=None if shot.alpha is None else area_mean(shot.alpha, size),
    )


def _smaller_light(shot: Shot, size: tuple[int, int]) -> Shot:
    """Light averaged over what is valid of each area."""
    weight = area_mean(shot.valid, size)
    never = np.zeros(weight.shape, bool)
    light = area_mean(np.where(shot.valid, shot.pixels, 0), size) / weight.clip(1e-6)
    return shot.showing(
        pixels=np.ascontiguousarray(light, np.float32),
        saturated=never,
        dark=never,
        valid=weight > 0.5,
        alpha=None if shot.alpha is None else area_mean(shot.alpha, size),
    )


def _mosaic(frame: LinearFrame, name: str, max_width: int | None) -> tuple[Shot, Cfa | None]:
    cfa = frame.cfa
    # From so much on, every pixel of the smaller image has sites of all colours under it, and the mosaic
    # has nothing left to say; below that, scaling a mosaic would blur it for little.
    cell = 2 if cfa is None else cfa.cell
    small = max_width is not None and _even(frame.signal).shape[1] >= cell * max_width
    size = _smaller(_even(frame.signal), max_width) if small else None
    parts = (frame.signal, frame.saturated, frame.valid)
    signal, saturated, valid = ((_even(one) if size else whole_tiles(one, cfa)) for one in parts)
    if size and (cfa is None or cfa.mono):
        weight = area_mean(valid, size)
        signal = area_mean(np.where(valid, signal, 0), size) / weight.clip(1e-6)
        saturated, valid = area_mean(saturated & valid, size) > 0, weight > 0.5
    elif size and cfa is not None:
        sigma = None if frame.noise is None else np.sqrt(frame.noise.variance(signal))
        colours = demosaic(signal, cfa, valid, sigma, spread=False)
        # The sites around a defect stand in for it, and where none is near enough, the rest of the area.
        weight = area_mean(colours.known, size)
        signal = area_mean(colours.rgb, size) / weight.clip(1e-6)
        full = area_mean(saturated & valid, size) > 0
        saturated = np.repeat(full[..., None], signal.shape[2], axis=2)
        valid, cfa = weight > 0, None
    never = np.zeros(signal.shape, bool)
    saturated, valid = np.ascontiguousarray(saturated), np.ascontiguousarray(valid)
    signal = np.ascontiguousarray(signal)
    return Shot(name, frame.k, HeldPlanes(signal, saturated, never, valid), frame.noise, frame.ceiling), cfa


def _even(image: AnyArray) -> AnyArray:
    """An image without an odd last row or column."""
    height, width = image.shape[:2]
    return image[: height - height % 2, : width - width % 2]


def whole_tiles(image: AnyArray, cfa: Cfa | None) -> AnyArray:
    """A mosaic, or what goes with it, without the last rows and columns that complete no tile."""
    if cfa is None:
        return image
    height, width = (side // length * length for side, length in zip(image.shape, cfa.period, strict=True))
    return image[:height, :width]


def _smaller(image: npt.NDArray[np.generic], max_width: int | None) -> tuple[int, int] | None:
    height, width = image.shape[:2]
    if max_width is None or width <= max_width:
        return None
    return max_width, max(round(height * max_width / width), 1)


def area_mean(image: npt.NDArray[np.generic], size: tuple[int, int]) -> Array32:
    """An image [H, W, ...] averaged over areas, `size` being the width and height that it is to have."""
    return np.asarray(cv2.resize(image.astype(np.float32), size, interpolation=cv2.INTER_AREA), np.float32)
