"""A small picture of a shot as its file recorded it, for a contact sheet: what is clipped is painted over."""

import cv2
import numpy as np

from imaging.arrays import Array32, Mask
from imaging.cfa import cell_means
from imaging.colour import balanced, srgb_encode
from imaging.files.photo import encode_jpeg
from imaging.merge.linear_frame import LinearFrame
from imaging.mosaic import RawMosaic

WIDTH = 160
CLIPPED_COLOUR = (255, 0, 150)
TOP = 254 / 255
QUALITY = 72


def of_raw(frame: LinearFrame, mosaic: RawMosaic) -> bytes:
    """JPEG of a mosaic and its light: white at white, its white balance, nothing lifted."""
    signal, saturated = frame.signal, frame.saturated
    rgb = balanced(cell_means(signal, mosaic.cfa), mosaic.neutral)
    return _small(rgb, cell_means(saturated, mosaic.cfa).max(-1) > 0)


def of_photo(pixels: Array32) -> bytes:
    """JPEG of a developed photograph [H, W, 3], 0..1, as the camera made it."""
    return _small(pixels, _brightest(pixels) >= TOP, developed=True)


def of_light(light: Array32) -> bytes:
    """JPEG of linear light [H, W, 3], its brightest hundredth at white: nothing is clipped in it."""
    rgb = np.nan_to_num(light, nan=0.0, posinf=0.0, neginf=0.0)
    rgb = rgb / max(float(np.percentile(rgb, 99.0)), 1e-30)
    return _small(np.asarray(rgb, np.float32), np.zeros(rgb.shape[:2], bool))


def _brightest(pixels: Array32) -> Array32:
    """The largest channel, [H, W]."""
    return np.maximum(np.maximum(pixels[..., 0], pixels[..., 1]), pixels[..., 2])


def _small(rgb: Array32, clipped: Mask, developed: bool = False) -> bytes:
    width = min(WIDTH, rgb.shape[1])
    size = (width, max(1, round(rgb.shape[0] * width / rgb.shape[1])))
    mean = np.clip(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), 0.0, 1.0)
    share = cv2.resize(clipped.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    codes = np.rint(255 * (mean if developed else srgb_encode(mean))).astype(np.uint8)
    codes[share >= 0.5] = CLIPPED_COLOUR
    return encode_jpeg(codes, QUALITY)
