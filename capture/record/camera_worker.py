"""What is done with one camera, in a thread of its own: set, arm, wait for the others, trigger, collect.

A camera that keeps its shots is emptied of each while it exposes the next.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from capture.bracket.acceptance import RETRIES
from capture.bracket.single_exposure import CapturedFrame, made_ready
from capture.record.exposure_step import ExposureStep, RunState
from capture.record.memory_budget import MemoryBudget
from capture.record.thread_group import Inbox
from drivers.camera import Camera, CameraFile, StoresShots
from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraTimeout
from imaging.errors import CameraError, RigError
from imaging.exposure import Exposure
from imaging.mosaic import RawMosaic

GIVE_UP_AFTER = 3
"""Shots that a camera may miss in a row, with all attempts, before the run goes on without it."""
COPIES = 2
"""Frames in memory during a download: the bytes that came, and what they are put together into."""

HandOver = Callable[[ExposureStep, str, CapturedFrame, int], None]
"""Takes over a frame: its exposure step, its camera, itself, and the bytes of the budget that it holds."""


class _StoredShot(NamedTuple):
    """A shot that is stored in the camera: `shot` is what the camera knows it by."""

    step: ExposureStep
    set_to: Exposure
    opened: float
    shot: Any


class CameraGivenUp(CameraError):
    """A camera that failed too often to be asked again."""


class CameraWorker:
    """One camera of a capture. orders: the exposure steps that it has still to take part in.

    sizes: bytes of a frame of each camera, by the last that it delivered; shared by the threads.
    """

    def __init__(
        self,
        name: str,
        camera: Camera,
        clock: Clock,
        state: RunState,
        budget: MemoryBudget,
        sizes: dict[str, int],
        hand_over: HandOver,
    ) -> None:
        self.name, self._camera = name, camera
        self._clock, self._state, self._budget, self._sizes = clock, state, budget, sizes
        self._hand_over = hand_over
        self.orders: Inbox[ExposureStep] = Inbox(clock)
        self._misses = 0
        self._stored: _StoredShot | None = None
        self._overlaps = True
        """Whether it has not refused yet to be emptied while it exposes."""

    def serve(self) -> None:
        """The work of the camera's thread."""
        while (step := self._next()) is not None:
            self._take(step)
            with self._clock.lock:
                self._state.late.discard(self.name)

    def _next(self) -> ExposureStep | None:
        """The next order; while there is none, nothing is left in the camera."""
        step = self.orders.poll()
        if step is None:
            self._empty()
            step = self.orders.get()
        return step

    def _take(self, step: ExposureStep) -> None:
        """Expose with the others and collect; the step learns what became of it."""
        if self._misses >= GIVE_UP_AFTER * (RETRIES + 1):
            step.finish(self.name, CameraGivenUp("given up after failing before"))
            return
        if step.begun:
            step.count_failure(self.name)
            step.finish(self.name, CameraTimeout("it was not ready when the others exposed"))
            return
        try:
            step.wait_for_leader(self.name)
            set_to = made_ready(self._camera, step.requested)
            step.wait_for_others(self.name)
            begun = self._clock.now()
            try:
                self._shoot(step, set_to)
            except CameraError:
                # Alone, a camera on a wire would wait for an edge, or trigger those that are not meant.
                if step.leader is not None or self._clock.now() - begun > step.requested.time / 2:
                    raise
                # The others still expose: what is made up for at once costs them least.
                step.count_failure(self.name)
                self._empty()
                self._shoot(step, made_ready(self._camera, step.requested))
        except CameraError as error:
            self._missed(step, error)
            self._empty()
        except RigError as error:  # the disk ended the run
            step.finish(self.name, error)

    def _missed(self, step: ExposureStep, error: CameraError) -> None:
        self._misses += 1
        step.count_failure(self.name)
        step.finish(self.name, error)

    def _shoot(self, step: ExposureStep, set_to: Exposure) -> None:
        """Expose, and meanwhile fetch the shot before; this one stays in the camera if another is to come."""
        opened, camera = self._camera.trigger(), self._camera
        self._empty(again=True)
        if isinstance(camera, StoresShots) and self._overlaps and self.orders.has_items and camera.keeps():
            shot = camera.keep()
            self._empty()
            self._stored = _StoredShot(step, set_to, opened, shot)
        else:
            self._collect(step, set_to, opened, camera.collect)
            self._empty()

    def _empty(self, again: bool = False) -> None:
        """Fetch the shot that is still in the camera, if there is one; its step learns what became of it.

        again: what fails now is tried once more later, and a camera that was too busy is emptied from then
        on before it exposes again.
        """
        stored, self._stored = self._stored, None
        if stored is None:
            return
        assert isinstance(self._camera, StoresShots)
        try:
            self._collect(stored.step, stored.set_to, stored.opened, partial(self._camera.fetch, stored.shot))
        except CameraError as error:
            if again:
                self._stored, self._overlaps = stored, not isinstance(error, CameraBusy)
            else:
                self._missed(stored.step, error)

    def _collect(
        self,
        step: ExposureStep,
        set_to: Exposure,
        opened: float,
        deliver: Callable[[], RawMosaic | CameraFile],
    ) -> None:
        """Download within the budget; the frame leaves with the part of it that it still takes."""
        reserved = self._expected()
        self._budget.reserve(reserved)
        try:
            frame = deliver()
        except BaseException:
            self._budget.release(reserved)
            raise
        if isinstance(frame, RawMosaic):
            held, pixels = frame.pixels.nbytes, frame.pixels.size
        else:
            beside = 0 if frame.developed is None else len(frame.developed[1])
            held, pixels = len(frame.data) + beside, frame.width * frame.height
        with self._clock.lock:
            self._sizes[self.name] = 2 * pixels
            if frame.metadata.opened is not None:  # more exact than when the order was given
                opened = frame.metadata.opened
            if self.name in step.cameras:
                step.opened[self.name] = opened
        self._misses = 0
        if self.name not in step.cameras:
            self._budget.release(reserved)
            return
        self._budget.replace(reserved, held)
        self._hand_over(step, self.name, CapturedFrame(frame, set_to, opened, step.failures(self.name)), held)

    def _expected(self) -> int:
        """Bytes that the next download takes; the whole budget as long as no frame has come."""
        with self._clock.lock:
            size = self._sizes.get(self.name) or max(self._sizes.values(), default=0)
        return COPIES * size or self._budget.limit
