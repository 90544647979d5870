"""Acquisition of the simulated machine vision camera: modes, triggers and the sequencer."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from drivers.sim.camera import shutter
from drivers.sim.camera.camera import SimulatedCamera
from drivers.sim.genicam.feature_registers import LINES, Feature
from drivers.sim.genicam.memory import FeatureMemory
from drivers.sim.usb.timeline import Timeline
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic

READOUT = 1e-3
"""Seconds from the end of an exposure to its first byte."""
_CONTINUOUS, _SINGLE = 0, 1
_FRAME, _BURST = 0, 1
SOFTWARE, ACTION = 0, 1 + LINES

Deliver = Callable[[RawMosaic, float, float], None]
Shutter = Callable[[bool, float], None]


@dataclass(frozen=True)
class _Set:
    """Contents of a set of the sequencer."""

    label: Exposure
    following: int


class Acquisition:
    """Acts on what the host writes; called with the timeline's lock held."""

    def __init__(
        self,
        camera: SimulatedCamera,
        memory: FeatureMemory,
        timeline: Timeline,
        streams: Callable[[], bool],
        deliver: Deliver,
        shutter_moved: Shutter,
    ) -> None:
        """`deliver(mosaic, time, opened)` sends a frame, exposed for `time` s from `opened` of the timeline.

        `streams()`: whether a receiver is connected. `shutter_moved(open, when)` is called at each exposure's
        beginning and end.
        """
        self._streams = streams
        self._camera, self._memory, self._timeline = camera, memory, timeline
        self._deliver, self._shutter_moved = deliver, shutter_moved
        self._label = camera.set_exposure(Exposure(time=1 / 100, iso=100))
        self._sets: dict[int, _Set] = {}
        self._set = 0
        self._frames = self._burst = 0.0
        self._exposing = self._open = False
        self._shot = 0
        self._show()

    def written(self, address: int) -> None:
        """The host wrote to a register."""
        memory = self._memory
        if address in (Feature.EXPOSURE_TIME, Feature.GAIN):
            time, gain = memory.get_float(Feature.EXPOSURE_TIME), memory.get(Feature.GAIN)
            self._turn(Exposure(time=max(time, 1.0) / 1e6, iso=max(gain, 1) / 10))
        elif address == Feature.ACQUISITION_START:
            self._start()
        elif address == Feature.ACQUISITION_STOP:
            self.stop()
        elif address == Feature.TRIGGER_SOFTWARE:
            self.pulse(SOFTWARE)
        elif address == Feature.SET_SAVE:
            chosen = memory.get(Feature.SET_SELECTOR)
            self._sets[chosen] = _Set(self._label, memory.get(Feature.SET_NEXT))
        elif address == Feature.SEQUENCER_MODE and memory.get(Feature.SEQUENCER_MODE):
            self._enter(memory.get(Feature.SET_START))

    def edge(self, line: int, rising: bool) -> None:
        """An edge on a line; ignored on an output."""
        if not self._memory.get(Feature.LINE_CONTROL, line) & 1:
            self.pulse(1 + line, rising)

    def pulse(self, source: int, rising: bool = True, at: float | None = None) -> None:
        """A trigger: SOFTWARE, 1 + the number of a line, or ACTION; ignored unless the camera waits for it.

        at: when the shutter opens, on the timeline, where that is not now but to the moment then.
        """
        for trigger in (_FRAME, _BURST):
            control = self._memory.get(Feature.TRIGGER_CONTROL, trigger)
            waits = control & 1 and control >> 4 & 15 == source
            waits = waits and (source == SOFTWARE or bool(control >> 8 & 1) is not rising)
            if waits and self._frames and not self._exposing:
                self._burst = self._memory.get(Feature.BURST_COUNT) if trigger == _BURST else 1
                self._expose(at)

    def stop(self) -> None:
        """No more frames; one that is being exposed is dropped."""
        self._frames = self._burst = 0
        if self._exposing:
            self._camera.collect()
            self._close_shutter(self._shot)
        self._exposing = False
        self._shot += 1

    def _start(self) -> None:
        mode = self._memory.get(Feature.ACQUISITION_MODE)
        if not self._streams() or self._frames:
            return
        counts = {_CONTINUOUS: math.inf, _SINGLE: 1}
        self._frames = counts.get(mode, self._memory.get(Feature.FRAME_COUNT))
        if not any(self._memory.get(Feature.TRIGGER_CONTROL, selector) & 1 for selector in (_FRAME, _BURST)):
            self._burst = math.inf
            self._expose()

    def _expose(self, at: float | None = None) -> None:
        self._camera.set_exposure(self._label)
        self._camera.arm()
        self._camera.trigger()
        self._exposing = True
        self._shot += 1
        time, shot = shutter.applied(self._label).time, self._shot
        opened = self._timeline.now() if at is None else at
        self._open = True
        self._shutter_moved(True, opened)
        self._timeline.call_later(time, lambda: self._close_shutter(shot))
        self._timeline.call_later(time + READOUT, lambda: self._finish(shot, time, opened))

    def _close_shutter(self, shot: int) -> None:
        if self._open and shot == self._shot:
            self._open = False
            self._shutter_moved(False, self._timeline.now())

    def _finish(self, shot: int, time: float, opened: float) -> None:
        if shot != self._shot:
            return  # It was stopped meanwhile.
        mosaic = self._camera.collect()
        assert isinstance(mosaic, RawMosaic)
        self._exposing = False
        self._frames -= 1
        self._burst -= 1
        self._deliver(mosaic, time, opened)
        if self._memory.get(Feature.SEQUENCER_MODE) and self._set in self._sets:
            self._enter(self._sets[self._set].following)
        if self._frames > 0 and self._burst > 0:
            self._expose()

    def _enter(self, chosen: int) -> None:
        self._set = chosen
        if chosen in self._sets:
            self._turn(self._sets[chosen].label)

    def _turn(self, wanted: Exposure) -> None:
        self._label = shutter.snap(wanted)
        self._show()

    def _show(self) -> None:
        """The registers say what will be applied, not what the dials are labelled."""
        assert self._label.iso is not None
        self._memory.put_float(Feature.EXPOSURE_TIME, 1e6 * shutter.applied(self._label).time)
        self._memory.put(Feature.GAIN, round(10 * self._label.iso))
