"""A filter before a simulated camera: a known share of red, green and blue, so that it has a truth."""

from dataclasses import replace

import numpy as np

from drivers.sim.camera.camera import Body
from imaging.arrays import Array
from imaging.sensor.cfa import Cfa
from imaging.session.records import Band

_PEAKS = np.array((610.0, 545.0, 465.0))
_WIDTHS = np.array((45.0, 40.0, 30.0))
"""nm: where red, green and blue of the scene are taken to lie, and how wide."""


def weights(band: Band) -> Array:
    """Return what a filter lets through of linear Rec.709, float64 [3]: three Gaussians at its wavelength.

    ValueError for a band of no wavelength.
    """
    if band.wavelength_nm is None:
        raise ValueError(f"the band {band.name} has no wavelength")
    return np.asarray(0.02 + np.exp(-0.5 * ((band.wavelength_nm - _PEAKS) / _WIDTHS) ** 2), np.float64)


def behind(body: Body, band: Band) -> Body:
    """The camera with a mono sensor behind the filter of a band."""
    optics = replace(body.optics, camera_from_rec709=weights(band)[None])
    return replace(body, cfa=Cfa.MONO, optics=optics, camera_from_xyz=None)
