"""Scenes on disk become pages."""

from collections.abc import Callable, Sequence
from pathlib import Path

from imaging.errors import InputError
from imaging.session.calibration import CalibrationRecord
from recon.result.first_look import shot_at
from recon.result.model import read_own_calibration
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
    scenes = (first, second)
    calibrations = [read_own_calibration(scene.folder) for scene in scenes]
    if first.record.session != second.record.session:
        if not _share_coordinates(scenes, calibrations):
            say(
                f"{first.folder} and {second.folder} are of two sessions without common coordinates, so that "
                "places and sizes do not agree: calibrate one of them with --onto the other, and reconstruct "
                "it again"
            )
        return
    poses, others = ({view.id: view.cam_from_world for view in record.views} for record in calibrations)
    if any(poses[view] != others[view] for view in poses.keys() & others.keys()):
        raise InputError(
            f"{first.folder} and {second.folder} come from different calibrations, whose coordinates differ: "
            "reconstruct the older one again."
        )


def _share_coordinates(scenes: Sequence[Scene], calibrations: Sequence[CalibrationRecord]) -> bool:
    """Return whether scenes of two sessions stand in one coordinate system, by their calibrations.

    A session without a system has its own, in which the other one may have been placed onto it.
    """
    systems = [record.coordinates for record in calibrations]
    one, other = systems
    if one is not None and other is not None:
        return (one.system, one.offset, one.origin) == (other.system, other.offset, other.origin)
    return any(
        system is not None and system.onto is not None and Path(system.onto).name == target.record.session
        for system, target in zip(systems, reversed(scenes), strict=True)
    )


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
