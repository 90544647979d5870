"""A mono camera with a filter wheel: photographs of a simulated rig, each band at exposures of its own."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.camera.filters import behind
from drivers.sim.rigs import SimulatedRig
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import Band


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
                    write_dng(photos / band.name / mount.name / f"{frame:04d}_{step}.dng", shot)
            camera.close()
