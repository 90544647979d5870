"""Reading of the photographs that a training needs, where memory and time allow it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from imaging.progress import Progress
from recon.data.dataset import Dataset, View
from recon.data.decoded import FOLDER
from recon.data.load import load
from recon.decide.cost.duration import how_long
from recon.decide.cost.memory_need import fitting, free
from recon.decide.request import TrainingRequest


@dataclass(frozen=True)
class Reader:
    """Photographs of a session at a width; says what memory and time they take, before most are read."""

    session: Path
    request: TrainingRequest
    progress: Progress
    say: Callable[[str], None]

    def read(self, width: int, *, begins: bool = False) -> Dataset:
        """Read them; begins: say how long a training would take that begins with them."""
        examine = partial(self._examine, begins)
        loaded = load(
            self.session,
            max_width=width,
            all_views=self.request.all_views,
            progress=self.progress,
            examine=examine,
        )
        return self.request.overrides.subset(loaded)

    def _examine(self, begins: bool, firsts: Sequence[View], counts: Mapping[str, tuple[int, int]]) -> bool:
        """Judge the first view of each camera; True if images have to stay on the disk.

        InputError where the memory does not hold the training.
        """
        room = free()
        needed, stored = fitting(firsts, counts, room, self.request)
        needed.require(self.session, room)
        if needed.worth_saying(room):
            self.say(needed.in_words())
        if begins and (line := how_long(self.session, firsts, counts, self.request)) is not None:
            self.say(line)
        if stored:
            self.say(f"images stay on the disk, in {self.session / FOLDER}, which may be deleted afterwards")
        return stored
