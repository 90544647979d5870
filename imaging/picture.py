"""A merged bracket as a picture: in colour, with what lens and camera do to light divided out, and a mask."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from imaging.calibration import CameraCalibration
from imaging.cfa import Cfa, demosaic
from imaging.colour import Space, space_from_rec709
from imaging.falloff import falloff
from imaging.ghosts import Deghosted
from imaging.linear import Bool, Float

CLIPPED, DARK, NOTHING, GHOST, HIDDEN = 1, 2, 4, 8, 16
BITS = (
    "1 clipped: a lower bound; 2 dark: an upper bound; 4 no number; 8 ghost: of one exposure alone; "
    "16 hidden: behind a mask in every exposure"
)


@dataclass(frozen=True, eq=False)
class Picture:
    """light and sigma: float32 [H, W, 3]; sigma None if not known; mask: int [H, W].

    known_colour: whether light is of the space that was asked for, and not camera RGB.
    """

    light: Float
    sigma: Float | None
    mask: npt.NDArray[np.intp]
    known_colour: bool


def picture_of(
    best: Deghosted, cfa: Cfa | None, camera: CameraCalibration | None, space: Space = "rec709"
) -> Picture:
    """A merged bracket in colour, with what lens and camera do to light divided out.

    RAW of a camera whose colour is not known stays camera RGB, whatever the space.
    """
    merged = best.merged
    height, width = merged.radiance.shape[:2]
    fall = np.ones((height, width), np.float32) if camera is None else falloff(camera, height, width)
    light = merged.radiance
    variance = None if merged.sigma is None else merged.sigma.astype(np.float64) ** 2
    usable: Bool = np.asarray(np.isfinite(light))
    flags: list[Bool] = [merged.clipped, merged.dark, np.asarray(~usable), best.ghost]
    if cfa is not None:
        spread = [ndimage.binary_dilation(flag, np.ones((3, 3), bool)) for flag in flags[:2]]
        flags = [*spread, np.asarray(~demosaic(light, cfa, usable)[1].all(-1)), best.ghost]
        variance = None if variance is None else _demosaicked_variance(variance, cfa, usable)
        light = np.where(flags[2][..., None], np.float32(np.nan), demosaic(light, cfa, usable)[0])
    flags = [np.asarray(flag if flag.ndim == 2 else flag.any(-1)) for flag in flags]
    light = light / fall[..., None]
    variance = None if variance is None else variance / fall[..., None] ** 2
    matrix = None if camera is None else camera.camera_from_rec709
    known_colour = cfa is None or matrix is not None
    if matrix is not None or (known_colour and space != "rec709"):
        mixing = space_from_rec709(space) @ np.linalg.inv(np.eye(3) if matrix is None else np.array(matrix))
        light = (light @ mixing.T).astype(np.float32)
        variance = None if variance is None else _finite(variance) @ (mixing**2).T
    mask = sum(
        bit * flag.astype(np.intp) for bit, flag in zip((CLIPPED, DARK, NOTHING, GHOST), flags, strict=True)
    )
    sigma = None if variance is None else np.sqrt(variance).astype(np.float32)
    return Picture(light.astype(np.float32), sigma, np.asarray(mask), known_colour)


def _finite(variance: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Infinity in one channel, of a bound, is infinity in all that are mixed from it."""
    return np.where(np.isfinite(variance).all(-1, keepdims=True), variance, np.inf)


def _demosaicked_variance(
    variance: npt.NDArray[np.float64], cfa: Cfa, usable: Bool
) -> npt.NDArray[np.float64]:
    """Variance [H, W, 3] of what `demosaic` makes of photosites of such a variance [H, W]."""
    channels = cfa.channels(*variance.shape)
    kernel = np.array([[0.25, 0.5, 0.25], [0.5, 1.0, 0.5], [0.25, 0.5, 0.25]])
    planes = []
    for channel in range(3):
        own = usable & (channels == channel)
        weight = ndimage.convolve(own.astype(np.float64), kernel, mode="mirror")
        bound = ndimage.binary_dilation(own & ~np.isfinite(variance), np.ones((3, 3), bool))
        spread = np.where(own & np.isfinite(variance), variance, 0.0).astype(np.float64)
        total = ndimage.convolve(spread, kernel**2, mode="mirror") / np.maximum(weight, 1e-12) ** 2
        plane = np.where(own, variance, np.where(bound, np.inf, total))
        planes.append(np.where(weight > 0, plane, np.nan))
    return np.stack(planes, axis=-1)
