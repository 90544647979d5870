"""Conformance checks of a camera driver against a connected camera: `rig doctor --camera`.

Each examination drives the camera by nothing but the protocol `drivers.camera.Camera` and says what it found.
Light and linearity are judged by photon transfer (EMVA 1288: the variance between two frames of one exposure
rises in proportion to the signal, the signal in proportion to the time), for which the camera should look at
something that neither moves nor flickers, part of it bright.
"""

import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.camera import Camera, CameraFile, Capabilities, ShootsBrackets
from drivers.clock import Clock
from drivers.errors import CameraRefused
from imaging.arrays import Array
from imaging.errors import CameraError, RigError
from imaging.files import raw
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported
from imaging.sensor.mosaic import RawMosaic

Verdict = Literal["passed", "failed", "skipped"]
LONGEST = 1.0
"""Seconds of exposure that an examination takes at most, so that all of them end in a minute or two."""
SHOTS = 5
"""Number of shots over which the timing is reported."""
LEVELS = 5
"""Exposures a stop apart by which light is judged."""
BRIGHT = 0.9
"""The share of photosites that are darker than the one which levels are chosen by."""
FULL, FAINT = 0.6, 0.01
"""Shares of the range: the upper limit of the brightest frame, and the level below which none is judged."""
UNEVEN_STOPS = 0.1
"""Largest difference between a stop of time and a stop of signal."""
NOISE_OFF = 0.25
"""Largest departure of a level's variance from the line through all."""


@dataclass(frozen=True)
class Examination:
    """Outcome of a check: its subject, its verdict, and in words what was observed or what is wrong."""

    name: str
    verdict: Verdict
    says: str


class Failure(Exception):
    """Violation of the protocol by the camera; the message names it and the expected behaviour."""


class Skipped(Exception):
    """Check that is not possible here; the message gives the reason and the fix."""


@dataclass(frozen=True)
class Subject:
    """A camera under examination, its clock, and what it says that it can."""

    camera: Camera
    clock: Clock
    able: Capabilities

    def exposure(self, time: float) -> Exposure:
        """The exposure of that time, at the widest aperture and the lowest ISO available."""
        return Exposure(
            time=time,
            f_number=self.able.f_numbers[0] if self.able.f_numbers else None,
            iso=self.able.isos[0] if self.able.isos else None,
        )

    def times(self) -> list[float]:
        """Times short enough to wait for, seconds; Skipped without any."""
        times = [time for time in self.able.times if time <= LONGEST]
        if not times:
            raise Skipped(f"the camera has no exposure time up to {LONGEST:g} s")
        return times

    def shoot(self) -> tuple[float, RawMosaic | CameraFile]:
        """Return when the shutter opened, and the frame."""
        self.camera.arm()
        opened = self.camera.trigger()
        return opened, self.camera.collect()

    def pixels(self) -> Array:
        """A frame's signal in shares of its range, NaN where it is full; Skipped where it is no RAW frame."""
        _, frame = self.shoot()
        if isinstance(frame, CameraFile):
            if frame.suffix not in raw.SUFFIXES:
                raise Skipped("its frames are developed, and their light is known after rig calibrate only")
            frame = raw.decode_raw(frame.data, frame.suffix)
        black = float(np.mean(frame.black))
        signal = (frame.pixels - black) / (frame.white - black)
        return np.where(frame.pixels >= frame.white, np.nan, signal)


def identity(subject: Subject) -> str:
    """The identity is stated, each time alike."""
    first, again = subject.camera.identify(), subject.camera.identify()
    if not first.serial:
        raise Failure("it has no serial number, by which rig files name cameras: assign a permanent one")
    if first != again:
        raise Failure(f"it reports itself as {first}, then as {again}")
    return f"{first.make} {first.model}, serial number {first.serial}, {first.kind}"


def capabilities(subject: Subject) -> str:
    """Capabilities are valid: ascending, positive, repeatable."""
    able = subject.able
    if able.obstacle:
        raise Failure(f"it cannot shoot for rig: {able.obstacle}")
    for what, values in (("times", able.times), ("f_numbers", able.f_numbers), ("isos", able.isos)):
        if list(values) != sorted(set(values)) or any(value <= 0 for value in values):
            raise Failure(f"{what} have to be positive and ascending, and are {values}")
    if not able.times:
        raise Failure("it has no exposure times: a bracket cannot be planned")
    if subject.camera.capabilities() != able:
        raise Failure("asked again, it can do something else")
    size = f"{able.width}x{able.height}" if able.width else "size known from its first picture"
    return f"{size}, {len(able.times)} times, {len(able.isos)} ISO speeds"


