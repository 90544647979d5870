"""A merged bracket as a picture: in colour, with what lens and camera do to light divided out, and a mask."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from imaging.arrays import Array, Array32, Floats, Mask
from imaging.choices import Space
from imaging.colour.spaces import of_channels, rec709_from_camera, space_from_rec709
from imaging.demosaicking.demosaic import demosaic
from imaging.merge.ghosts import Deghosted
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import CameraCalibration
from imaging.session.falloff import falloff

CLIPPED, DARK, NOTHING, GHOST, HIDDEN = 1, 2, 4, 8, 16
BITS = (
    "1 clipped: a lower bound; 2 dark: an upper bound; 4 no number; 8 ghost: of one exposure alone; "
    "16 hidden: behind a mask in every exposure"
)


@dataclass(frozen=True, eq=False)
class Picture:
    """light and sigma: float32 [H, W, 3]; sigma None if not known; mask: int [H, W].

    sigma is infinite where the light of any channel is a bound or interpolated from one, so that it has no
    weight in a fit, and NaN where there is no number.

    known_colour: whether light is of the space that was asked for, and not camera RGB.
    """

    light: Array32
    sigma: Array32 | None
    mask: npt.NDArray[np.intp]
    known_colour: bool


def picture_of(
    best: Deghosted,
    cfa: Cfa | None,
    camera: CameraCalibration | None,
    space: Space = "rec709",
    white_balance: tuple[float, float, float] | None = None,
) -> Picture:
    """A merged bracket in colour, with what lens and camera do to light divided out.

    RAW of a camera whose colour is not known stays camera RGB, whatever the space.

    Args:
        best: Merged bracket, signal per second of exposure scale.
        cfa: Colour of its photosites; None: it has colour already.
        camera: Calibration of the camera, with its falloff and colour; None: without one.
        space: Colour space of the light.
        white_balance: Gains of red, green and blue that photographs were developed with, if they were.

    Returns:
        The light [H, W, 3], its standard deviation and its mask.
    """
    merged = best.merged
    height, width = merged.radiance.shape[:2]
    fall = np.ones((height, width), np.float32) if camera is None else falloff(camera, height, width)
    developed = (
        fall[..., None] if white_balance is None else fall[..., None] * np.array(white_balance, np.float32)
    )
    light = merged.radiance
    sigma = merged.sigma
    usable: Mask = np.asarray(np.isfinite(light))
    flags: list[Mask] = [merged.clipped, merged.dark, np.asarray(~usable), best.ghost]
    if cfa is not None:
        near = np.ones((2 * cfa.cell - 1,) * 2, bool)
        spread = [ndimage.binary_dilation(flag, near) for flag in flags[:2]]
        colour = demosaic(light, cfa, usable, sigma)
        flags = [*spread, np.asarray(~colour.known.all(-1)), best.ghost]
        light, sigma = np.where(flags[2][..., None], np.float32(np.nan), colour.rgb), colour.sigma
    variance = None if sigma is None else sigma.astype(np.float64) ** 2
    flags = [np.asarray(flag if flag.ndim == 2 else flag.any(-1)) for flag in flags]
    light = light / developed
    variance = None if variance is None else variance / developed**2
    matrix = None if camera is None else camera.camera_from_rec709
    known_colour = cfa is None or cfa.mono or matrix is not None
    if matrix is not None or light.shape[-1] != 3 or (known_colour and space != "rec709"):
        mixing = space_from_rec709(space) @ rec709_from_camera(of_channels(matrix, light.shape[-1]))
        light = (light @ mixing.T).astype(np.float32)
        variance = None if variance is None else _finite(variance) @ (mixing**2).T
    mask = sum(
        bit * flag.astype(np.intp) for bit, flag in zip((CLIPPED, DARK, NOTHING, GHOST), flags, strict=True)
    )
    deviation = None if variance is None else np.sqrt(variance).astype(np.float32)
    return Picture(light.astype(np.float32), deviation, np.asarray(mask), known_colour)


def _finite(variance: Floats) -> Array:
    """Infinity in one channel, of a bound, is infinity in all that are mixed from it."""
    return np.where(np.isfinite(variance).all(-1, keepdims=True), variance, np.inf)
