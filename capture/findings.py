"""What `rig check` reports, as records that dump to JSON."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from imaging.exposure import Exposure

ProblemKind = Literal[
    "index",
    "absent",
    "altered",
    "torn",
    "size",
    "exposure",
    "missing",
    "duplicate",
    "stray",
    "leftover",
    "skew",
]


class Model(BaseModel):
    """Base of the reports: frozen, strict about fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Problem(Model):
    """Something that is wrong: `message` is one sentence that ends with the mend.

    file: relative to the session; "" if it is about no file.
    """

    kind: ProblemKind
    file: str = ""
    camera: str | None = None
    frame: int | None = None
    step: int | None = None
    message: str


class Exposed(Model):
    """How one exposure of one camera came out, over all frames.

    clipped: mean share of the samples of red, green and blue at the top of the range, 0..1.
    black: mean share of all samples at or below the black level. max_skew: seconds.
    """

    camera: str
    exposure: Exposure | None
    shots: int
    clipped: tuple[float, float, float]
    black: float
    max_skew: float | None


class CheckReport(Model):
    """What `check` found. planned: shots of all plans; shots: records; sound: files that are proven."""

    session: str
    planned: int
    shots: int
    sound: int
    exposures: tuple[Exposed, ...]
    problems: tuple[Problem, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.problems
