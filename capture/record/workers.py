"""All threads of a capture: one for each camera, and those that write.

No camera waits for the download of another, only for all to be ready; files are written while the next
exposure runs. All waiting goes through the clock, so that on a virtual one every run is the same.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import TracebackType
from typing import NamedTuple, Self

from capture.bracket.single_exposure import Taken
from capture.record.camera_worker import Hand
from capture.record.exposure_step import Round, Standing, Written
from capture.record.memory_budget import Budget
from capture.record.threads import Inbox, Threads
from drivers.camera import Camera
from drivers.clock import Clock
from imaging.errors import RigError, StorageError

WRITERS = 4
"""Some hash while the disk has the others wait."""

Save = Callable[[Round, str, Taken], Written]
"""Makes a file of a camera's frame; StorageError if the disk refuses."""


class _Unsaved(NamedTuple):
    """A frame between camera and disk, and the bytes of the budget that it holds."""

    one: Round
    camera: str
    taken: Taken
    held: int


class Crew:
    """The threads, begun and ended by `with`; `standing` is shared with the rounds that they shoot."""

    def __init__(
        self, cameras: Mapping[str, Camera], clock: Clock, save: Save, standing: Standing, budget: Budget
    ) -> None:
        self._clock, self._save, self._standing, self._budget = clock, save, standing, budget
        self._unsaved: Inbox[_Unsaved] = Inbox(clock)
        sizes: dict[str, int] = {}
        self._hands = {
            name: Hand(name, camera, clock, standing, budget, sizes, self._hand_over)
            for name, camera in cameras.items()
        }
        self._threads = Threads(
            clock,
            {
                **{f"camera {name}": hand.serve for name, hand in self._hands.items()},
                **{f"writer {number}": self._write for number in range(WRITERS)},
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

    def shoot(self, rounds: Sequence[Round]) -> Iterator[Round]:
        """Expose one round after the other; each is yielded once it is over, while later ones go on.

        What a thread died of is raised here.
        """
        for one in rounds:
            for camera in one.party:
                self._hands[camera].orders.put(one)
        for one in rounds:
            self._clock.wait(partial(self._settled, one), math.inf)
            if self._threads.defect is not None:
                raise self._threads.defect
            yield one

    def _settled(self, one: Round) -> bool:
        return one.is_over() or self._threads.defect is not None

    def halt(self, reason: RigError) -> None:
        """Begin no more exposures, and write no more."""
        with self._clock.lock:
            self._standing.halted = self._standing.halted or reason
            for name, hand in self._hands.items():
                for one in hand.orders.take_all():
                    one.settle(name, reason)
            self._clock.changed()

    def _hand_over(self, one: Round, camera: str, taken: Taken, held: int) -> None:
        self._unsaved.put(_Unsaved(one, camera, taken, held))

    def _write(self) -> None:
        """The work of one writing thread."""
        while (unsaved := self._unsaved.get()) is not None:
            one, camera, taken, held = unsaved
            outcome: Written | RigError
            try:
                outcome = self._standing.halted or self._save(one, camera, taken)
            except StorageError as error:
                self.halt(error)
                outcome = error
            del unsaved, taken  # or this frame would stay while the next is waited for
            self._budget.give(held)
            one.settle(camera, outcome)

    def _end(self) -> None:
        """Have all threads return, also those that wait for others."""
        self.halt(RigError("the run was broken off"))
        for hand in self._hands.values():
            hand.orders.close()
        self._unsaved.close()
