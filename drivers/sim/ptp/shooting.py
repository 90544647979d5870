"""Shooting of a simulated PTP camera: dials, a timed exposure, a file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any

import numpy as np

from drivers.camera import CameraFile
from drivers.ptp.protocol.codec import Value
from drivers.ptp.protocol.codes import FormatCode, ResponseCode
from drivers.sim.camera import shutter
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.faults import Fault, Kind
from drivers.sim.ptp.dials import SimulatedDial
from drivers.sim.ptp.profiles import CameraProfile
from drivers.sim.ptp.store import Photograph, Store
from drivers.sim.usb.timeline import Timeline
from imaging.colour.spaces import srgb_encode
from imaging.files.photo import encode_jpeg
from imaging.files.tiff.dng import encode_dng
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic


class News(Enum):
    """Events of a camera after a shot."""

    OBJECT_ADDED = "object added"
    CAPTURE_COMPLETE = "capture complete"


@dataclass(frozen=True)
class Announcement:
    """News of a shot: the handle of its object, and the transaction that asked for it."""

    news: News
    handle: int
    transaction: int


class Shooting:
    """The camera behind a responder. All methods are called with the timeline's lock held."""

    def __init__(
        self,
        camera: SimulatedCamera,
        profile: CameraProfile,
        timeline: Timeline,
        announce: Callable[[Announcement], None],
    ) -> None:
        self.camera, self.profile, self.timeline = camera, profile, timeline
        self.store = Store(profile.folder, profile.prefix)
        self.exposure = camera.set_exposure(Exposure(time=1 / 60))
        self.shooting = False
        """True while a shot is under way, from the release until its file is stored."""
        self.quality: Value = profile.raw_jpeg_settings[-1] if profile.jpeg else profile.raw_setting
        """CompressionSetting: whether the next shot is RAW, JPEG or both."""
        self.shots = 0
        """Number of shots so far."""
        able = camera.capabilities()
        labels = {"time": able.times, "f_number": able.f_numbers, "iso": able.isos}
        self.dials = {dial.code: dial.offering(labels[dial.setting]) for dial in profile.dials}
        self._announce = announce

    def shown(self, dial: SimulatedDial) -> int:
        """Return what a dial's property holds now."""
        return dial.number(getattr(self.exposure, dial.setting))

    def turn(self, dial: SimulatedDial, number: int) -> bool:
        """Turn a dial; whether it has that position."""
        label = dial.label(number)
        if label is None:
            return False
        self.exposure = self.exposure.model_copy(update={dial.setting: label})
        return True

    def shoot(
        self, transaction: int, faults: Sequence[Fault], memory_handles: tuple[int, int] | None = None
    ) -> ResponseCode:
        """Release the shutter; the file is announced once it is stored.

        memory_handles: of a file that stays in working memory, and of the JPEG beside it; see `Store.add`.
        """
        fault_of = {fault.kind: fault for fault in faults}
        if Kind.STORE_FULL in fault_of:
            self.store.full = True
        if self.shooting:
            return ResponseCode.DEVICE_BUSY
        if self.store.free == 0 and memory_handles is None:
            return ResponseCode.STORE_FULL
        off = fault_of.get(Kind.EXPOSURE_OFF)
        wanted = self.exposure.with_time(self.exposure.time * (1.0 + (off.share if off else 0.0)))
        label = self.camera.set_exposure(wanted)
        self.shooting = True
        slow = fault_of.get(Kind.SLOW_CARD)
        write = self.profile.write + (slow.seconds if slow else 0.0)

        def expose() -> None:
            self.camera.arm()
            self.camera.trigger()
            self.timeline.call_later(shutter.applied(label).time + write, store)

        def store() -> None:
            self._store(self.camera.collect(), transaction, fault_of, memory_handles)
            self.shooting = False

        if self.profile.lag:
            self.timeline.call_later(self.profile.lag, expose)
        else:
            expose()
        return ResponseCode.OK

    def shoot_bracket(
        self,
        transaction: int,
        faults: Sequence[Fault],
        thirds: int,
        memory_handles: Sequence[tuple[int, int]],
        held: Callable[[], bool],
    ) -> ResponseCode:
        """Shoot a frame for each pair of handles: as set, then ever shorter ones, then ever longer ones.

        thirds: of a stop between two. It goes on for as long as the button is held; the files are written
        meanwhile. What is beyond the ends of the dial is exposed as at its end.
        """
        fault_of = {fault.kind: fault for fault in faults}
        if self.shooting:
            return ResponseCode.DEVICE_BUSY
        if Kind.STORE_FULL in fault_of:
            return ResponseCode.STORE_FULL
        off = fault_of.get(Kind.EXPOSURE_OFF)
        frames = len(memory_handles)
        steps = [0, *range(-1, -(frames // 2) - 1, -1), *range(1, (frames - 1) // 2 + 1)]
        share = 1.0 + (off.share if off else 0.0)
        times = [self.exposure.time * 2 ** (step * thirds / 3) * share for step in steps]
        self.shooting = True

        def expose(number: int) -> None:
            if not held():
                self.timeline.call_later(self.profile.write, done)
                return
            lasting = shutter.applied(self.camera.set_exposure(self.exposure.with_time(times[number]))).time
            self.camera.arm()
            self.camera.trigger()
            self.timeline.call_later(lasting, lambda: expose_next(number, lasting))

        def expose_next(number: int, lasting: float) -> None:
            frame, handles = self.camera.collect(), memory_handles[number]
            store = partial(self._store, frame, transaction, fault_of, handles)
            self.timeline.call_later(self.profile.write, store)
            recovery = max(0.0, 1 / self.profile.rate - lasting)
            if number + 1 < frames:
                self.timeline.call_later(recovery, partial(expose, number + 1))
            else:
                self.timeline.call_later(max(recovery, self.profile.write), done)

        def done() -> None:
            self.shooting = False

        self.timeline.call_later(self.profile.lag, partial(expose, 0))
        return ResponseCode.OK

    def _store(
        self,
        frame: Any,
        transaction: int,
        fault_of: dict[Kind, Fault],
        memory_handles: tuple[int, int] | None,
    ) -> None:
        files = [photograph(frame, self.profile)]
        if isinstance(frame, RawMosaic):
            if self.quality in self.profile.jpeg_settings:
                files = [developed(frame)]
            elif self.quality in self.profile.raw_jpeg_settings:
                files.append(developed(frame))
        handles = [
            self.store.add(file, memory, beside=number > 0)
            for number, (file, memory) in enumerate(zip(files, memory_handles or (None, None), strict=False))
        ]
        self.shots += 1
        news = [Announcement(News.OBJECT_ADDED, handle, transaction) for handle in handles]
        news.append(Announcement(News.CAPTURE_COMPLETE, handles[0], transaction))
        if Kind.REORDERED_EVENTS in fault_of:
            news.reverse()
        if lost := fault_of.get(Kind.LOST_EVENT):
            news = news[max(1, lost.count) :]
        late = fault_of.get(Kind.LATE_EVENT)
        for announcement in news:
            if late is None:
                self._announce(announcement)
            else:
                self.timeline.call_later(late.seconds, partial(self._announce, announcement))


def developed(frame: Any) -> Photograph:
    """The small JPEG that a camera makes of a mosaic: a grey one, of its green photosites."""
    light = np.clip(frame.signal()[::2, 1::2], 0.0, 1.0)
    codes = np.rint(255 * srgb_encode(light)).astype(np.uint8)[..., None].repeat(3, 2)
    height, width = codes.shape[:2]
    data = encode_jpeg(codes, 90)
    return Photograph(data, FormatCode.EXIF_JPEG, ".JPG", width, height, frame.metadata.captured_at)


def photograph(frame: Any, profile: CameraProfile) -> Photograph:
    """The file of a frame: a DNG of a mosaic, the JPEG of a photograph that the camera developed."""
    taken = frame.metadata.captured_at
    if isinstance(frame, CameraFile):
        return Photograph(frame.data, FormatCode.EXIF_JPEG, ".JPG", frame.width, frame.height, taken)
    height, width = frame.pixels.shape
    return Photograph(encode_dng(frame), profile.raw_format, ".DNG", width, height, taken)
