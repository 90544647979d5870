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
        mend: What makes the rest possible, as the disk that ended the run needs it; "" if nothing does.
        problems: A sentence for each camera whose shots deviate from their requests, and for each step whose
            shutters opened too far apart.
        unknown: Facts that no driver could learn, a sentence each.
        run: Forecast and outcome of this run; None if it took no shot.
    """

    session: Path
    planned: int
    taken: int
    earlier: int
    missing: tuple[str, ...] = ()
    mend: str = ""
    problems: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    run: RunRecord | None = None

    def require_complete(self) -> None:
        """PartialError that lists what is missing, if anything is."""
        if self.missing:
            first = f"{self.mend}, then " if self.mend else ""
            raise PartialError(
                f"{self.session}: {len(self.missing)} of {self.planned} shots are missing "
                f"({_listed(self.missing)}): {first}repeat the command with --resume to take them."
            )


def _listed(missing: Sequence[str]) -> str:
    """A sentence of each cause, and how many more there are."""
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


def span(seconds: float) -> str:
    """Time between two moments in words: `20 ms`, `3.15 s`, `1250 s`."""
    if seconds < 0.9995:  # from which on three digits would be 1000
        return f"{1000 * seconds:.3g} ms"
    return f"{seconds:.3g} s" if seconds < 999.5 else f"{seconds:.0f} s"
