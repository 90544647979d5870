"""Scenes on disk become pages."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

from imaging.errors import InputError
from imaging.session.calibration import read_calibration
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

    That is a named system, the same surveyed points, or a session in whose coordinates both stand.
    """
    one, other = systems = [_system(scene) for scene in (first, second)]
    if one is not None and other is not None:
        if (one.system, one.offset, one.origin) != (other.system, other.offset, other.origin):
            return False
        points = [{(point.name, point.position) for point in system.points} for system in (one, other)]
        if one.system != "local" or points[0] & points[1]:
            return True
    here, there = (_sessions(scene, system) for scene, system in zip((first, second), systems, strict=True))
    return any(_is_same(a, b) for a in here for b in there)


def _system(scene: Scene) -> CoordinateSystem | None:
    if not (scene.folder / CALIBRATION).is_file():
        return None
    return read_own_calibration(scene.folder).coordinates


def _sessions(scene: Scene, system: CoordinateSystem | None) -> list[Path]:
    """Return the sessions in whose coordinates a scene stands.

    Its own comes first, as a name alone where its folder is unknown; then the one onto which that was placed,
    the one onto which this was placed, and on.
    """
    session = session_of(scene.folder)
    sessions = [Path(scene.record.session) if session is None else session]
    while system is not None and system.onto is not None and Path(system.onto) not in sessions:
        sessions.append(Path(system.onto))
        try:
            system = read_calibration(sessions[-1]).coordinates
        except (InputError, OSError):  # it was moved away, or is another user's
            break
    return sessions


def _is_same(one: Path, other: Path) -> bool:
    """Return whether two paths name one session: by their names alone where one was moved away."""
    there = all(path.is_absolute() and os.path.isdir(path) for path in (one, other))
    return one == other or (not there and one.name == other.name)


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
