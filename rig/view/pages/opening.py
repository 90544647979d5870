"""Scenes on disk become pages."""

from collections.abc import Callable, Sequence
from pathlib import Path

from imaging.errors import InputError
from imaging.session.coordinates import CoordinateSystem
from imaging.session.paths import session_of
from recon.result.first_look import shot_at
from recon.result.model import CALIBRATION, read_own_calibration
from recon.result.scene import Scene, open_scene
from rig.view.pages.browser_cameras import start_of
from rig.view.pages.page import ScenePage
from rig.view.pictures.look import Look, first_look
from rig.view.pictures.painter import Painter
from rig.view.serving.server import Viewer
from rig.view.serving.start_view import Start


def show_scenes(viewer: Viewer, folders: Sequence[Path], say: Callable[[str], None]) -> None:
    """Open one scene, or two to compare, and have a viewer show them.

    say: called with what is to be known of their coordinates.
    """
    scenes = [open_scene(folder) for folder in folders]
    if len(scenes) > 1:
        first, second = scenes
        _compare_worlds(first, second, say)
    show_painter(viewer, painter_of(*scenes), None if viewer.first is None else viewer.first.start)


def _compare_worlds(first: Scene, second: Scene, say: Callable[[str], None]) -> None:
    """InputError for scenes of a session whose views were placed anew in between.

    Other changes of a calibration, as of its luminance or its held-out views, leave coordinates as they are.
    Scenes of two sessions that share no coordinates are shown, and `say` gets a sentence.
    """
    hashes = {first.record.calibration_sha256, second.record.calibration_sha256}
    if len(hashes) < 2 or "" in hashes:  # splats of other programs have none
        return
    if first.record.session != second.record.session:
        if not _share_coordinates(first, second):
            say(
                f"{first.folder} and {second.folder} are of two sessions without common coordinates, so that "
                "places and sizes do not agree: calibrate one of them with --onto the other, and reconstruct "
                "it again"
            )
        return
    calibrations = [read_own_calibration(scene.folder) for scene in (first, second)]
    poses, others = ({view.id: view.cam_from_world for view in record.views} for record in calibrations)
    if any(poses[view] != others[view] for view in poses.keys() & others.keys()):
        raise InputError(
            f"{first.folder} and {second.folder} come from different calibrations, whose coordinates differ: "
            "reconstruct the older one again."
        )


def _share_coordinates(first: Scene, second: Scene) -> bool:
    """Return whether scenes of two sessions stand in one coordinate system, as far as their calibrations say.

    That is a named system, the same surveyed points, or the session onto which one or both were placed.
    """
    one, other = systems = [_system(scene) for scene in (first, second)]
    if one is not None and other is not None:
        if (one.system, one.offset, one.origin) != (other.system, other.offset, other.origin):
            return False
        points = [{(point.name, point.position) for point in system.points} for system in (one, other)]
        if one.system != "local" or points[0] & points[1]:
            return True
    here, there = (_home(scene, system) for scene, system in zip((first, second), systems, strict=True))
    names_alone = not (here.is_absolute() and there.is_absolute())
    return here == there or (names_alone and here.name == there.name)


def _system(scene: Scene) -> CoordinateSystem | None:
    if not (scene.folder / CALIBRATION).is_file():
        return None
    return read_own_calibration(scene.folder).coordinates


def _home(scene: Scene, system: CoordinateSystem | None) -> Path:
    """Return the session whose own coordinates a scene has: its folder, or its name if that is not there."""
    if system is not None and system.onto is not None:
        return Path(system.onto)
    session = session_of(scene.folder)
    return Path(scene.record.session) if session is None else session.resolve()


def painter_of(*scenes: Scene) -> Painter:
    """Return what draws scenes, ready to draw at once."""
    painter = Painter(*scenes)
    painter.warm_up()
    return painter


def show_painter(viewer: Viewer, painter: Painter, start: Start | None, *, stay: bool = False) -> None:
    """Let a viewer show the drawings of a painter.

    start: present place of browsers; None: they are sent to the first view, unless they `stay`.
    """
    home = start_of(painter.scene, painter.scene.views[0]) if start is None else start
    sent = home if start is None and not stay else None
    viewer.show(
        lambda client, look, window: ScenePage(client, painter, home, look, window),
        look_of(painter.scene),
        sent,
    )


def look_of(scene: Scene) -> Look:
    """Choose a scene's first look; display values look as in their file or their photographs."""
    record = scene.record
    if record.display is not None:
        return first_look(record.exposure, record.display.k)
    shots = [[(shot.file, shot.k) for shot in view.shots] for view in record.views]
    return first_look(record.exposure, shot_at(shots))
