"""Bands of light in a picture: what their channels are called, and how they are shown."""

from collections.abc import Sequence

import numpy as np

from imaging.arrays import Array
from imaging.colour.spaces import REC709_FROM_XYZ
from imaging.session.records import Band

LAYOUT = {"spectralLayoutVersion": "1.0", "emissiveUnits": "relative"}
"""Attributes of a spectral EXR (Fichet, Pacanowski and Wilkie, JCGT 10(3), 2021)."""
_VISIBLE = 450.0, 630.0
"""nm, from blue to red, over which bands that the eye does not see are spread for it."""


def channels(bands: Sequence[Band]) -> tuple[str, ...]:
    """Names of the EXR channels of these bands; R, G and B without bands.

    A band of a wavelength of its own is the emissive layer of a spectral EXR, `S0.650,000000nm`; any other
    goes by its name, but one called A, which is the channel of alpha, by `band:A`.
    """
    waves = [_layer(band) for band in bands]
    return tuple(
        wave if wave and waves.count(wave) == 1 else "band:A" if band.name == "A" else band.name
        for band, wave in zip(bands, waves, strict=True)
    ) or ("R", "G", "B")


def _layer(band: Band) -> str:
    """The layer of a spectral EXR that a band is; '' where its wavelength is unknown."""
    return "" if band.wavelength_nm is None else "S0." + f"{band.wavelength_nm:.6f}nm".replace(".", ",")


def in_order(bands: Sequence[Band]) -> tuple[Band, ...]:
    """Sort by wavelength, then by name; bands of unknown wavelength last."""
    return tuple(
        sorted(bands, key=lambda band: (band.wavelength_nm is None, band.wavelength_nm or 0.0, band.name))
    )


def matching(x: Array) -> Array:
    """CIE 1931 XYZ of wavelengths [N], nm: float64 [N, 3].

    The fit by piecewise Gaussians of Wyman, Sloan and Shirley (JCGT 2(2), 2013), right to about 1 %.
    """

    def lobe(middle: float, left: float, right: float) -> Array:
        return np.exp(-0.5 * ((x - middle) * np.where(x < middle, 1 / left, 1 / right)) ** 2)

    red = 1.056 * lobe(599.8, 37.9, 31.0) + 0.362 * lobe(442.0, 16.0, 26.7) - 0.065 * lobe(501.1, 20.4, 26.2)
    green = 0.821 * lobe(568.8, 46.9, 40.5) + 0.286 * lobe(530.9, 16.3, 31.1)
    blue = 1.217 * lobe(437.0, 11.8, 36.0) + 0.681 * lobe(459.0, 26.0, 13.8)
    return np.stack([red, green, blue], axis=-1)


def false_colour(bands: Sequence[Band]) -> Array:
    """Linear Rec.709 of the light of bands, float64 [3, bands]; equal light in all of them is white.

    Bands of known wavelengths are seen as the eye sees them (`matching`), if those make three colours. Where
    any is unknown or invisible, all are spread evenly over the visible, in their order. Negative shares of
    Rec.709 are kept, so that sums come out right.
    """
    waves = np.array([band.wavelength_nm or np.nan for band in bands])
    visible = np.isfinite(waves).all() and waves.min() >= 380 and waves.max() <= 720
    if not visible:
        waves = np.linspace(*_VISIBLE, len(bands))
    matrix = REC709_FROM_XYZ @ matching(waves).T
    white = matrix.sum(axis=1)
    if len(bands) < 3 or (white < 0.05 * white.max()).any():
        return np.full((3, len(bands)), 1 / len(bands))  # too few for colours: grey
    return np.asarray(matrix / white[:, None], np.float64)
