"""Lens, filters and veiling glare: radiance before it reaches the photosites."""

from dataclasses import dataclass, replace

import numpy as np

from imaging.arrays import Array, Floats
from imaging.optics.lens import Lens

NARROW, WIDE = 0.02, 0.3
"""Scales of the two parts, of the image's diagonal: bloom round a lamp, and a veil over everything."""


def scattered(light: Floats, share: float) -> Array:
    """Light [H, W, C] of which `share` falls elsewhere, float64; half of that near by, half far away.

    Each part falls off as `exp(-r / scale)`. What is beyond the picture is as the picture mirrored.
    """
    from scipy.fft import irfft2, rfft2  # which takes a while to load, and few cameras have glare

    height, width = light.shape[:2]
    mirrored = np.pad(light, ((0, height), (0, width), (0, 0)), "symmetric").astype(np.float64)
    size = mirrored.shape[:2]
    y, x = (np.minimum(np.arange(side), side - np.arange(side)) for side in size)
    r = np.hypot(y[:, None], x[None]) / np.hypot(height, width)
    kernel = sum(np.exp(-r / scale) / np.exp(-r / scale).sum() for scale in (NARROW, WIDE)) / 2
    spectrum = rfft2(mirrored, axes=(0, 1)) * rfft2(kernel)[..., None]
    spread = irfft2(spectrum, s=size, axes=(0, 1))[:height, :width]
    return np.asarray((1 - share) * light + share * spread)


@dataclass(frozen=True)
class Optics:
    """Lens, vignetting, colour and sensitivity of one camera.

    vignetting: (a, b, c) of `V(r) = 1 + a r^2 + b r^4 + c r^6`, r = 1 at the corner from the centre;
    camera_from_rec709: float64 [channels, 3], green row summing to 1; gain: relative sensitivity;
    sensor_width_mm: for the focal length that the files name; glare: share of the light that is scattered.
    """

    lens: Lens
    vignetting: tuple[float, float, float]
    camera_from_rec709: Array
    gain: float = 1.0
    sensor_width_mm: float = 6.287
    glare: float = 0.0

    @property
    def neutral(self) -> Array:
        """Response of each channel to white light, the largest 1."""
        white = self.camera_from_rec709.sum(axis=1)
        return np.asarray(white / white.max())

    def nearer(self, distortion: float, vignetting: float, gains: float) -> "Optics":
        """Scale the distortion, the falloff and the departure of the gain from 1; a factor of 1 keeps it.

        A fisheye keeps its distortion, which is what makes it one.
        """
        lens = self.lens
        if not lens.fisheye:
            terms = {name: distortion * getattr(lens, name) for name in ("k1", "k2", "p1", "p2")}
            lens = lens.model_copy(update=terms)
        a, b, c = self.vignetting
        return replace(
            self,
            lens=lens,
            vignetting=(vignetting * a, vignetting * b, vignetting * c),
            gain=1.0 + gains * (self.gain - 1.0),
        )

    def falloff(self) -> Array:
        """The vignetting factor of every pixel, at its centre, float64 [H, W]."""
        lens = self.lens
        x = (np.arange(lens.width) + 0.5) - lens.width / 2
        y = (np.arange(lens.height) + 0.5) - lens.height / 2
        r2 = (x[None, :] ** 2 + y[:, None] ** 2) / ((lens.width / 2) ** 2 + (lens.height / 2) ** 2)
        a, b, c = self.vignetting
        return np.asarray(1.0 + r2 * (a + r2 * (b + r2 * c)))

    def exposure(self, radiance: Floats) -> Array:
        """Signal per unit of exposure scale, float64 [H, W, channels], of radiance [H, W, 3]."""
        light = np.asarray(radiance, np.float64)
        colour = (scattered(light, self.glare) if self.glare else light) @ self.camera_from_rec709.T
        return np.asarray(colour * (self.gain * self.falloff())[..., None])
