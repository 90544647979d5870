"""Views of a session: one per camera and frame, with its bracket."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from imaging.choices import Subject
from imaging.errors import CalibrationError, InputError
from imaging.merge.linear_frame import LinearFrame, read_linear
from imaging.optics.exposure import Exposure
from imaging.sensor.sensor_calibration import SensorCalibration
from imaging.session.calibration import Response
from imaging.session.records import CameraRecord, ShotRecord
from imaging.session.session import Session, brackets
from imaging.session.view_id import ViewId


@dataclass(frozen=True)
class View:
    """One camera at one frame, and its exposures in order of their steps."""

    camera: CameraRecord
    frame: int
    shots: tuple[ShotRecord, ...]
    sensors: tuple[SensorCalibration, ...] = ()
    """Measurements of the camera's sensor, with which its shots are read."""

    @property
    def id(self) -> ViewId:
        """Identity of the view."""
        return ViewId(self.frame, self.camera.name)


def scene_views(session: Session) -> list[View]:
    """List every view of the scene, camera by camera; CalibrationError without any."""
    views = views_of(session, "scene")
    if not views:
        raise CalibrationError(
            f"{session.folder} has no shot of a scene: capture or import images into it first."
        )
    return views


def views_of(session: Session, kind: Subject) -> list[View]:
    """Every view of a kind, camera by camera; InputError if a camera's images differ in size."""
    groups = brackets(session.shots(kind))
    views = [View(session.camera(view.camera), view.frame, tuple(group)) for view, group in groups.items()]
    for camera in {view.camera.name for view in views}:
        sizes = {(s.width, s.height) for v in views if v.camera.name == camera for s in v.shots}
        if len(sizes) > 1:
            raise InputError(
                f"the images of camera {camera} in {session.folder} differ in size "
                f"({', '.join(f'{w}x{h}' for w, h in sorted(sizes))}): import each size as its own camera."
            )
    return sorted(views, key=lambda view: (view.camera.name, view.frame))


def steady_cameras(views: Sequence[View]) -> set[str]:
    """Cameras whose files state the same exposures of every view, two views or more.

    Cameras with auto exposure, or without exposure data, are excluded.
    """
    exposures: dict[str, set[tuple[Exposure | None, ...]]] = {}
    for view in views:
        exposures.setdefault(view.camera.name, set()).add(tuple(shot.exposure for shot in view.shots))
    return {name for name, stated in exposures.items() if len(stated) == 1 and None not in next(iter(stated))}


def of_one_band(views: Sequence[View]) -> list[View]:
    """The views again, those through several filters once for each band, with its shots: what compares
    exposures may compare only those of one band.
    """
    return [
        replace(view, shots=tuple(shot for shot in view.shots if shot.band == band))
        for view in views
        for band in dict.fromkeys(shot.band for shot in view.shots)
    ]


def read_view(
    session: Session, view: View, scales: Mapping[str, float], response: Response
) -> list[LinearFrame]:
    """The exposures of a view as linear light.

    Args:
        session: Session of the view.
        view: View, with the measurements of its sensor.
        scales: Exposure scale of each shot's file, s.
        response: Response of the camera, which only developed photographs (`ldr`) need.

    Returns:
        One frame for each shot, in the order of the view's shots.

    Raises:
        InputError: A file is missing or damaged.
    """
    return [
        read_linear(session.file(shot), view.camera.kind, scales[shot.file], response, view.sensors)
        for shot in view.shots
    ]
