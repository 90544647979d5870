"""One case at the end of what a stage is asked, and how far from right it came out."""

import math
from dataclasses import dataclass
from typing import Any, Literal, Self


@dataclass(frozen=True)
class StressCase:
    """How wrong the worst number of a case is, and how wrong it may be.

    error: relative to the number itself, unless `what` says otherwise; None: something is not finite.
    """

    part: Literal["splatting", "calibration", "methods"]
    case: str
    what: str
    """Which numbers."""
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
        """As it is measured: an error that is no finite number is None."""
        return cls(part, case, what, against, error if math.isfinite(error) else None, limit)

    @property
    def ok(self) -> bool:
        """Whether it is within the limit."""
        return self.error is not None and self.error <= self.limit

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return vars(self) | {"ok": self.ok}
