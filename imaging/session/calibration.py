"""`calibration/calibration.json`: what `rig calibrate` found, for every later stage to read."""

import shlex
from collections.abc import Collection
from datetime import datetime
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from imaging.arguments import checked
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files import store
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose
from imaging.record import Record, parse
from imaging.sensor.mosaic import Matrix
from imaging.sensor.noise import SensorNoise
from imaging.sensor.sensor_calibration import SensorCalibration
from imaging.session.calibration_evidence import BoardEvidence, ChartEvidence
from imaging.session.coordinates import CoordinateSystem
from imaging.session.luminance import LuminanceScale
from imaging.session.records import Name, Rung
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
    """True if the scene does not determine the focal length, so that its error is that of the value used
    instead.
    """
    projection: tuple[tuple[float | None, ...], ...] = ()
    """[rows][columns], px: error of a far point's projection at places evenly spread over the image, the
    camera's own rotation excluded; None if unknown.
    """

    def projection_map(self) -> Array:
        """`projection` as an array [rows, columns], inf where it is not known."""
        return np.array([[np.inf if one is None else one for one in row] for row in self.projection])


class PoseError(Record):
    """Standard errors of a pose: about the worst axis, degrees, and along the worst, in the record's unit."""

    rotation: float
    translation: float


class Response(Record):
    """Response of a camera: code values as a function of exposure.

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


class CameraCalibration(Record):
    """One camera: lens, place in the rig, sensor, response and vignetting."""

    name: Name
    serial: str
    lens: Lens | None = None
    lens_error: LensError | None = None
    cam_from_rig: Pose | None = None
    cam_from_rig_error: PoseError | None = None
    noise: SensorNoise | None = None
    """Noise model at the ISO of the shots; None if unknown."""
    sensors: tuple[SensorCalibration, ...] = ()
    """Measurements of the sensor, one for each ISO; empty: all is as the files state."""
    response: Response
    vignetting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """`V(r) = 1 + a r^2 + b r^4 + c r^6`, r = 1 at the corner of the image from its centre."""
    gain: float = Field(default=1.0, gt=0)
    """Sensitivity relative to the rig's mean, divided out by later stages."""
    camera_from_rec709: tuple[tuple[float, float, float], ...] | None = None
    """Linear Rec.709 to camera (RAW only), a row of three for R, G, B and W, green summing to 1; None if
    unknown. A row of W that no file states is the sum of the others; mono has none, and sees grey.
    """
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Sensitivities of red, green and blue relative to the rig and to green, measured on shared scene points:
    part of `camera_from_rec709` already, stored so that a new measurement of that keeps it.
    """
    white_balance_error: tuple[float, float, float] | None = None
    """Their standard errors, relative; None if unmeasured."""
    chart: ChartEvidence | None = None
    """Evidence of the colour chart; None if this camera's colour comes from its files, or from a chart seen
    by another of its model.
    """


StatedPart = Literal["exposure", "white_balance"]
"""Settings of photographs that files may state as constant."""


class ViewCalibration(Record):
    """One registered image: a camera at a frame."""

    camera: Name
    frame: int = Field(ge=0)
    cam_from_world: Pose
    points: int
    """Scene points seen by it."""
    error: PoseError | None = None
    exposure: float = Field(default=1.0, gt=0)
    """Factor on the labelled exposure of a photograph, already in the scales of its shots."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factors on red, green and blue light with which a photograph was developed, relative to green and to
    the mean of all photographs.
    """
    exposure_asked: float | None = Field(default=None, gt=0)
    """Factor on the exposure that scene points ask for although the files state one for all; not applied."""
    white_balance_asked: tuple[float, float, float] | None = None
    """Factors on red, green and blue light likewise, of a geometric mean of 1."""
    by_rig: bool = False
    """True if the pose comes from the rig's other cameras alone: nothing was recognised in this picture, or
    what was is contradicted.
    """

    @property
    def id(self) -> ViewId:
        """Identity of the view."""
        return ViewId(self.frame, self.camera)

    def overruled(self, parts: Collection[StatedPart]) -> "ViewCalibration":
        """The same with the factors of these parts that scene points ask for applied."""
        exposure = self.exposure_asked if "exposure" in parts else None
        factors = self.white_balance_asked if "white_balance" in parts else None
        red, green, blue = factors or (1.0, 1.0, 1.0)
        before = self.white_balance
        return self.model_copy(
            update={
                "exposure": self.exposure * (exposure or 1.0) * green,
                "white_balance": (before[0] * red / green, before[1], before[2] * blue / green),
                "exposure_asked": None if "exposure" in parts else self.exposure_asked,
                "white_balance_asked": None if "white_balance" in parts else self.white_balance_asked,
            }
        )


COLOUR = "camera_colour"
"""The rung that says where the colours of RAW cameras come from."""
MOTION = "rig_motion"
"""The rung that says how cameras were tied together that see nothing in common, or why they could not be."""
FOCAL_UNDETERMINED = "lens_focal_undetermined"
"""Name of the rung that records whether the photographs determine a lens's focal length, and what is used
where not.
"""
POSE_HANGING = "pose_hanging"
"""Name of the rung that names views which one pair holds on the others."""
POSE_LOOSE = "pose_loose"
"""Name of the rung that names views whose turns few points determine."""
TURNED = "pose_turned"
"""The rung of views from one place, which have turns and no depth."""
RAW_CURVE = "raw_curve"
"""The rung that names cameras which bent their RAW before they sent it."""
_DOUBTS = frozenset(
    {
        "pose_lit_differently",
        "pose_moving",
        "pose_unconfirmed",
        POSE_HANGING,
        POSE_LOOSE,
        "pose_undecided",
        FOCAL_UNDETERMINED,
        TURNED,
        RAW_CURVE,
    }
)


class CalibrationRecord(Record):
    """All that was found out about a session's cameras."""

    schema_version: Literal[1] = 1
    created: datetime
    versions: dict[str, str]
    shots_sha256: str
    """Hash of shots.jsonl as it was calibrated; another value later means stale."""
    cameras: tuple[CameraCalibration, ...]
    views: tuple[ViewCalibration, ...]
    unregistered: tuple[ViewText, ...] = ()
    """Views that could not be registered."""
    contradicted: tuple[ViewText, ...] = ()
    """Views that match others, which contradict each other about where these stand: nothing in their own
    pictures placed them."""
    unit: Literal["relative", "m"] = "relative"
    """Unit of all lengths: metres where a board, a known distance, surveyed points or GPS gave the scale."""
    coordinates: CoordinateSystem | None = None
    """Coordinate system of poses and points; None: coordinates of the scene's own."""
    board: BoardEvidence | None = None
    points: int = 0
    reprojection_px: float | None = None
    """Mean over observations."""
    exposure_scale: dict[str, Annotated[float, Field(gt=0)]]
    """Exposure scale k of each shot's file, s; estimated from overlaps where they allow it."""
    luminance: LuminanceScale | None = None
    """Scale of the light in cd/m2; None if it is relative."""
    exposure_factor: float | None = Field(default=None, gt=0)
    """Factor on light that shows the session as middle grey, of plates, renders and the viewer; None: it is
    measured where it is needed (`imaging.plates.middle_grey`).
    """
    rungs: tuple[Rung, ...] = ()

    @property
    def coordinate_note(self) -> str:
        """Coordinate system of poses and points in one line of ASCII, for headers of files."""
        if self.coordinates is not None:
            return f"{self.coordinates.note}, {'m' if self.unit == 'm' else 'without a unit'}"
        return "the scene's own, m" if self.unit == "m" else "the scene's own, without a unit"

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons why poses may be wrong that no view contradicts, and why light may be bent."""
        return tuple(rung.reason for rung in self.rungs if rung.taken and rung.name in _DOUBTS)

    @property
    def turned(self) -> bool:
        """True if all views were taken from one place, and have turns alone."""
        return any(rung.taken and rung.name == TURNED for rung in self.rungs)

    def camera(self, name: str) -> CameraCalibration:
        """The calibration of a camera of the session; InputError if it was not calibrated."""
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise InputError(f"calibration.json has no camera {name!r}: run `rig calibrate` again.")


def colour_rung(matrices: Collection[Matrix | None]) -> Rung:
    """Rung on the colour source of RAW cameras without a chart; matrices: those of each camera's files."""
    known = sum(matrix is not None for matrix in matrices)
    reason = f"matrix from XYZ as the files of {known} of {len(matrices)} cameras say; not measured"
    if not known:
        reason = (
            "the colour of the cameras is not known, so that their light stays camera RGB: their files name "
            "no matrix; a colour chart measures it"
        )
    return Rung(name=COLOUR, taken=known > 0, reason=reason)


@checked
def read_calibration(session: str | PathLike[str]) -> CalibrationRecord:
    """Read the calibration of a session.

    Args:
        session: Session, or its folder.

    Returns:
        The record in calibration.json.

    Raises:
        InputError: The calibration is missing or damaged.
    """
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
