"""The cameras of a scene's views in Alembic, for programs that take no OpenUSD.

They stand in the axes of the USD stage, and look along -Z. Alembic has focal lengths in
mm, the film and its offset in cm, and times in seconds, 24 frames each.
"""

from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any

from imaging.files import store
from recon.exports.target_coordinates import Place, film_of, in_stage
from recon.result.model import SceneView
from recon.result.scene import Scene

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

    film, sample = film_of(view.lens), AbcGeom.CameraSample()
    sample.setFocalLength(film.focal)
    sample.setHorizontalAperture(film.width / 10)
    sample.setVerticalAperture(film.height / 10)
    sample.setHorizontalFilmOffset(film.across / 10)
    sample.setVerticalFilmOffset(film.up / 10)
    sample.setNearClippingPlane(near)
    sample.setFarClippingPlane(_FAR * near)
    return sample
