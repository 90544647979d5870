"""Forecast of a shoot: seconds and bytes of the shots of a plan, by test shots or by an earlier run.

A camera is set and armed, exposes, and stores or delivers its picture; one that keeps its pictures delivers
each while the next is exposed. All cameras of a step wait for one another. In-camera brackets are faster, and
shots that are taken again come on top.
"""

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TypeVar

from capture.record.shot_files import ShotId
from capture.record.source import Source
from drivers.camera import Camera, CameraFile, CameraIdentity, Capabilities, StoresShots
from drivers.clock import Clock
from imaging.choices import Compression
from imaging.errors import InputError
from imaging.files.tiff.dng import dng_pieces
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic
from imaging.session.records import PlanRecord
from imaging.session.session import Session

T = TypeVar("T")
ASSUMED = 1.0
"""Seconds beyond each exposure where nothing is known of the cameras: a still camera on USB, about."""


@dataclass(frozen=True)
class TrialShot:
    """Durations of a test shot, s, and the bytes of its file.

    ready: set and armed; stored: from the end of the exposure until it was stored, or delivered; fetched:
    from then until it was delivered.
    """

    ready: float
    stored: float
    fetched: float
    size: int


class TimedCamera:
    """A camera whose shots are timed."""

    def __init__(self, camera: Camera, clock: Clock, compression: Compression) -> None:
        self._camera, self._clock, self._compression = camera, clock, compression
        self._ready, self._over = 0.0, 0.0
        self._exposure = 0.0
        self.shots: list[TrialShot] = []

    @property
    def where(self) -> str:
        """Address of the camera."""
        return self._camera.where

    def verified(self) -> str:
        """Return what its driver has been tried against."""
        return self._camera.verified()

    def identify(self) -> CameraIdentity:
        """Query the identity."""
        return self._camera.identify()

    def capabilities(self) -> Capabilities:
        """Return what it can be set to."""
        return self._camera.capabilities()

    def set_exposure(self, exposure: Exposure) -> Exposure:
        """Set the exposure; what the camera reads back."""
        began = self._clock.now()
        applied = self._camera.set_exposure(exposure)
        self._ready, self._exposure = self._clock.now() - began, applied.time
        return applied

    def arm(self) -> None:
        """Make ready."""
        began = self._clock.now()
        self._camera.arm()
        self._ready += self._clock.now() - began

    def trigger(self) -> float:
        """Expose; the time of the order, s."""
        ordered = self._camera.trigger()
        self._over = ordered + self._exposure
        return ordered

    def collect(self) -> RawMosaic | CameraFile:
        """The frame, once it is stored and delivered."""
        camera = self._camera
        began = max(self._clock.now(), self._over)
        if isinstance(camera, StoresShots) and camera.keeps():
            shot = camera.keep()
            stored = self._clock.now()
            frame = camera.fetch(shot)
        else:
            frame = camera.collect()
            stored = self._clock.now()
        fetched = self._clock.now() - stored
        self.shots.append(TrialShot(self._ready, max(0.0, stored - began), fetched, self._size(frame)))
        return frame

    def close(self) -> None:
        """Let go of the camera."""
        self._camera.close()

    def _size(self, frame: RawMosaic | CameraFile) -> int:
        if isinstance(frame, RawMosaic):
            return sum(memoryview(piece).nbytes for piece in dng_pieces(frame, self._compression))
        return len(frame.data) + (0 if frame.developed is None else len(frame.developed[1]))