def settings(subject: Subject) -> str:
    """The nearest exposure that it has is set and read back, the last one asked for holding."""
    worst = 0.0
    times = subject.times()
    asked = [times[0], times[len(times) // 2], times[-1], times[0]]
    for time in asked:
        wanted = subject.exposure(time)
        applied = subject.camera.set_exposure(wanted)
        off = abs(np.log2(applied.time / wanted.time))
        worst = max(worst, off)
        if off > 0.25:
            raise Failure(f"asked for {wanted}, which it says it has, it reads back {applied}")
    return f"{len(set(asked))} exposures read back within {worst:.3f} stops"


def frames(subject: Subject) -> str:
    """A frame has the size, the kind and the exposure that were said."""
    times = subject.times()
    applied = subject.camera.set_exposure(subject.exposure(times[len(times) // 2]))
    _, frame = subject.shoot()
    if isinstance(frame, CameraFile):
        size, stated = (frame.width, frame.height), frame.metadata.exposure
    else:
        size, stated = frame.pixels.shape[1::-1], frame.metadata.exposure
    able = subject.able
    if able.width and size != (able.width, able.height):
        raise Failure(f"it reports {able.width}x{able.height}, but its frame has {size[0]}x{size[1]}")
    kind = subject.camera.identify().kind
    if (kind == "raw") != (isinstance(frame, RawMosaic) or frame.suffix in raw.SUFFIXES):
        raise Failure(f"it reports {kind!r} frames, but delivers another kind")
    if stated is not None and abs(np.log2(stated.time / applied.time)) > 0.25:
        raise Failure(f"it was set to {applied}, but its frame states {stated}")
    says = "which its frame says too" if stated is not None else "of which its frame says nothing"
    return f"{size[0]}x{size[1]}, {applied}, {says}"


def order(subject: Subject) -> str:
    """Calls out of order are refused by a CameraError or carried out, and the camera shoots afterwards."""
    times = subject.times()
    subject.camera.set_exposure(subject.exposure(times[0]))
    refused = 0
    for steps in (("collect",), ("trigger",), ("arm", "arm"), ("arm", "collect")):
        try:
            for step in steps:
                getattr(subject.camera, step)()
        except CameraError:
            refused += 1
        subject.camera.set_exposure(subject.exposure(times[0]))
        subject.shoot()
    return f"{refused} of 4 were refused, and a frame was taken after each"


def closing(subject: Subject) -> str:
    """`close` is idempotent and the camera can be reopened."""
    who = subject.camera.identify()
    subject.camera.close()
    subject.camera.close()
    if subject.camera.identify() != who:
        raise Failure("after closing, another camera answers")
    subject.camera.set_exposure(subject.exposure(subject.times()[0]))
    subject.shoot()
    return "closed twice, found again, and took a frame"


def timing(subject: Subject) -> str:
    """The shutter opens between the call and the frame; how long a shot takes."""
    subject.camera.set_exposure(subject.exposure(subject.times()[0]))
    delays, whole = [], []
    for _ in range(SHOTS):
        subject.camera.arm()
        before = subject.clock.now()
        opened = subject.camera.trigger()
        subject.camera.collect()
        after = subject.clock.now()
        if not before - 0.01 <= opened <= after:
            raise Failure(
                f"trigger() says that the shutter opened at {opened:.3f} s, outside the call at "
                f"{before:.3f} s and the frame at {after:.3f} s of the clock that the driver was given"
            )
        delays.append(1e3 * (opened - before))
        whole.append(after - before)
    return (
        f"the shutter opens {statistics.median(delays):.1f} ms after the call ({min(delays):.1f} to "
        f"{max(delays):.1f}), the frame is there after {statistics.median(whole):.2f} s"
    )


def bracket(subject: Subject) -> str:
    """Exposures a stop apart that the camera shoots by itself, if it does, are each as asked for."""
    camera, times = subject.camera, subject.times()
    if not isinstance(camera, ShootsBrackets):
        return "none of its own: each exposure is set and triggered"
    longest = times[len(times) // 2]
    wanted = [min(times, key=lambda one, to=to: abs(np.log2(one / to))) for to in _stops(longest)]  # type: ignore[misc]
    exposures = [subject.exposure(time) for time in wanted]
    began = subject.clock.now()
    try:
        stated = [frame.metadata.exposure for frame in camera.bracket(exposures)]
    except CameraRefused as error:  # rig needs none
        why = str(error).rpartition(": ")[0]
        return f"none of its own ({why}): each exposure is set and triggered"
    seconds = subject.clock.now() - began
    for exposure in exposures:
        if not any(one is not None and abs(np.log2(one.time / exposure.time)) < 0.25 for one in stated):
            said = ", ".join(str(one) for one in stated) or "nothing"
            raise Failure(f"asked for {exposure}, the frames of its bracket say {said}")
    began = subject.clock.now()
    for exposure in exposures:
        camera.set_exposure(exposure)
        subject.shoot()
    alone = subject.clock.now() - began
    return f"{len(exposures)} frames as asked in {seconds:.2f} s, in {alone:.2f} s one by one"


def _stops(longest: float) -> list[float]:
    return [longest / 2**step for step in range(3)]


def light(subject: Subject) -> str:
    """Signals double with the time, and the variance between two frames rises in proportion to them."""
    levels = _levels(subject)
    pairs = []
    for time in levels:
        applied = subject.camera.set_exposure(subject.exposure(time))
        pairs.append((applied.time, subject.pixels(), subject.pixels()))
    usable = np.logical_and.reduce([np.isfinite(one) & np.isfinite(other) for _, one, other in pairs])
    if usable.mean() < 0.05:
        raise Skipped("nearly all of the picture is clipped: point the camera at something darker")
    signals = np.array([(one[usable].mean() + other[usable].mean()) / 2 for _, one, other in pairs])
    stops = np.diff(np.log2([time for time, _, _ in pairs]))
    uneven = float(np.abs(np.diff(np.log2(signals)) - stops).max())
    if uneven > UNEVEN_STOPS:
        raise Failure(
            f"a stop of exposure time changes the signal by up to {uneven:.2f} stops more or less than one: "
            "the times that are read back or the black level are wrong, or the light flickers"
        )
    noise = np.array([np.var(one[usable] - other[usable]) / 2 for _, one, other in pairs])
    slope, floor = np.polyfit(signals, noise, 1, w=1 / noise)
    off = float(np.abs((slope * signals + floor) / noise - 1).max())
    if slope <= 0 or off > NOISE_OFF:
        raise Failure(
            f"noise does not rise with the signal as photons do ({100 * off:.0f} % from a line): something "
            "moves before the camera, or its frames are not the sensor's own codes"
        )
    return (
        f"{len(pairs)} levels: stops even within {uneven:.3f}, variance on a line within {100 * off:.0f} %, "
        f"{1 / slope:,.0f} electrons or so at full scale"
    )


def _levels(subject: Subject) -> list[float]:
    """Times whose signals are neither full nor faint, ascending; Skipped where there are not three."""
    times = subject.times()
    time = times[len(times) // 2]
    for _ in range(len(times)):
        subject.camera.set_exposure(subject.exposure(time))
        brightest = _bright(subject.pixels())
        shorter = [one for one in times if one <= time / 2]
        longer = [one for one in times if 2 * time <= one]
        if brightest > FULL and shorter:
            time = shorter[-1]
        elif brightest < FULL / 3 and longer:
            time = longer[0]
        else:
            break
    wanted = [time / 2**step for step in range(LEVELS) if brightest / 2**step > FAINT]
    nearest = sorted({min(times, key=lambda one, to=to: abs(np.log2(one / to))) for to in wanted})  # type: ignore[misc]
    if len(nearest) < 3:
        raise Skipped("the picture is too dark at all of its times: point the camera at something bright")
    return nearest


def _bright(signal: Array) -> float:
    """A bright photosite's, 1 where it is full."""
    return float(np.quantile(np.nan_to_num(signal, nan=1.0), BRIGHT))


EXAMINATIONS: tuple[Callable[[Subject], str], ...] = (
    identity, capabilities, settings, frames, order, closing, timing, bracket, light,
)  # fmt: skip


def examine(
    camera: Camera,
    clock: Clock,
    *,
    examinations: Sequence[Callable[[Subject], str]] = EXAMINATIONS,
    on_progress: Progress = unreported,
) -> Iterator[Examination]:
    """Ask a camera everything, one examination after the other, and let it go in the end.

    clock: the one that its driver was given. A CameraError is a failure that says what the camera refused;
    any other exception of its driver is one too, by its name.
    """
    try:
        subject = Subject(camera, clock, camera.capabilities())
        for done, ask in enumerate(examinations):
            on_progress(ask.__name__, done, len(examinations))
            yield _asked(ask, subject)
    finally:
        camera.close()


def _asked(ask: Callable[[Subject], str], subject: Subject) -> Examination:
    try:
        return Examination(ask.__name__, "passed", ask(subject))
    except Skipped as reason:
        return Examination(ask.__name__, "skipped", str(reason))
    except (Failure, RigError) as reason:
        return Examination(ask.__name__, "failed", str(reason))
    except Exception as error:  # a driver that is being written may raise anything
        what = f"{type(error).__name__} ({error}) where a CameraError was due"
        return Examination(ask.__name__, "failed", what)
