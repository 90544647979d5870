"""All threads of a capture: one for each camera, and those that write.

No camera waits for the download of another, only for all to be ready; files are written while the next
exposure runs. All waiting goes through the clock, so that on a virtual one every run is the same.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import TracebackType
from typing import NamedTuple, Self

from capture.bracket.single_exposure import CapturedFrame
from capture.record.threads.camera_worker import CameraWorker
from capture.record.threads.exposure_step import ExposureStep, RunState, SavedShot
from capture.record.threads.memory_budget import MemoryBudget
from capture.record.threads.thread_group import Inbox, ThreadGroup
from drivers.camera import Camera, CameraFile
from drivers.clock import Clock
from imaging.errors import CameraError, RigError, StorageError

WRITERS = 4
"""Some hash while the disk has the others wait."""

Save = Callable[[ExposureStep, str, CapturedFrame], SavedShot]
"""Makes a file of a camera's frame; StorageError if the disk refuses."""
Prove = Callable[[SavedShot], None]
"""Decodes a camera's own file; CameraError if it is damaged."""


class _UnsavedFrame(NamedTuple):
    """A frame between camera and disk, and the bytes of the budget that it holds."""

    step: ExposureStep
    camera: str
    frame: CapturedFrame
    held: int


class _UnprovenShot(NamedTuple):
    """Camera file on the disk that is not decoded yet."""

    step: ExposureStep
    camera: str
    saved: SavedShot


class CaptureThreads:
    """The threads, begun and ended by `with`; `state` is shared with the exposure steps that they shoot."""

    def __init__(
        self,
        cameras: Mapping[str, Camera],
        clock: Clock,
        save: Save,
        prove: Prove,
        state: RunState,
        budget: MemoryBudget,
    ) -> None:
        self._clock, self._save, self._prove = clock, save, prove
        self._state, self._budget = state, budget
        self._unsaved: Inbox[_UnsavedFrame] = Inbox(clock)
        self._unproven: Inbox[_UnprovenShot] = Inbox(clock)
        sizes: dict[str, int] = {}
        self._workers = {
            name: CameraWorker(name, camera, clock, state, budget, sizes, self._hand_over)
            for name, camera in cameras.items()
        }
        self._threads = ThreadGroup(
            clock,
            {
                **{f"camera {name}": worker.serve for name, worker in self._workers.items()},
                **{f"writer {number}": self._write for number in range(WRITERS)},
                "prover": self._read_back,
            },
            self._end,
        )

    def __enter__(self) -> Self:
        self._threads.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self._threads.__exit__(kind, error, where)

    def shoot(self, steps: Sequence[ExposureStep], bracketed: str | None = None) -> Iterator[ExposureStep]:
        """Expose one step after the other; each is yielded once it is over, while later ones go on.

        bracketed: the only camera that takes part, which gets all steps in one order and may shoot them as
        its body can. What a thread died of is raised here.
        """
        if bracketed is not None:
            self._workers[bracketed].orders.put(steps)
        else:
            for step in steps:
                for camera in step.participants:
                    self._workers[camera].orders.put((step,))
        for step in steps:
            self._clock.wait(partial(self._over_or_broken, step), math.inf)
            if self._threads.defect is not None:
                raise self._threads.defect
            yield step

    def _over_or_broken(self, step: ExposureStep) -> bool:
        return step.is_over() or self._threads.defect is not None

    def halt(self, reason: RigError) -> None:
        """Begin no more exposures, and write no more."""
        with self._clock.lock:
            self._state.halted = self._state.halted or reason
            for name, worker in self._workers.items():
                for steps in worker.orders.take_all():
                    for step in steps:
                        step.finish(name, reason)
            self._clock.changed()

    def _hand_over(self, step: ExposureStep, camera: str, frame: CapturedFrame, held: int) -> None:
        self._unsaved.put(_UnsavedFrame(step, camera, frame, held))

    def _write(self) -> None:
        """The work of one writing thread."""
        while (unsaved := self._unsaved.get()) is not None:
            step, camera, frame, held = unsaved
            to_prove = isinstance(frame.frame, CameraFile) and not frame.frame.proven
            outcome: SavedShot | RigError
            try:
                outcome = self._state.halted or self._save(step, camera, frame)
            except StorageError as error:
                self.halt(error)
                outcome = error
            del unsaved, frame  # or this frame would stay while the next is waited for
            self._budget.release(held)
            if to_prove and isinstance(outcome, SavedShot):
                self._unproven.put(_UnprovenShot(step, camera, outcome))
            else:
                step.finish(camera, outcome)

    def _read_back(self) -> None:
        """The work of the thread that decodes each camera's file once its bytes are written and let go of.

        Neither camera nor disk waits for it; it is one thread, since what is decoded takes more memory than
        what is written.
        """
        while (unproven := self._unproven.get()) is not None:
            step, camera, saved = unproven
            outcome: SavedShot | RigError = saved
            try:
                self._prove(saved)
            except CameraError as error:
                step.count_failure(camera)
                outcome = error
            except StorageError as error:
                self.halt(error)
                outcome = error
            step.finish(camera, outcome)

    def _end(self) -> None:
        """End all threads, also those that wait for others."""
        self.halt(RigError("the run was broken off"))
        for worker in self._workers.values():
            worker.orders.close()
        self._unsaved.close()
        self._unproven.close()
