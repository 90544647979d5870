"""Pictures for a page: linear light developed for the screen, thumbnails, error maps, data URIs."""

import base64
import math

import cv2
import numpy as np

from imaging.arrays import Bytes, Floats
from imaging.colour.spaces import srgb_encode
from imaging.files.photo import encode_jpeg, encode_png

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
MAP_STOPS = 2.0
"""The error map's colours run from 0 to this many stops."""
MAP_COLOURS = ((15, 12, 40), (72, 28, 110), (158, 47, 105), (229, 92, 48), (250, 175, 40), (252, 255, 190))
UNKNOWN_GREY = 128


def developed(radiance: Floats, stops: float) -> Bytes:
    """Linear RGB [H, W, 3] times 2**stops, clipped at white, sRGB: uint8 [H, W, 3]."""
    light = np.nan_to_num(radiance, nan=0.0, posinf=1e30, neginf=0.0) * 2.0**stops
    return np.asarray(np.rint(255 * srgb_encode(np.clip(light, 0.0, 1.0))), np.uint8)


def three_exposures(radiance: Floats) -> tuple[float, float, float]:
    """Stops that show a scene's highlights, middle and shadows, dark picture first.

    Middle: the median at 18 % grey. The others put the brightest 0.5 % just below white and the
    darkest tenth at 18 % grey, at least two stops away from the middle. Whole half stops.
    """
    light = luminance(radiance)
    light = light[np.isfinite(light) & (light > 0)]
    if not len(light):
        return (-3.0, 0.0, 3.0)
    dark, middle, bright = np.percentile(light, [10, 50, 99.5])
    centre = _half(math.log2(0.18 / middle))
    return (
        min(_half(math.log2(0.9 / bright)), centre - 2),
        centre,
        max(_half(math.log2(0.18 / dark)), centre + 2),
    )


def _half(stops: float) -> float:
    return round(2 * stops) / 2


def luminance(radiance: Floats) -> Floats:
    """Rec.709 luminance of linear RGB [..., 3]."""
    return np.asarray(radiance @ LUMINANCE)


def error_map(prediction: Floats, truth: Floats) -> Bytes:
    """|log2(prediction / truth)| of luminance as colours, uint8 [H, W, 3]; grey: not known."""
    mine, true = luminance(prediction), luminance(truth)
    floor = 1e-6 * float(np.nanmax(true, initial=0.0))
    valid = np.isfinite(mine) & np.isfinite(true) & (true > floor)
    ratio = np.where(valid, np.maximum(mine, floor), 1.0) / np.where(valid, true, 1.0)
    level = np.clip(np.abs(np.log2(ratio)) / MAP_STOPS, 0.0, 1.0)
    anchors = np.array(MAP_COLOURS, np.float64)
    at = np.linspace(0.0, 1.0, len(anchors))
    colours = np.stack([np.interp(level, at, anchors[:, channel]) for channel in range(3)], axis=-1)
    return np.asarray(np.where(valid[..., None], np.rint(colours), UNKNOWN_GREY), np.uint8)


def colour_bar() -> str:
    """The error map's colours as a CSS gradient."""
    return "linear-gradient(90deg," + ",".join(f"rgb{colour}" for colour in MAP_COLOURS) + ")"


def fitted(pixels: Bytes, width: int) -> Bytes:
    """The picture at most `width` wide, averaged over areas."""
    if pixels.shape[1] <= width:
        return pixels
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    return np.asarray(cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


def jpeg_uri(pixels: Bytes, quality: int = 88) -> str:
    """A picture uint8 [H, W, 3] as a data URI, for photographs."""
    return _uri("jpeg", encode_jpeg(np.ascontiguousarray(pixels), quality=quality))


def png_uri(pixels: Bytes) -> str:
    """A picture uint8 [H, W, 3] as a data URI, for maps and small pictures."""
    return _uri("png", encode_png(np.ascontiguousarray(pixels)))


def _uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
