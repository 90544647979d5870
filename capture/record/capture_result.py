"""Result of a capture: the shots that were taken, and those that are missing."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imaging.errors import PartialError
from imaging.session.records import RunRecord

LISTED = 6
"""Missing shots, or causes of theirs, that a sentence names."""


@dataclass(frozen=True)
class CaptureResult:
    """Result of a capture.

    Attributes:
        session: Session folder.
        planned: Shots of the plan.
        taken: Shots of this run.
        earlier: Shots of earlier runs.
        missing: A sentence for each missing shot.
        problems: A sentence for each shot that deviates from its request.
        unknown: Facts that no driver could learn, a sentence each.
        run: Forecast and outcome of this run; None if it took no shot.
    """

    session: Path
    planned: int
    taken: int
    earlier: int
    missing: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    run: RunRecord | None = None

    def require_complete(self) -> None:
        """PartialError that lists what is missing, if anything is."""
        if self.missing:
            raise PartialError(
                f"{self.session}: {len(self.missing)} of {self.planned} shots are missing "
                f"({_listed(self.missing)}): repeat the command with --resume to take them."
            )


def _listed(missing: Sequence[str]) -> str:
    """Each of few sentences; of many one of each cause, and how many more there are."""
    if len(missing) <= LISTED:
        return "; ".join(missing)
    causes: dict[str, list[str]] = {}
    for sentence in missing:
        shot, _, cause = sentence.partition(": ")
        causes.setdefault(cause, []).append(shot)
    sentences = [
        f"{shots[0]}" + (f" and {len(shots) - 1} more" if len(shots) > 1 else "") + f": {cause}"
        for cause, shots in causes.items()
    ]
    rest = sum(len(shots) for shots in [*causes.values()][LISTED:])
    return "; ".join([*sentences[:LISTED], *([f"and {rest} more"] if rest else [])])
