"""A body in its pixel shift mode: four files for every exposure, between which its sensor moves a photosite.

Such groups are made by the body and lie on its card as files; no protocol asks for them. So the simulated
body writes a folder, as the user of a real one has it for `rig import --pixel-shift`.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.rigs import SimulatedRig
from imaging.arrays import Array32
from imaging.files.tiff.dng import write_dng
from imaging.optics.exposure import Exposure
from tests.drivers.shots import raw_shot

Step = tuple[float, float]
AROUND: tuple[Step, ...] = ((0, 0), (0, 1), (1, 1), (1, 0))
"""Rows and columns, in photosites, by which the sensor stands beside its place."""


def displaced(rig: SimulatedRig, camera: int, by: Step, frame: int) -> Array32:
    """True radiance of each photosite [H, W, 3] where the sensor of a camera moved; nothing else moves."""
    lens = rig.mounts[camera].optics.lens
    there = lens.model_copy(update={"cx": lens.cx - by[1], "cy": lens.cy - by[0]})
    return rig.scene_at(frame).render(there, rig.cam_from_world(camera, frame), rig.settings.samples)


def photograph(rig: SimulatedRig, photos: Path, exposures: Sequence[Exposure]) -> None:
    """Photographs of every camera at every frame: `photos`/CAMERA/FRAME_EXPOSURE_STEP.dng."""
    for index, mount in enumerate(rig.mounts):
        for number, by in enumerate(AROUND):
            camera = SimulatedCamera(rig.bodies[index], partial(displaced, rig, index, by))
            for frame in range(rig.frames):
                for turn, exposure in enumerate(exposures):
                    camera.place(frame, len(AROUND) * turn + number)
                    file = photos / mount.name / f"{frame:04d}_{turn}_{number}.dng"
                    write_dng(file, raw_shot(camera, exposure))
