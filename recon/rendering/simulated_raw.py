"""Simulation of a camera's recording of a scene: a bracket of RAW mosaics, noise and all.

Light becomes the camera's colours, falls off as its lens lets it, passes its filters and is counted: photons
by Poisson's law and read noise, of the size that the noise of its own photographs has. What `rig` does not
know of a camera is not simulated: glare, fixed patterns, rows, and rounding that is coarser than 16 bits.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imaging.arrays import Array, Array32
from imaging.colour.spaces import REC709_FROM_XYZ, of_channels
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.sensor.cfa import Cfa
from imaging.sensor.mosaic import FrameMetadata, RawMosaic, as_matrix
from imaging.session.calibration import CameraCalibration
from imaging.session.falloff import falloff
from recon.result.model import ModelRecord, SceneShot, SceneView, read_model, read_own_calibration
from recon.result.scene import Scene

BLACK, WHITE = 4096, 65535
"""Levels of the files, DN: noise below black is kept."""
_BRIGHTEST = 1e30
"""Finite substitute of infinite light."""


@dataclass(frozen=True, eq=False)
class RawCamera:
    """A camera as the calibration knows it. matrix: linear Rec.709 to its channels, [channels, 3]."""

    calibration: CameraCalibration
    cfa: Cfa
    matrix: Array
    shots: tuple[SceneShot, ...]

    @classmethod
    def of(cls, scene: Scene, name: str) -> "RawCamera":
        """A camera of the scene by its name, with the bracket of its first view.

        InputError if the scene has no such camera, or does not know how it records RAW.
        """
        first = _recorded_view(scene.folder, scene.record, name)
        cfa = Cfa(first.cfa)
        calibration = read_own_calibration(scene.folder).camera(name)
        matrix = of_channels(calibration.camera_from_rec709, len(cfa.letters))
        return cls(calibration, cfa, matrix, first.shots)

    def bracket(self, light: Array32, seed: int) -> Iterator[RawMosaic]:
        """The mosaics of light [H, W, 3] by the exposures of the camera's bracket, darkest first.

        One seed and one picture give the same noise.
        """
        height, width = light.shape[:2]
        sites = np.tile(self.cfa.pattern, (-(-height // self.cfa.period[0]), -(-width // self.cfa.period[1])))
        sites = sites[:height, :width, None].astype(np.intp)
        finite = np.nan_to_num(light.astype(np.float64), posinf=_BRIGHTEST, neginf=0.0)
        at_sites = np.take_along_axis(finite @ self.matrix.T, sites, axis=2)[..., 0]
        arriving = np.maximum(at_sites * falloff(self.calibration, height, width), 0.0)
        noise = np.random.Generator(np.random.PCG64(seed))
        for shot in self.shots:
            yield self._recorded(arriving * shot.k, shot, noise)

    def _recorded(self, signal: Array, shot: SceneShot, noise: np.random.Generator) -> RawMosaic:
        assert shot.noise is not None
        slope, floor = shot.noise
        ceiling = 1.0 if shot.measures is None else min(1.0, shot.measures[1] * shot.k)
        # Far beyond the ceiling the count does not matter, and Poisson cannot count without end.
        counted = noise.poisson(np.minimum(signal, 4 * ceiling) / slope) * slope if slope > 0 else signal
        counted = counted + np.sqrt(floor) * noise.standard_normal(signal.shape)
        codes = np.rint(BLACK + (WHITE - BLACK) * np.minimum(counted, ceiling))
        white = round(BLACK + (WHITE - BLACK) * ceiling)
        matrix = self.matrix @ REC709_FROM_XYZ
        return RawMosaic(
            pixels=codes.clip(0, white).astype(np.uint16),
            cfa=self.cfa,
            black=((float(BLACK),) * 2,) * 2,
            white=white,
            neutral=_neutral(self.matrix),
            camera_from_xyz=None if self.calibration.camera_from_rec709 is None else as_matrix(matrix),
            noise_profile=(slope / ceiling, floor / ceiling**2),
            metadata=FrameMetadata(
                make="rig",
                model=f"simulated {self.calibration.name}",
                exposure=Exposure(
                    time=shot.k / ceiling
                ),  # f/1 and ISO 100: the scale of the signal, its white 1
            ),
        )


def require_raw(scene: Path, name: str) -> None:
    """Check, by its record alone, that a scene knows how a camera records RAW.

    Args:
        scene: Folder of a reconstruction, or a file of splats.
        name: Name of the camera.

    Raises:
        InputError: It has no such camera, or does not know that.
        ReconstructionError: The folder holds no finished reconstruction.
    """
    if scene.is_file():
        raise InputError(
            f"{scene} is a file of splats, which do not say how a camera records RAW: name a scene that was "
            "trained on mosaics."
        )
    _recorded_view(scene, read_model(scene), name)


def _recorded_view(folder: Path, record: ModelRecord, name: str) -> SceneView:
    """The first view of a camera; InputError if the scene lacks it, or does not say how it records RAW."""
    views = [view for view in record.views if view.camera == name]
    if not views:
        names = ", ".join(sorted({view.camera for view in record.views}))
        raise InputError(f"{folder} has no camera {name!r}: name one of {names}.")
    first = views[0]
    if record.bands or not first.cfa or any(shot.noise is None for shot in first.shots):
        raise InputError(
            f"{folder} does not say how camera {name} records RAW: train it on mosaics of full width, of "
            "red, green and blue, whose noise is known, by this version of rig."
        )
    return first


def _neutral(matrix: Array) -> tuple[float, ...]:
    """Return what each channel sees of white, largest 1."""
    white = matrix.sum(axis=1)
    return tuple((white / white.max()).tolist())
