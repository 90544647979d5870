"""Worker thread of one camera: set, arm, wait for the others, trigger, collect.

A camera that keeps its shots is emptied of each while it exposes the next. Steps that do not have to be
synchronised may come together: a body that has brackets of its own then shoots them on one order.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from capture.bracket.acceptance import RETRIES
from capture.bracket.deviation import deviates
from capture.bracket.single_exposure import CapturedFrame, made_ready
from capture.record.threads.exposure_step import ExposureStep, RunState
from capture.record.threads.memory_budget import MemoryBudget
from capture.record.threads.thread_group import Inbox
from drivers.camera import Camera, CameraFile, HardwareTriggered, ShootsBrackets, StoresShots
from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraGone, CameraLost, CameraTimeout, HostLost
from imaging.errors import CameraError, RigError
from imaging.optics.exposure import Exposure
from imaging.sensor.mosaic import RawMosaic

GIVE_UP_AFTER = 3
"""Shots that a camera may miss in a row, with all attempts, before the run goes on without it."""
COPIES = 2
"""Frames in memory during a download: the bytes that came, and what they are put together into."""

HandOver = Callable[[ExposureStep, str, CapturedFrame, int], None]
"""Takes over a frame: its exposure step, its camera, itself, and the bytes of the budget that it holds."""


class _Order(NamedTuple):
    """Order to expose: the time at which sending began, and the time at which it counts as given; seconds of
    the clock.
    """

    began: float
    ordered: float


class _StoredShot(NamedTuple):
    """A shot that is stored in the camera: `shot` is what the camera knows it by."""

    step: ExposureStep
    set_to: Exposure
    order: _Order
    over: float
    shot: Any


class _Download(NamedTuple):
    """A frame that came, and the bytes of the budget that it holds."""

    frame: RawMosaic | CameraFile
    held: int


class CameraGivenUp(CameraError):
    """A camera that failed too often to be asked again."""


class CameraWorker:
    """One camera of a capture. orders: the exposure steps that it has still to take part in; several at once
    are a bracket that it may shoot as its body can.

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
        self.orders: Inbox[Sequence[ExposureStep]] = Inbox(clock)
        self._misses = 0
        self._stored: _StoredShot | None = None
        self._overlaps = True
        """True until the camera refuses downloads during an exposure."""
        self._refused: set[tuple[Exposure, ...]] = set()
        """Brackets that its body has not shot as they were asked for: it is not asked again."""

    def serve(self) -> None:
        """The work of the camera's thread."""
        while (steps := self._next()) is not None:
            if len(steps) > 1:
                for step in self._bracketed(steps):
                    self.orders.put((step,))
                continue
            self._take(steps[0])
            with self._clock.lock:
                self._state.late.discard(self.name)

    def _next(self) -> Sequence[ExposureStep] | None:
        """Return the next order; before waiting, the camera is emptied."""
        steps = self.orders.poll()
        if steps is None:
            self._empty()
            steps = self.orders.get()
        return steps

    def _bracketed(self, steps: Sequence[ExposureStep]) -> Sequence[ExposureStep]:
        """Shoot as many of them as the body's brackets hold; return the remaining steps."""
        missing = list(steps)
        self._empty()
        while len(missing) > 1 and not self._misses and self._brings_some(missing):
            pass
        return missing

    def _brings_some(self, missing: list[ExposureStep]) -> bool:
        """Shoot one in-camera bracket, remove the completed steps from `missing`, return whether any came.

        A frame is that of the step whose exposure its file states: one that says nothing proves nothing.
        """
        camera, exposures = self._camera, tuple(step.requested for step in missing)
        if (
            not isinstance(camera, ShootsBrackets)
            or isinstance(camera, HardwareTriggered)  # each of its frames may be an edge's
            or exposures in self._refused
        ):
            return False
        released, error = False, None
        try:
            frames = iter(camera.bracket(exposures))
            while self._state.halted is None and (download := self._download(lambda: next(frames, None))):
                released = True
                stated = download.frame.metadata.exposure
                shown = [one for one in missing if stated and not deviates(stated, one.requested)]
                step = shown[0] if shown else None
                if step is None:
                    self._budget.release(download.held)
                else:
                    missing.remove(step)
                    captured = CapturedFrame(
                        download.frame, step.requested, self._clock.now(), step.failures(self.name)
                    )
                    self._deliver(step, captured, download.held)
        except CameraError as broken_off:
            error = broken_off
        if self._state.halted is not None:
            return False
        brought = len(exposures) - len(missing)
        if brought > 1 and error is None:
            return True
        if not isinstance(error, CameraLost):
            self._refused.add(exposures)
        if released:
            for step in missing:
                step.count_failure(self.name)
        return False

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
        # A host that is lost fails at once, and its cameras take part again as soon as it is back.
        if not isinstance(error, HostLost):
            # The others stood still for one that was waited for: another attempt at the shot costs as much.
            self._misses += RETRIES + 1 if isinstance(error, CameraGone) else 1
        step.count_failure(self.name)
        step.finish(self.name, error)

    def _shoot(self, step: ExposureStep, set_to: Exposure) -> None:
        """Expose, and meanwhile fetch the shot before; this one stays in the camera if another is to come."""
        camera, began = self._camera, self._clock.now()
        order = _Order(began, camera.trigger())
        self._empty(again=True)
        if isinstance(camera, StoresShots) and self._overlaps and self.orders.has_items and camera.keeps():
            shot = camera.keep()
            over = self._clock.now()
            self._empty()
            self._stored = _StoredShot(step, set_to, order, over, shot)
        else:
            self._collect(step, set_to, order, None, camera.collect)
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
            fetched = partial(self._camera.fetch, stored.shot)
            self._collect(stored.step, stored.set_to, stored.order, stored.over, fetched)
        except CameraError as error:
            if again:
                self._stored, self._overlaps = stored, not isinstance(error, CameraBusy)
            else:
                self._missed(stored.step, error)

    def _collect(
        self,
        step: ExposureStep,
        set_to: Exposure,
        order: _Order,
        over: float | None,
        deliver: Callable[[], RawMosaic | CameraFile],
    ) -> None:
        """Collect the frame. over: time by which the exposure had ended; None: when the frame arrives."""
        download = self._download(deliver)
        assert download is not None
        captured = CapturedFrame(
            frame=download.frame,
            set_to=set_to,
            ordered=order.ordered,
            retries=step.failures(self.name),
            began=order.began,
            over=self._clock.now() if over is None else over,
        )
        self._deliver(step, captured, download.held)

    def _download(self, deliver: Callable[[], RawMosaic | CameraFile | None]) -> _Download | None:
        """A frame within the budget, with the part of it that it still takes; None if there is no more."""
        reserved = self._expected()
        self._budget.reserve(reserved)
        try:
            frame = deliver()
        except BaseException:
            self._budget.release(reserved)
            raise
        if frame is None:
            self._budget.release(reserved)
            return None
        if isinstance(frame, RawMosaic):
            held, pixels = frame.pixels.nbytes, frame.pixels.size
        else:
            beside = 0 if frame.developed is None else len(frame.developed[1])
            held, pixels = len(frame.data) + beside, frame.width * frame.height
        with self._clock.lock:
            self._sizes[self.name] = 2 * pixels
        self._budget.replace(reserved, held)
        return _Download(frame, held)

    def _deliver(self, step: ExposureStep, captured: CapturedFrame, held: int) -> None:
        """Hand a frame over to those who write, if its step wants it of this camera."""
        opened = captured.frame.metadata.opened
        with self._clock.lock:
            if self.name in step.cameras:
                step.ordered[self.name] = captured.ordered
                if captured.began is not None:
                    step.began[self.name] = captured.began
                if opened is not None:
                    step.opened[self.name] = opened
        self._misses = 0
        if self.name not in step.cameras:
            self._budget.release(held)
            return
        self._hand_over(step, self.name, captured, held)

    def _expected(self) -> int:
        """Bytes that the next download takes; the whole budget as long as no frame has come."""
        with self._clock.lock:
            size = self._sizes.get(self.name) or max(self._sizes.values(), default=0)
        return COPIES * size or self._budget.limit
