"""Colour filter arrays: the four Bayer phases, crops that shift them, mosaics and their bilinear pictures."""

from enum import StrEnum

import numpy as np
import numpy.typing as npt
from scipy import ndimage

Float = npt.NDArray[np.float32]
Bool = npt.NDArray[np.bool_]
_WEIGHTS = np.array([[0.25, 0.5, 0.25], [0.5, 1.0, 0.5], [0.25, 0.5, 0.25]])


class Cfa(StrEnum):
    """A Bayer phase, read along the first row and then the second."""

    RGGB = "RGGB"
    BGGR = "BGGR"
    GRBG = "GRBG"
    GBRG = "GBRG"

    @property
    def pattern(self) -> npt.NDArray[np.uint8]:
        """Channel of each site of the 2x2 tile, uint8 [2, 2]; 0 red, 1 green, 2 blue."""
        return np.array(["RGB".index(letter) for letter in self], dtype=np.uint8).reshape(2, 2)

    @classmethod
    def from_pattern(cls, pattern: npt.ArrayLike) -> "Cfa":
        """The phase whose `pattern` this is; ValueError if it is not a Bayer phase."""
        return cls("".join("RGB"[int(channel)] for channel in np.asarray(pattern).reshape(-1)))

    def cropped(self, top: int, left: int) -> "Cfa":
        """The phase seen after `top` rows and `left` columns are cut away."""
        return Cfa.from_pattern(np.roll(self.pattern, (-top, -left), axis=(0, 1)))

    def channels(self, height: int, width: int) -> npt.NDArray[np.uint8]:
        """Channel of every photosite, uint8 [height, width]."""
        return np.tile(self.pattern, (-(-height // 2), -(-width // 2)))[:height, :width]


def mosaic(rgb: npt.NDArray[np.floating], cfa: Cfa) -> npt.NDArray[np.floating]:
    """Keep of each pixel of `rgb` [H, W, 3] the one channel that `cfa` lets through: [H, W]."""
    channels = cfa.channels(*rgb.shape[:2])
    return np.take_along_axis(rgb, channels[..., None].astype(np.intp), axis=2)[..., 0]


def bilinear(image: npt.NDArray[np.floating], cfa: Cfa, valid: Bool | None = None) -> tuple[Float, Bool]:
    """Bilinear demosaic of a linear mosaic [H, W] -> rgb float32 [H, W, 3] and valid bool [H, W, 3].

    Each missing sample is the weighted mean of its *valid* neighbours of the same channel, so that
    a saturated or defect photosite does not spread. Where no neighbour is valid the value is 0 and
    `valid` is False. It blurs edges: `imaging.demosaic` is for what somebody looks at or trains on.
    """
    height, width = image.shape
    channels = cfa.channels(height, width)
    trusted = np.ones(image.shape, bool) if valid is None else valid
    rgb = np.zeros((height, width, 3), np.float32)
    known = np.zeros((height, width, 3), bool)
    for channel in range(3):
        own = trusted & (channels == channel)
        weight = ndimage.convolve(own.astype(np.float64), _WEIGHTS, mode="mirror")
        total = ndimage.convolve(np.where(own, image, 0.0).astype(np.float64), _WEIGHTS, mode="mirror")
        known[..., channel] = weight > 0
        value = np.where(own, image, total / np.maximum(weight, 1e-12))
        rgb[..., channel] = np.where(known[..., channel], value, 0.0)
    return rgb, known


def bilinear_variance(variance: npt.NDArray[np.float64], cfa: Cfa, valid: Bool) -> npt.NDArray[np.float64]:
    """Variance [H, W, 3] of what `bilinear` makes of photosites of such a variance [H, W].

    Infinite next to a photosite whose own is, NaN where nothing is known.
    """
    channels = cfa.channels(*variance.shape)
    planes = []
    for channel in range(3):
        own = valid & (channels == channel)
        weight = ndimage.convolve(own.astype(np.float64), _WEIGHTS, mode="mirror")
        bound = ndimage.binary_dilation(own & ~np.isfinite(variance), np.ones((3, 3), bool))
        spread = np.where(own & np.isfinite(variance), variance, 0.0).astype(np.float64)
        total = ndimage.convolve(spread, _WEIGHTS**2, mode="mirror") / np.maximum(weight, 1e-12) ** 2
        plane = np.where(own, variance, np.where(bound, np.inf, total))
        planes.append(np.where(weight > 0, plane, np.nan))
    return np.stack(planes, axis=-1)
