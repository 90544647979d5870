"""The records of a session: `session.json`, `plans.jsonl`, `shots.jsonl`, `runs.jsonl`, `split.json`.

A *shot* is one exposure by one camera; a *bracket* the shots of one camera at one frame; a *frame*
one instant of the whole rig. Unknown fields and unknown schema versions are errors.
"""

import re
from datetime import datetime
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
    field_validator,
    model_validator,
)

from imaging.arrays import Array
from imaging.choices import Subject
from imaging.optics.exposure import Exposure
from imaging.record import Record
from imaging.session.view_id import ViewId


def _plain_name(value: str) -> str:
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.-]*", value) or ".." in value:
        raise ValueError("a name is made of letters, digits, '_', '-' and '.'")
    return value


Name = Annotated[str, AfterValidator(_plain_name)]


class Band(Record):
    """A filter before a mono camera, and the light that it lets through."""

    name: Name
    wavelength_nm: float | None = Field(default=None, gt=0)
    """Centre wavelength; None if unknown."""
    bandwidth_nm: float | None = Field(default=None, gt=0)
    """Full width at half maximum; None if unknown."""


MOST_BANDS = 16
"""Maximum of bands in one session: as many channels as a scene may have."""

ImageKind = Literal["raw", "ldr", "hdr"]
"""raw: mosaics; ldr: display-referred 8 or 16 bit; hdr: linear EXR."""


class CameraRecord(Record):
    """A camera of a session; `serial` is its identity, `name` its place in file names."""

    name: Name
    serial: str
    make: str = ""
    model: str = ""
    kind: ImageKind
    rig: str | None = None
    """Cameras that name the same rig are rigidly mounted to each other; None for a camera of its own."""
    position: tuple[float, float, float] | None = None
    """Measured position in its rig, m, in any axes: between two cameras it gives the scale."""
    band: Name | None = None
    """Filter that stays on it, one of the session's bands; None without one, or where it changes."""
    focal_length: float | None = Field(default=None, gt=0)
    """Focal length of its lens as the rig file states it, mm."""
    pixel_pitch: float | None = Field(default=None, gt=0)
    """Distance between its photosites as the rig file states it, um."""


class SessionRecord(Record):
    """`session.json`: identity, written once."""

    schema_version: Literal[1] = 1
    name: str
    created: datetime
    origin: str
    """'sim:NAME' (with the seed), 'import', or the rig file."""
    seed: int | None = None
    cameras: tuple[CameraRecord, ...]
    bands: tuple[Band, ...] = ()
    """The filters that mono cameras look through, of which every shot of the scene names one; empty for
    Rec.709 light.
    """

    @field_validator("bands")
    @classmethod
    def _distinct_bands(cls, bands: tuple[Band, ...]) -> tuple[Band, ...]:
        if len({band.name for band in bands}) < len(bands):
            raise ValueError("two bands have the same name")
        if len(bands) > MOST_BANDS:
            raise ValueError(f"there are {len(bands)} bands, and a scene has at most {MOST_BANDS}")
        return bands

    @field_validator("cameras")
    @classmethod
    def _distinct(cls, cameras: tuple[CameraRecord, ...]) -> tuple[CameraRecord, ...]:
        if len({camera.name for camera in cameras}) < len(cameras):
            raise ValueError("two cameras have the same name")
        return cameras


