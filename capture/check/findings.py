"""Results of `rig check`, as records that dump to JSON."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from imaging.choices import Subject
from imaging.optics.exposure import Exposure
from imaging.session.records import ImageKind

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
    "label",
    "focus",
    "motion",
    "dark",
    "flat",
    "clipped",
]


class FindingModel(BaseModel):
    """Base of the reports: frozen, strict about fields."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Problem(FindingModel):
    """Something that is wrong: `message` is one sentence that ends with how to fix it.

    file: relative to the session; "" if it is about no file.
    """

    kind: ProblemKind
    file: str = ""
    camera: str | None = None
    frame: int | None = None
    step: int | None = None
    message: str


class Exposed(FindingModel):
    """Statistics of one exposure of one camera, over all frames.

    clipped: mean share of the samples of red, green and blue at the top of the range, 0..1.
    black: mean share of all samples at or below the black level. max_skew: seconds.
    """

    camera: str
    exposure: Exposure | None
    shots: int
    clipped: tuple[float, float, float]
    black: float
    max_skew: float | None


class ShotLook(FindingModel):
    """Examination of one sound shot's picture.

    estimated: the exposure from overlapping pixels of its bracket; None where the label is more accurate.
    off: stops of the estimate over the label's exact value (1/60 s: 1/64 s); estimate_error: standard error,
    stops. clipped, black: as in Exposed. sharpness: fine over coarse detail; relative_sharpness: over that of
    the rest of the bracket at the same pixels. shift: pixels against the next longer exposure of the bracket,
    shift_error: standard error; moved: share of the common area that differs.
    """

    kind: Subject
    picture: ImageKind
    file: str
    camera: str
    frame: int
    step: int
    width: int
    height: int
    requested: Exposure | None
    reported: Exposure | None
    estimated: Exposure | None = None
    off: float | None = None
    estimate_error: float | None = None
    clipped: tuple[float, float, float]
    black: float
    lit: float
    sharpness: float | None = None
    relative_sharpness: float | None = None
    shift: tuple[float, float] | None = None
    shift_error: float | None = None
    moved: float | None = None


class StepSkew(FindingModel):
    """Seconds between the first and the last shutter of one bracket step."""

    kind: Subject
    plan: str
    frame: int
    step: int
    skew: float


class CheckReport(FindingModel):
    """Report of `check`. planned: shots of all plans; shots: records; sound: files that are proven.

    problems: faults of files and records. warnings: sound pictures with something that a photographer should
    know. untimed: cameras whose skew is unknown, and untimed_bound: its upper bound, s, None if unknown.
    thumbnails: JPEG by file, and sources: the user's names of imported files; not written with the rest.
    """

    session: str
    planned: int
    shots: int
    sound: int
    exposures: tuple[Exposed, ...]
    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...] = ()
    looks: tuple[ShotLook, ...] = ()
    skews: tuple[StepSkew, ...] = ()
    untimed: tuple[str, ...] = ()
    untimed_bound: float | None = None
    thumbnails: dict[str, bytes] = Field(default_factory=dict, exclude=True, repr=False)
    sources: dict[str, str] = Field(default_factory=dict, exclude=True, repr=False)

    @property
    def ok(self) -> bool:
        """True if all recorded files exist, unchanged."""
        return not self.problems
