"""What `rig check` reports, as records that dump to JSON."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from imaging.exposure import Exposure
from imaging.session.records import ImageKind, Subject

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


class ShotLook(FindingModel):
    """What the picture of one sound shot shows.

    estimated: what the exposure was, from overlapping pixels of its bracket; None where those tell less
    than the label. off: stops of the estimate over what the label stands for (1/60 s: 1/64 s);
    estimate_error: standard error, stops. clipped, black: as in Exposed. sharpness: fine over coarse
    detail; relative_sharpness: over that of the rest of the bracket at the same pixels. shift: pixels
    against the next longer exposure of the bracket, shift_error: standard error; moved: share of what both
    show that is something else in one.
    """

    kind: Subject
    picture: ImageKind
    file: str
    camera: str
    frame: int
    step: int
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
    """What `check` found. planned: shots of all plans; shots: records; sound: files that are proven.

    problems: files and records that are not as they should be. warnings: pictures that are whole, and
    show something that a photographer would want to know. untimed: cameras whose skew is unknown,
    and untimed_bound: the most that it may be, s, None where nothing tells.
    thumbnails: JPEG by file, not written with the
    rest.
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

    @property
    def ok(self) -> bool:
        """Whether all that was recorded is there, and as it was recorded."""
        return not self.problems
