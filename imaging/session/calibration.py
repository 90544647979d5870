"""`calibration/calibration.json`: what `rig calibrate` found, for every later stage to read."""

import shlex
from collections.abc import Collection
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from imaging.arguments import checked
from imaging.errors import InputError
from imaging.files import store
from imaging.lens import Lens
from imaging.mosaic import Matrix
from imaging.noise import SensorNoise
from imaging.pose import Pose
from imaging.record import Record, parse
from imaging.sensor import SensorCalibration
from imaging.session.coordinates import CoordinateSystem
from imaging.session.luminance import LuminanceScale
from imaging.session.records import Board, Name, Rung
from imaging.session.view_id import ViewId, ViewText


class LensError(Record):
    """Standard errors of the terms of a lens, px of its image where terms are in px; 0 of those it lacks."""

    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    focal_untold: bool = False
    """Whether the scene does not tell the focal length, so that its error is that of what is used instead."""
    projection: tuple[tuple[float | None, ...], ...] = ()
    """[rows][columns], px: how far a far point's projection may be off, at places evenly spread over the
    image, when the camera's own turn is not counted; None: not known at all."""

    def projection_map(self) -> npt.NDArray[np.float64]:
        """`projection` as an array [rows, columns], inf where it is not known."""
        return np.array([[np.inf if one is None else one for one in row] for row in self.projection])


class PoseError(Record):
    """Standard errors of a pose: about the worst axis, degrees, and along the worst, in the record's unit."""

    rotation: float
    translation: float


class BoardPlace(Record):
    """Where a board stood at a frame, seen from the first of the cameras that saw it together; metres."""

    frame: int = Field(ge=0)
    cameras: tuple[Name, ...] = Field(min_length=1)
    cam_from_board: Pose


class BoardEvidence(Record):
    """What views of a board gave: how many, and how well the corners fit, px."""

    board: Board
    printed: str
    frames: int
    views: int
    corners: int
    rms_px: float
    outliers: tuple[str, ...] = ()
    """A sentence for each view or camera that fits much worse than the others."""
    places: tuple[BoardPlace, ...] = ()
    """By frame; cameras that never saw it together have places of their own."""


class Response(Record):
    """How a camera turns exposure into code values.

    linear: RAW, or linear EXR. srgb: assumed, not measured. curve: `ln E + ln k` at each of
    `codes` (0..1), per channel, up to one constant that the rig shares.
    """

    kind: Literal["linear", "srgb", "curve"]
    codes: tuple[float, ...] = ()
    log_exposure: tuple[tuple[float, ...], ...] = ()
    """[3][len(codes)], natural log, rising."""
    sigma: tuple[tuple[float, ...], ...] = ()
    """[3][len(codes)], standard error of log_exposure; 0 where the scale is fixed; empty: not known."""
    valid: tuple[float, float] = (0.0, 1.0)
    """Code values between which the curve was measured; beyond it is extrapolated."""
    evidence: str
    residual: float | None = None
    """Median held-out disagreement of overlapping exposures, natural log."""


class ChartPatch(Record):
    """One patch of a colour chart, as the calibrated camera sees it and as it was published.

    Both linear Rec.709 under D65, a perfect diffuser being (1, 1, 1).
    """

    number: int = Field(ge=1)
    """On the chart, row by row."""
    measured: tuple[float, float, float]
    published: tuple[float, float, float]
    delta_e: float
    """CIEDE2000 under a fit that did not see this patch."""


class ChartEvidence(Record):
    """The view of a colour chart that a camera's colour comes from; delta E as of the patches."""

    frame: int = Field(ge=0)
    chart: str
    patches: tuple[ChartPatch, ...]
    delta_e_mean: float
    delta_e_p95: float
    delta_e_max: float
    delta_e_files: float | None = None
    """The mean with the matrix of the camera's files and the chart's white; None: they name none."""
    corners: tuple[tuple[float, float], ...] = ()
    """Of the chart in the image, px: of patches 1, 6, 24 and 19."""


class CameraCalibration(Record):
    """One camera: lens, place in the rig, sensor, response and vignetting."""

    name: Name
    serial: str
    lens: Lens | None = None
    lens_error: LensError | None = None
    cam_from_rig: Pose | None = None
    cam_from_rig_error: PoseError | None = None
    noise: SensorNoise | None = None
    """At the ISO of the shots; None: not known."""
    sensors: tuple[SensorCalibration, ...] = ()
    """What was measured of the sensor, once for each ISO; empty: all is as the files say."""
    response: Response
    vignetting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """`V(r) = 1 + a r^2 + b r^4 + c r^6`, r = 1 at the corner of the image from its centre."""
    gain: float = Field(default=1.0, gt=0)
    """Sensitivity relative to the rig's mean, divided out by later stages."""
    camera_from_rec709: tuple[tuple[float, float, float], ...] | None = None
    """Linear Rec.709 to camera (RAW only), a row of three for R, G, B and W, green summing to 1; None: not
    known. A row of W that no file states is the sum of the others; mono has none, and sees grey."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Sensitivities of red, green and blue relative to the rig and to green, as shared scene points tell
    them: part of `camera_from_rec709` already, kept to be known when that is measured anew."""
    white_balance_error: tuple[float, float, float] | None = None
    """Their standard errors, relative; None: not measured."""
    chart: ChartEvidence | None = None
    """None: this camera's colour comes from its files, or from the chart that another of its model saw."""


