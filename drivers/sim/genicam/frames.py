"""A mosaic as the simulated machine vision camera sends it: pixel formats, windows, chunks, black levels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.genicam.chunks import join_chunks
from drivers.genicam.pixels import BY_CODE, FORMATS, PixelFormat
from drivers.sim.genicam.feature_registers import CHUNK_EXPOSURE, CHUNK_IMAGE, Feature
from drivers.sim.genicam.memory import FeatureMemory
from drivers.sim.genicam.pixels import pack
from imaging.sensor.cfa import Cfa, Tile
from imaging.sensor.mosaic import RawMosaic

GAMMA = 0.8
CHUNK_BYTES = 24
"""Bytes that chunks add to a payload: a tag of 8 bytes each, and the exposure time."""


def offered(cfa: Cfa, bits: int) -> Mapping[str, int]:
    """The pixel formats of a sensor, codes by name: 16 bits only where 12 are too few."""
    most = 16 if bits > 12 else bits
    return {
        pixel_format.name: pixel_format.code
        for pixel_format in FORMATS
        if pixel_format.cfa == cfa and pixel_format.bits <= most and (pixel_format.bits < 16 or bits > 12)
    }


def shift(pixels: PixelFormat, bits: int) -> int:
    """Right shift of values to fit a format, bits."""
    return max(bits - pixels.bits, 0)


def refresh(memory: FeatureMemory, cfa: Cfa, black: Tile, bits: int) -> int:
    """Set the registers that follow from others, largest value and black levels; returns a frame's bytes."""
    pixels = BY_CODE[memory.get(Feature.PIXEL_FORMAT)]
    size = pixels.row_bytes(memory.get(Feature.WIDTH) * memory.get(Feature.HEIGHT))
    lost = shift(pixels, bits)
    memory.put(Feature.DYNAMIC_RANGE_MAX, ((1 << bits) - 1) >> lost)
    sites = np.array(black) / (1 << lost)
    channels = cfa.channels(*sites.shape)
    levels = [sites.mean(), *(sites[channels == channel].mean() for channel in range(len(cfa.letters)))]
    for index, level in enumerate(levels):
        memory.put_float(Feature.BLACK_LEVEL, float(level), index)
    return size + (CHUNK_BYTES if memory.get(Feature.CHUNK_MODE) else 0)


def _processed(memory: FeatureMemory, mosaic: RawMosaic) -> RawMosaic:
    """Apply gamma and white balance, as far as they are on."""
    ratios = [memory.get(Feature.BALANCE_RATIO, index) / 1000 for index in range(2)]
    gamma = GAMMA if memory.get(Feature.GAMMA_ENABLE) else 1.0
    if mosaic.cfa is None or (gamma == 1.0 and ratios == [1.0, 1.0]):
        return mosaic
    gains = np.array([ratios[0], 1.0, ratios[1]])
    black, height, width = mosaic.black_map(), *mosaic.pixels.shape[:2]
    light = np.maximum(mosaic.pixels - black, 0.0) / (mosaic.white - black)
    light = light * gains[mosaic.cfa.channels(height, width)]
    values = black + np.minimum(light, 1.0) ** gamma * (mosaic.white - black)
    return replace(mosaic, pixels=np.rint(values).astype(np.uint16))


@dataclass(frozen=True)
class SentImage:
    """A frame as it is sent. code: of its pixel format; payload: with its chunks, if they are on."""

    code: int
    width: int
    height: int
    left: int
    top: int
    chunked: bool
    payload: bytes


def frame(memory: FeatureMemory, mosaic: RawMosaic, bits: int, time: float) -> SentImage:
    """The frame as the registers say. time: applied, s."""
    left, top = memory.get(Feature.OFFSET_X), memory.get(Feature.OFFSET_Y)
    width, height = memory.get(Feature.WIDTH), memory.get(Feature.HEIGHT)
    window = _processed(memory, mosaic).cropped(top, left, height, width)
    configured = BY_CODE[memory.get(Feature.PIXEL_FORMAT)]
    # The format of a frame names the phase of its own first pixel.
    pixels = next(
        pixel_format
        for pixel_format in FORMATS
        if (pixel_format.cfa, pixel_format.bits, pixel_format.packing)
        == (window.cfa, configured.bits, configured.packing)
    )
    data = pack((window.pixels >> shift(pixels, bits)).astype(np.uint16), pixels)
    chunked = bool(memory.get(Feature.CHUNK_MODE))
    if chunked:
        parts = [(CHUNK_IMAGE, data)]
        if memory.get(Feature.CHUNK_ENABLE):
            parts.append((CHUNK_EXPOSURE, memory.bytes_of(1e6 * time)))
        data = join_chunks(parts, memory.order)
    return SentImage(pixels.code, width, height, left, top, chunked, data)