class Stopwatch:
    """Seconds in which a person moves things."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self.seconds = 0.0

    def timing(self, move: Callable[[T], None]) -> Callable[[T], None]:
        """Return what does the same and is timed."""

        def timed(to: T) -> None:
            began = self._clock.now()
            try:
                move(to)
            finally:
                self.seconds += self._clock.now() - began

        return timed


@dataclass(frozen=True)
class Forecast:
    """Forecast of the shots of a plan that are still to be taken.

    seconds: without the time in which a person moves things, and where pictures travel side by side;
    on_one_bus: where they all share one that each fills; frames: that lack shots. sizes: bytes of a shot
    by camera, None if unknown; size: of all. basis: origin of the seconds, in words. free: bytes on the disk.
    """

    seconds: float
    on_one_bus: float
    frames: int
    shots: int
    sizes: Mapping[str, int | None]
    size: int | None
    basis: str
    free: int

    @property
    def fits(self) -> bool:
        """False if the disk is known to lack the room."""
        return self.size is None or self.size <= self.free


def forecast_of(
    plan: PlanRecord, pending: Sequence[ShotId], source: Source, out: Path, session: Session | None
) -> Forecast:
    """Forecast shots of a plan.

    Args:
        plan: Plan.
        pending: Shots of it that are still to be taken.
        source: Cameras, which may be timed and have test shots.
        out: Folder of the session, which need not exist; its disk is asked for room.
        session: Session with earlier runs and files, if there is one.

    Returns:
        The seconds, bytes and number of the shots, with the origin of the seconds and the room on the disk.
    """
    cameras = source.cameras
    tests = {name: one.shots for name, one in cameras.items() if isinstance(one, TimedCamera) and one.shots}
    paces = {name: _typical(shots) for name, shots in tests.items()}
    times = [exposure.time if exposure is not None else 0.0 for exposure in plan.bracket]
    steps: dict[int, dict[int, list[str]]] = {}
    for shot in pending:
        steps.setdefault(shot.frame, {}).setdefault(shot.step, []).append(shot.camera)
    runs = []
    with suppress(InputError):  # a damaged line costs no shot
        runs = session.runs() if session is not None else []
    if paces:
        seconds = sum(_frame(one, times, paces, max) for one in steps.values())
        on_one_bus = sum(_frame(one, times, paces, sum) for one in steps.values())
        basis = "test shots"
    else:
        beyond = runs[-1].beyond if runs else ASSUMED
        seconds = on_one_bus = sum(times[step] + beyond for one in steps.values() for step in one)
        basis = "an earlier run" if runs else f"assumed: {ASSUMED:g} s beyond each exposure"
    shots = session.shots() if session is not None else []
    files = [(shot.camera, session.file(shot)) for shot in shots] if session is not None else []
    sizes: dict[str, int | None] = {}
    for name in plan.cameras:
        there = [file.stat().st_size for camera, file in files if camera == name and file.is_file()]
        if name in paces:
            sizes[name] = paces[name].size
        elif there:
            sizes[name] = round(sum(there) / len(there))
        else:
            sizes[name] = 2 * source.pixels.get(name, 0) or None
    each = [sizes[shot.camera] for shot in pending]
    return Forecast(
        seconds=seconds,
        on_one_bus=on_one_bus,
        frames=len(steps),
        shots=len(pending),
        sizes=sizes,
        size=None if None in each else sum(one for one in each if one is not None),
        basis=basis,
        free=shutil.disk_usage(_existing(out)).free,
    )


def _typical(shots: Iterable[TrialShot]) -> TrialShot:
    """Medians of the seconds, and the mean of the bytes."""
    ready, stored, fetched, sizes = zip(
        *((shot.ready, shot.stored, shot.fetched, shot.size) for shot in shots), strict=True
    )
    return TrialShot(median(ready), median(stored), median(fetched), round(sum(sizes) / len(sizes)))


def _frame(
    steps: Mapping[int, Sequence[str]],
    times: Sequence[float],
    paces: Mapping[str, TrialShot],
    together: Callable[[list[float]], float],
) -> float:
    """Seconds of a frame: a picture is fetched while the next is exposed, and the last by itself.

    together: seconds of several transfers at once. Test shots are delivered one after the other, so that the
    sum has the first lag only.
    """
    seconds = fetching = 0.0
    for step, names in steps.items():
        # A camera without a test shot is taken for the slowest of the others.
        taking_part = [paces[name] for name in names if name in paces] or [*paces.values()]
        # Storing in the camera takes no bus; a camera that does not store delivers instead.
        storing = max((one.stored for one in taking_part if one.fetched), default=0.0)
        delivering = together([one.stored for one in taking_part if not one.fetched] or [0.0])
        shooting = times[step] + max(storing, delivering)
        seconds += max(one.ready for one in taking_part) + max(shooting, fetching)
        fetching = together([one.fetched for one in taking_part])
    return seconds + fetching


def _existing(folder: Path) -> Path:
    return next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