class ViewCalibration(Record):
    """One registered image: a camera at a frame."""

    camera: Name
    frame: int = Field(ge=0)
    cam_from_world: Pose
    points: int
    """Scene points seen by it."""
    error: PoseError | None = None
    exposure: float = Field(default=1.0, gt=0)
    """Of a photograph: factor on the exposure that its label tells, in the scales of its shots already."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Of a photograph: factors on red, green and blue light that it was developed with, relative to green and
    to the mean of all photographs."""
    by_rig: bool = False
    """Nothing was recognised in its picture, or what was is contradicted: the other cameras of its rig alone
    tell where it was."""

    @property
    def id(self) -> ViewId:
        """Which view it is."""
        return ViewId(self.frame, self.camera)


COLOUR = "camera_colour"
"""The rung that says where the colours of RAW cameras come from."""
MOTION = "rig_motion"
"""The rung that says how cameras were tied together that see nothing in common, or why they could not be."""
FOCAL_UNTOLD = "lens_focal_untold"
"""The rung that says whether the photographs tell the focal length of a lens, and what is used where not."""
RAW_CURVE = "raw_curve"
"""The rung that names cameras which bent their RAW before they sent it."""
_DOUBTS = frozenset(
    {"pose_lit_differently", "pose_moving", "pose_unconfirmed", "pose_undecided", FOCAL_UNTOLD, RAW_CURVE}
)


class CalibrationRecord(Record):
    """All that was found out about a session's cameras."""

    schema_version: Literal[1] = 1
    created: datetime
    versions: dict[str, str]
    shots_sha256: str
    """Of shots.jsonl as it was calibrated; another value later means stale."""
    cameras: tuple[CameraCalibration, ...]
    views: tuple[ViewCalibration, ...]
    unregistered: tuple[ViewText, ...] = ()
    """Views that were looked at for their poses and got none."""
    contradicted: tuple[ViewText, ...] = ()
    """Views that match others, which contradict each other about where these stand: nothing in their own
    pictures placed them."""
    unit: Literal["relative", "m"] = "relative"
    """Of all lengths: metres where a board, a known distance, surveyed points or GPS gave the scale."""
    coordinates: CoordinateSystem | None = None
    """What poses and points are in; None: coordinates of the scene's own."""
    board: BoardEvidence | None = None
    points: int = 0
    reprojection_px: float | None = None
    """Mean over observations."""
    exposure_scale: dict[str, Annotated[float, Field(gt=0)]]
    """Exposure scale k of each shot's file, s; estimated from overlaps where they allow it."""
    luminance: LuminanceScale | None = None
    """What the light is in cd/m2; None: it is relative."""
    rungs: tuple[Rung, ...] = ()

    @property
    def coordinate_note(self) -> str:
        """What poses and points are in, in one line of ASCII, as headers of files have it."""
        if self.coordinates is not None:
            return f"{self.coordinates.note}, {'m' if self.unit == 'm' else 'without a unit'}"
        return "the scene's own, m" if self.unit == "m" else "the scene's own, without a unit"

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why poses may be wrong that no view contradicts, and light that is bent."""
        return tuple(rung.reason for rung in self.rungs if rung.taken and rung.name in _DOUBTS)

    def camera(self, name: str) -> CameraCalibration:
        """The calibration of a camera of the session; InputError if it was not calibrated."""
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise InputError(f"calibration.json has no camera {name!r}: run `rig calibrate` again.")


def colour_rung(matrices: Collection[Matrix | None]) -> Rung:
    """Where the colours of RAW cameras come from that no chart told; matrices: what the files of each say."""
    known = sum(matrix is not None for matrix in matrices)
    reason = f"matrix from XYZ as the files of {known} of {len(matrices)} cameras say; not measured"
    if not known:
        reason = (
            "the colour of the cameras is not known, so that their light stays camera RGB: their files name "
            "no matrix; a chart would tell it"
        )
    return Rung(name=COLOUR, taken=known > 0, reason=reason)


@checked
def read_calibration(session: str | PathLike[str]) -> CalibrationRecord:
    """The calibration of a session folder; InputError if there is none or it is damaged."""
    session = Path(session)
    path = session / "calibration" / "calibration.json"
    if not path.is_file():
        raise InputError(
            f"{session} is not calibrated: run `{shlex.join(['rig', 'calibrate', str(session)])}` first."
        )
    return parse(CalibrationRecord, store.read_json(path), path)


def is_stale(session: Path, record: CalibrationRecord) -> bool:
    """Return whether shots were added to the session folder, or taken away, after it was calibrated."""
    return store.sha256(session / "shots.jsonl") != record.shots_sha256


def calibration_is_current(session: Path) -> bool:
    """Return whether a session folder has a calibration with poses, made from the shots that it has now."""
    if not all((session / name).is_file() for name in ("calibration/calibration.json", "shots.jsonl")):
        return False
    record = read_calibration(session)
    return bool(record.views) and not is_stale(session, record)
