"""Sharpness of a picture, whatever it shows: its finest detail against detail four times as coarse.

The ratio of the two hardly depends on how much texture a scene has, and falls at once when a lens loses
its focus or the camera shakes. (Of the measures compared in Pertuz, Puig and Garcia, "Analysis of focus
measure operators for shape-from-focus", Pattern Recognition 46, 2013, it is a ratio of two Laplacians.)
"""

from dataclasses import dataclass

import cv2
import numpy as np

from capture.pictures.reduced_pictures import ReducedPicture
from imaging.arrays import Array32, Mask

BLURS = (0.7, 1.4, 2.8)
"""Standard deviations, in samples of `ReducedPicture.green`, between which detail is fine, and coarse."""
REACH = 15
"""Samples around a clipped one that say nothing of detail."""
DARKEST = 0.01
"""Level below which a picture has too little light for detail."""
FEWEST = 0.05
"""Share of a picture that has to be well exposed."""
TEXTURE = 30.0
"""Least energy of coarse detail over that of noise: a wall cannot be out of focus."""


def _gains() -> tuple[float, float]:
    """Energy that the fine and the coarse band leave of white noise."""
    point = np.zeros((65, 65), np.float32)
    point[32, 32] = 1.0
    once, twice, thrice = (cv2.GaussianBlur(point, (0, 0), sigma) for sigma in BLURS)
    return float(((point - once) ** 2).sum()), float(((twice - thrice) ** 2).sum())


_FINE, _COARSE = _gains()


@dataclass(frozen=True, eq=False)
class Detail:
    """Energy of fine and of coarse detail at every sample, relative to the light, noise taken off.

    usable: where a picture is well exposed; noise: energy of noise in the coarse band.
    """

    fine: Array32
    coarse: Array32
    noise: Array32
    usable: Mask


def detail(picture: ReducedPicture) -> Detail:
    """The detail of a picture, float32 [H/2, W/2] each."""
    green = np.maximum(picture.green, -1.0)
    once, twice, thrice = (cv2.GaussianBlur(green, (0, 0), sigma) for sigma in BLURS)
    variance = picture.noise.variance(thrice)
    relative = 1.0 / np.maximum(thrice, 1e-3) ** 2
    far = cv2.dilate(picture.clipped.astype(np.uint8), np.ones((REACH, REACH), np.uint8)) == 0
    return Detail(
        ((green - once) ** 2 - _FINE * variance) * relative,
        ((twice - thrice) ** 2 - _COARSE * variance) * relative,
        _COARSE * variance * relative,
        np.asarray(far & (thrice > DARKEST)),
    )


def sharpness(picture: Detail, where: Mask | None = None) -> float | None:
    """Fine over coarse detail, amplitudes, where the picture (and `where`) allows, or None with too little
    texture.

    About 0.7 to 0.9 in focus, 0.2 under a blur of two photosites.
    """
    usable = picture.usable if where is None else picture.usable & where
    if usable.mean() < FEWEST:
        return None
    coarse, noise = float(picture.coarse[usable].sum()), float(picture.noise[usable].sum())
    if coarse < TEXTURE * noise:
        return None
    return float(np.sqrt(max(float(picture.fine[usable].sum()), 0.0) / coarse))


def against(picture: Detail, others: list[Detail]) -> float | None:
    """Sharpness over that of others of the same view where both are well exposed, the median."""
    ratios = []
    for other in others:
        if other.usable.shape != picture.usable.shape:
            continue
        mine, theirs = sharpness(picture, other.usable), sharpness(other, picture.usable)
        if mine is not None and theirs:
            ratios.append(mine / theirs)
    return float(np.median(ratios)) if ratios else None
