"""The cameras of a scene's views in Alembic, for programs that take no OpenUSD.

They stand in the axes of the USD stage, on a film 36 mm wide, and look along -Z. Alembic has focal lengths in
mm, the film and its offset in cm, and times in seconds, 24 frames each.
"""

from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any

from imaging.files import store
from recon.exports.target_coordinates import Place, in_stage
from recon.result.model import SceneView
from recon.result.scene import Scene

FILM_CM = 3.6
FRAMES_PER_SECOND = 24
_FAR = 1e6
"""Far end of what is drawn over its near end, which is the rasteriser's."""


def has_alembic() -> bool:
    """Return whether the library is installed."""
    return find_spec("alembic3d") is not None


def write_cameras(path: Path, scene: Scene, place: Place) -> None:
    """Write a transform and a camera below it for each camera, animated by the numbers of the frames.

    Args:
        path: File, replaced whole.
        scene: Its views and their lenses, without distortion.
        place: Coordinates of the stage.

    Raises:
        StorageError: The disk refuses.
    """
    from alembic3d import Abc

    views = sorted(scene.views, key=lambda view: (view.camera, view.frame))
    with store.replacing(path) as part:
        archive = Abc.CreateArchiveWithInfo(str(part), FRAMES_PER_SECOND, "rig", place.note)
        for name, camera_views in groupby(views, key=lambda view: view.camera):
            _add(archive, name, list(camera_views), scene, place)
        del archive  # which writes the file


def _add(archive: Any, name: str, views: list[SceneView], scene: Scene, place: Place) -> None:
    import imath
    from alembic3d import AbcCoreAbstract, AbcGeom

    flag = AbcCoreAbstract.TimeSamplingType(AbcCoreAbstract.AcyclicFlag.kAcyclic)
    times = AbcCoreAbstract.TimeVector()
    for view in views:
        times.append(view.frame / FRAMES_PER_SECOND)
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(flag, times))
    transform = AbcGeom.OXform(archive.getTop(), name, sampling)
    camera = AbcGeom.OCamera(transform, f"{name}Shape", sampling)
    near = scene.renderer.limits.near * scene.record.world.unit
    for view in views:
        motion = in_stage(view, scene, place)
        moved = AbcGeom.XformSample()
        moved.setMatrix(imath.M44d(*motion.T.ravel().tolist()))  # of rows before matrices
        transform.getSchema().set(moved)
        camera.getSchema().set(_lens(view, near))


def _lens(view: SceneView, near: float) -> Any:
    from alembic3d import AbcGeom

    lens, sample = view.lens, AbcGeom.CameraSample()
    squeeze = lens.fx / lens.fy
    sample.setFocalLength(10 * FILM_CM * lens.fx / lens.width)
    sample.setHorizontalAperture(FILM_CM)
    sample.setVerticalAperture(FILM_CM * lens.height / lens.width * squeeze)
    sample.setHorizontalFilmOffset(FILM_CM * (lens.width / 2 - lens.cx) / lens.width)
    sample.setVerticalFilmOffset(FILM_CM * (lens.cy - lens.height / 2) / lens.width * squeeze)
    sample.setNearClippingPlane(near)
    sample.setFarClippingPlane(_FAR * near)
    return sample
