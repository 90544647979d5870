"""A mono camera with a filter wheel: the cameras of a simulated rig, each behind one filter after another.

What a filter lets through is a known share of the scene's red, green and blue, so that the truth is known.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivers.sim.camera.camera import Body, SimulatedCamera
from drivers.sim.rigs import SimulatedRig
from drivers.sim.truth import write_truth
from imaging.cfa import Cfa
from imaging.exposure import Exposure
from imaging.files.dng import write_dng
from imaging.files.exr import write_exr
from imaging.mosaic import RawMosaic
from imaging.session.bands import channels, in_order
from imaging.session.records import Band
from imaging.session.view_id import ViewId

_PEAKS = np.array((610.0, 545.0, 465.0))
_WIDTHS = np.array((45.0, 40.0, 30.0))
"""nm: where red, green and blue of the scene are taken to lie, and how wide."""


def weights(band: Band) -> npt.NDArray[np.float64]:
    """What a filter lets through of linear Rec.709, float64 [3]: three Gaussians at its wavelength.

    ValueError for a band of no wavelength.
    """
    if band.wavelength_nm is None:
        raise ValueError(f"the band {band.name} has no wavelength")
    return np.asarray(0.02 + np.exp(-0.5 * ((band.wavelength_nm - _PEAKS) / _WIDTHS) ** 2), np.float64)


def behind(body: Body, band: Band) -> Body:
    """The camera with a mono sensor behind the filter of a band."""
    optics = replace(body.optics, camera_from_rec709=weights(band)[None])
    return replace(body, cfa=Cfa.MONO, optics=optics)


def photograph(
    rig: SimulatedRig, photos: Path, wheel: Sequence[Band], brackets: Mapping[str, Sequence[Exposure]]
) -> None:
    """Photographs of every camera at every frame through every band: `photos`/BAND/CAMERA/FRAME_STEP.dng.

    brackets: the exposures of each band, by name.
    """
    for index, mount in enumerate(rig.mounts):
        for turn, band in enumerate(wheel):
            camera = SimulatedCamera(behind(rig.bodies[index], band), partial(rig.radiance, index))
            for frame in range(rig.frames):
                camera.place(frame, turn)
                for step, exposure in enumerate(brackets[band.name]):
                    camera.set_exposure(exposure)
                    camera.arm()
                    camera.trigger()
                    shot = camera.collect()
                    assert isinstance(shot, RawMosaic)
                    # A mono camera knows no colours, whatever the sensor is built from.
                    told = replace(shot, neutral=None, camera_from_xyz=None)
                    write_dng(photos / band.name / mount.name / f"{frame:04d}_{step}.dng", told)
            camera.close()


def write_truth_of_bands(rig: SimulatedRig, session: Path, wheel: Sequence[Band]) -> None:
    """As `drivers.sim.truth`, the true radiance being that of the bands."""
    write_truth(rig, session)
    bands = in_order(wheel)
    mixing = np.stack([weights(band) for band in bands])
    for index, mount in enumerate(rig.mounts):
        for frame in range(rig.frames):
            light = rig.radiance(index, frame) @ mixing.T
            planes = {name: light[..., band] for band, name in enumerate(channels(bands))}
            write_exr(session / "truth" / f"{ViewId(frame, mount.name)}.exr", planes, chromaticities=None)