class Board(Record):
    """A ChArUco board as it was printed: a chessboard whose white squares hold ArUco markers.

    Board axes are OpenCV's: origin at the outer corner of the first square, x along its rows, y down, z into
    the board.
    """

    columns: int = Field(ge=3, le=100)
    """Squares along x."""
    rows: int = Field(ge=3, le=100)
    """Squares along y."""
    square: float = Field(gt=0)
    """Side of a square, m."""
    marker: float = Field(gt=0)
    """Side of a marker, m."""
    dictionary: str = "DICT_4X4_50"
    """OpenCV's name of the markers' dictionary."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        import cv2  # only boards need it, and it takes a while to load

        if not (self.dictionary.startswith("DICT_") and hasattr(cv2.aruco, self.dictionary)):
            raise ValueError(f"OpenCV has no dictionary {self.dictionary!r}; DICT_4X4_50 is one")
        if self.marker >= self.square:
            raise ValueError("a marker has to be smaller than a square")
        if (self.columns - 1) * (self.rows - 1) < 6:  # what `calib.boards` asks of a view
            raise ValueError("a board needs 6 inner corners or more, as one of 4 x 3 squares has")
        needed = self.columns * self.rows // 2
        has = len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary)).bytesList)
        if needed > has:
            raise ValueError(f"the board has {needed} markers and {self.dictionary} only {has}")
        return self

    def corners(self) -> Array:
        """The inner corners by id, m, float64 [(columns - 1) (rows - 1), 3], z = 0."""
        x, y = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return np.asarray(self.square * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))


class PlanRecord(Record):
    """One line of `plans.jsonl`: what a run was to shoot, and why."""

    plan: Name
    kind: Subject
    created: datetime
    bracket: tuple[Exposure | None, ...]
    """Exposures of each camera at each frame, in order; None if unknown (imported without EXIF)."""
    frames: tuple[int, ...]
    cameras: tuple[Name, ...]
    reason: str
    bands: tuple[Name, ...] = ()
    """Band of each exposure of the bracket, for a filter wheel; empty: every camera keeps its filter."""
    asked: str | None = None
    """The bracket as it was requested: a continuation of the plan requests the same."""
    board: Board | None = None
    """The board shown, in a plan of kind board; None: `rig calibrate` has to be given it."""
    tolerance: float | None = Field(default=None, gt=0)
    """Largest offset of the shutters of a step, seconds, that still counts as together; None if the rig's
    file gives none.
    """

    def band(self, step: int, camera: CameraRecord) -> str | None:
        """The filter that a camera looks through at a step."""
        return self.bands[step] if self.bands else camera.band

    @model_validator(mode="after")
    def _a_band_each(self) -> Self:
        if self.bands and len(self.bands) != len(self.bracket):
            raise ValueError("there are not as many bands as exposures")
        return self


class ShotRecord(Record):
    """One line of `shots.jsonl`: one exposure that is on the disk, whole."""

    kind: Subject
    plan: Name
    camera: Name
    frame: int = Field(ge=0)
    step: int = Field(ge=0)
    """Index in the bracket."""
    file: str
    """Path relative to the session folder."""
    sha256: str
    developed: str | None = None
    """The photograph that the camera made of the same exposure beside its RAW file, relative to the session:
    kept and hashed, and read by nothing."""
    developed_sha256: str | None = None
    shifted: tuple[str, ...] = ()
    """The files that `file` was made of, relative to the session: the exposures of a pixel shift, or the
    photograph that was turned to lie as others of its camera. Kept as they came and hashed, and read by
    nothing."""
    shifted_sha256: tuple[str, ...] = ()
    requested: Exposure | None = None
    reported: Exposure | None = None
    estimated: Exposure | None = None
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    captured_at: datetime | None = None
    skew: float | None = None
    """Seconds from the first shutter of the same frame and step to this one, as cameras stamp their frames;
    None where this one, or every other, does not."""
    skew_bound: float | None = Field(default=None, ge=0)
    """Upper bound of an unknown `skew`: from the first trigger of its frame and step, or the first shutter
    known to have opened, to the moment by which this one had.
    """
    trigger_delay: float | None = Field(default=None, ge=0)
    """Delay of this camera's trigger after the first one of the same frame and step, seconds; the delay of
    the shutter itself is `skew`.
    """
    retries: int = Field(default=0, ge=0)
    source: str | None = None
    """Path of the original, for imports."""
    mask: str | None = None
    """A picture of the same size, relative to the session folder, black where the shot is to be ignored."""
    mask_sha256: str | None = None
    """Hash of the mask; None without one, or in a session that does not record it."""
    depth: str | None = None
    """A map of the depth along the camera's axis at the same moment, relative to the session folder."""
    depth_sha256: str | None = None
    depth_unit: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Length of 1 in the depth map, in units of the world."""
    band: Name | None = None
    """Filter through which it was taken, one of the session's bands; None without bands."""
    node: Name | None = None
    """The host that its camera is connected to, where that is not the one that led the capture."""
    clock_offset: float | None = None
    """Lead of that host's clock over the leader's, s: the monotonic clocks, which are never set."""
    clock_error: float | None = Field(default=None, ge=0)
    """Error bound of the clock offset, s, and of `skew` against the cameras of other hosts."""

    @property
    def identity(self) -> tuple[str, str, int, int]:
        """Identity of a shot that is taken again: plan, camera, frame, step."""
        return (self.plan, self.camera, self.frame, self.step)

    @property
    def view(self) -> ViewId:
        """The view that it is a shot of."""
        return ViewId(self.frame, self.camera)

    @property
    def exposure(self) -> Exposure | None:
        """The best known exposure: estimated, else reported, else requested."""
        return self.estimated or self.reported or self.requested


class RunRecord(Record):
    """One line of `runs.jsonl`: a run that took shots of a plan, as it was forecast and as it came out.

    Seconds are those of shooting, without the time in which a person moved things.
    """

    plan: Name
    ended: datetime
    shots: int = Field(ge=1)
    """Shots that it took."""
    forecast_shots: int = Field(ge=0)
    """Shots that it was to take."""
    basis: str
    """Origin of the forecast's seconds."""
    forecast_seconds: float = Field(ge=0)
    seconds: float = Field(ge=0)
    forecast_bytes: int | None = Field(default=None, ge=0)
    """None: no camera stated its size before the first picture."""
    bytes: int = Field(ge=0)
    """Bytes of the files of the shots."""
    beyond: float = Field(ge=0)
    """Seconds beyond the exposure time that a step of the bracket took, on average."""


class SplitRecord(Record):
    """`split.json` of a data set that defines training and test views; other sessions have none.

    Files of shots, relative to the session. A view is tested or trained on, never both; shots in neither are
    ignored by training and test.
    """

    schema_version: Literal[1] = 1
    reason: str
    """Origin of the split."""
    train: tuple[str, ...]
    test: tuple[str, ...]


ONE_OF_SEVERAL = 2.0
"""Standard errors to gain where several parts are tried on the same evidence: by one, a part in six that
nothing needs would be taken by chance."""


class Rung(Record):
    """One step of a ladder: a part of a model that was considered, and what it would have bought."""

    name: str
    taken: bool
    gain: float | None = None
    """Held-out gain, in the unit named by `unit`; None when it was decided without a trial."""
    standard_error: float | None = None
    unit: str = ""
    reason: str
    parameters: int | None = None
    """Number of parameters that it adds to the model; None if not counted."""

    @classmethod
    def judged(
        cls,
        name: str,
        gain: float,
        standard_error: float,
        unit: str,
        reason: str,
        parameters: int | None = None,
        errors: float = 1.0,
    ) -> Self:
        """True if taken only when the held-out gain is above the required number of standard errors."""
        return cls(
            name=name,
            taken=gain > errors * standard_error,
            gain=gain,
            standard_error=standard_error,
            unit=unit,
            reason=reason,
            parameters=parameters,
        )
