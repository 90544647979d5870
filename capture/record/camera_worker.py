"""What is done with one camera, in a thread of its own: set, arm, meet the others, trigger, collect.

A camera that keeps its shots is emptied of each while it exposes the next.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from capture.bracket.single_exposure import RETRIES, Taken, made_ready
from capture.record.exposure_step import Round, Standing
from capture.record.memory_budget import Budget
from capture.record.threads import Inbox
from drivers.camera import Camera, EncodedPhoto, Keeping
from drivers.clock import Clock
from drivers.errors import CameraBusy, CameraTimeout
from imaging.errors import CameraError, RigError
from imaging.exposure import Exposure
from imaging.mosaic import RawMosaic

GIVE_UP_AFTER = 3
"""Shots that a camera may miss in a row, with all attempts, before the run goes on without it."""
COPIES = 3
"""Frames in memory during a download: the bytes that came, what their decoder makes of them, the pixels."""

HandOver = Callable[[Round, str, Taken, int], None]
"""Takes over a frame: its round, its camera, itself, and the bytes of the budget that it holds."""


class _Kept(NamedTuple):
    """A shot that is stored in the camera: `shot` is what the camera knows it by."""

    one: Round
    set_to: Exposure
    opened: float
    shot: Any


class GivenUp(CameraError):
    """A camera that failed too often to be asked again."""


class Hand:
    """One camera of a crew. orders: the rounds that it has still to take part in.

    sizes: bytes of a frame of each camera, by the last that it delivered; shared by the crew.
    """

    def __init__(
        self,
        name: str,
        camera: Camera,
        clock: Clock,
        standing: Standing,
        budget: Budget,
        sizes: dict[str, int],
        hand_over: HandOver,
    ) -> None:
        self.name, self._camera = name, camera
        self._clock, self._standing, self._budget, self._sizes = clock, standing, budget, sizes
        self._hand_over = hand_over
        self.orders: Inbox[Round] = Inbox(clock)
        self._misses = 0
        self._kept: _Kept | None = None
        self._overlaps = True
        """Whether it has not refused yet to be emptied while it exposes."""

    def serve(self) -> None:
        """The work of the camera's thread."""
        while (one := self._next()) is not None:
            self._take(one)
            with self._clock.lock:
                self._standing.late.discard(self.name)

    def _next(self) -> Round | None:
        """The next order; while there is none, nothing is left in the camera."""
        one = self.orders.poll()
        if one is None:
            self._empty()
            one = self.orders.get()
        return one

    def _take(self, one: Round) -> None:
        """Expose with the others and collect; the round learns what became of it."""
        if self._misses >= GIVE_UP_AFTER * (RETRIES + 1):
            one.settle(self.name, GivenUp("given up after failing before"))
            return
        if one.begun:
            one.failed(self.name)
            one.settle(self.name, CameraTimeout("it was not ready when the others exposed"))
            return
        try:
            one.come(self.name)
            set_to = made_ready(self._camera, one.requested)
            one.meet(self.name)
            met = self._clock.now()
            try:
                self._shoot(one, set_to)
            except CameraError:
                # Alone, one on a wire would wait for an edge, or trigger those that are not meant.
                if one.leader is not None or self._clock.now() - met > one.requested.time / 2:
                    raise
                # The others still expose: what is made up for at once costs them least.
                one.failed(self.name)
                self._empty()
                self._shoot(one, made_ready(self._camera, one.requested))
        except CameraError as error:
            self._missed(one, error)
            self._empty()
        except RigError as error:  # the disk ended the run
            one.settle(self.name, error)

    def _missed(self, one: Round, error: CameraError) -> None:
        self._misses += 1
        one.failed(self.name)
        one.settle(self.name, error)

    def _shoot(self, one: Round, set_to: Exposure) -> None:
        """Expose, and meanwhile fetch the shot before; this one stays in the camera if another is to come."""
        opened, camera = self._camera.trigger(), self._camera
        self._empty(again=True)
        if isinstance(camera, Keeping) and self._overlaps and self.orders.waits and camera.keeps():
            shot = camera.keep()
            self._empty()
            self._kept = _Kept(one, set_to, opened, shot)
        else:
            self._collect(one, set_to, opened, camera.collect)
            self._empty()

    def _empty(self, again: bool = False) -> None:
        """Fetch the shot that is still in the camera, if there is one; its round learns what became of it.

        again: what fails now is tried once more later, and a camera that was too busy is emptied from then
        on before it exposes again.
        """
        kept, self._kept = self._kept, None
        if kept is None:
            return
        assert isinstance(self._camera, Keeping)
        try:
            self._collect(kept.one, kept.set_to, kept.opened, partial(self._camera.fetch, kept.shot))
        except CameraError as error:
            if again:
                self._kept, self._overlaps = kept, not isinstance(error, CameraBusy)
            else:
                self._missed(kept.one, error)

    def _collect(
        self, one: Round, set_to: Exposure, opened: float, deliver: Callable[[], RawMosaic | EncodedPhoto]
    ) -> None:
        """Download within the budget; the frame leaves with the part of it that it still takes."""
        count = self._expected()
        self._budget.take(count)
        try:
            frame = deliver()
        except BaseException:
            self._budget.give(count)
            raise
        if isinstance(frame, RawMosaic):
            kept, pixels = frame.pixels.nbytes, frame.pixels.size
        else:
            kept, pixels = len(frame.data), frame.width * frame.height
        with self._clock.lock:
            self._sizes[self.name] = 2 * pixels
            if frame.metadata.opened is not None:  # it knows better than who gave the order
                opened = frame.metadata.opened
            if self.name in one.cameras:
                one.opened[self.name] = opened
        self._misses = 0
        if self.name not in one.cameras:
            self._budget.give(count)
            return
        self._budget.give(count - kept)
        self._hand_over(one, self.name, Taken(frame, set_to, opened, one.tries(self.name)), kept)

    def _expected(self) -> int:
        """Bytes that the next download takes; all that may be taken as long as no frame has told."""
        with self._clock.lock:
            known = self._sizes.get(self.name) or max(self._sizes.values(), default=0)
        return COPIES * known or self._budget.limit
