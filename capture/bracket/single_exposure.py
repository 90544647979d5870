"""One bracket step of the whole rig: every camera is set, armed, triggered and emptied together."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from capture.bracket.acceptance import RETRIES, Acceptance
from capture.bracket.deviation import deviates
from drivers.camera import Camera, CameraFile
from imaging.errors import CameraError
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic

T = TypeVar("T")


@dataclass(frozen=True)
class CapturedFrame:
    """Frame from a camera.

    set_to: the setting that the camera read back. ordered: time of the order to expose, monotonic, seconds.
    began: time at which sending the order began; over: time by which the exposure had ended. None if unknown.
    """

    frame: RawMosaic | CameraFile
    set_to: Exposure
    ordered: float
    retries: int
    began: float | None = None
    over: float | None = None

    @property
    def reported(self) -> Exposure:
        """Exposure that the file states, else the one that the camera read back."""
        return self.frame.metadata.exposure or self.set_to

    @property
    def opened_by(self) -> float | None:
        """Latest time at which its shutter had opened, whatever its lag; None if unknown.

        Labels are rounded, by up to a tenth.
        """
        return None if self.over is None else self.over - 0.9 * self.reported.time


def made_ready(camera: Camera, requested: Exposure) -> Exposure:
    """Set a camera and arm it; what it read back."""
    set_to = camera.set_exposure(requested)
    if deviates(set_to, requested):  # a camera that was still busy drops the setting
        set_to = camera.set_exposure(requested)
    camera.arm()
    return set_to


def expose(
    cameras: Mapping[str, Camera], requested: Exposure
) -> tuple[dict[str, CapturedFrame], dict[str, CameraError]]:
    """Expose all `cameras` at `requested`: the frames by camera, and the errors of those without one.

    All cameras are set and armed before the first is triggered, all are triggered before the first
    is emptied. When one fails all are exposed again, RETRIES times, since one may be what triggers another;
    frames that are there already stay. `Acceptance` says which frames count.
    """
    accepted: dict[str, CapturedFrame] = {}
    acceptance: Acceptance[str, CapturedFrame] = Acceptance()
    errors: dict[str, CameraError] = {}
    waiting = set(cameras)
    for attempt in range(RETRIES + 1):
        frames, errors = _expose_once(cameras, requested, attempt)
        accepted |= {
            name: frame
            for name, frame in frames.items()
            if name in waiting and acceptance.accepts(name, frame, requested)
        }
        waiting -= set(accepted)
        if not waiting:
            break
    doubtful = {name: frame for name, frame in acceptance.doubtful.items() if name in waiting}
    lacking = waiting - set(doubtful)
    return accepted | doubtful, {name: error for name, error in errors.items() if name in lacking}


def _expose_once(
    cameras: Mapping[str, Camera], requested: Exposure, attempt: int
) -> tuple[dict[str, CapturedFrame], dict[str, CameraError]]:
    """The phases one after the other; a camera that fails in one is left out of the next."""
    errors: dict[str, CameraError] = {}

    ready = _each(cameras, cameras, lambda camera: made_ready(camera, requested), errors)
    ordered = _each(cameras, ready, lambda camera: camera.trigger(), errors)
    frames = _each(cameras, ordered, lambda camera: camera.collect(), errors)
    return {name: CapturedFrame(frames[name], ready[name], ordered[name], attempt) for name in frames}, errors


def _each(
    cameras: Mapping[str, Camera],
    names: Iterable[str],
    act: Callable[[Camera], T],
    errors: dict[str, CameraError],
) -> dict[str, T]:
    """`act` on every named camera."""
    results: dict[str, T] = {}
    for name in names:
        try:
            results[name] = act(cameras[name])
        except CameraError as error:
            errors[name] = error
    return results
