"""One case at the end of what a stage is asked, and how far from right it came out."""

import math
from dataclasses import dataclass
from typing import Any, Literal, Self


@dataclass(frozen=True)
class StressCase:
    """Worst error of a stress test, and its tolerance.

    error: relative to the number itself, unless `what` says otherwise; None if not finite.
    """

    part: Literal["splatting", "calibration", "methods"]
    case: str
    what: str
    """The numbers that were tested."""
    against: Literal["float64", "truth"]
    error: float | None
    limit: float

    @classmethod
    def of(
        cls,
        part: Literal["splatting", "calibration", "methods"],
        case: str,
        what: str,
        against: Literal["float64", "truth"],
        error: float,
        limit: float,
    ) -> Self:
        """Make a case from a measured error; a non-finite error becomes None."""
        return cls(part, case, what, against, error if math.isfinite(error) else None, limit)

    @property
    def ok(self) -> bool:
        """True within the tolerance."""
        return self.error is not None and self.error <= self.limit

    def record(self) -> dict[str, Any]:
        """Record for JSON."""
        return vars(self) | {"ok": self.ok}
