"""Boards and colour charts in calibration.json: what was measured with them, and how well it fits."""

from pydantic import Field

from imaging.optics.pose import Pose
from imaging.record import Record
from imaging.session.records import Board, Name


class BoardPlace(Record):
    """Pose of a board at a frame, relative to the first of the cameras that saw it together; metres."""

    frame: int = Field(ge=0)
    cameras: tuple[Name, ...] = Field(min_length=1)
    cam_from_board: Pose


class BoardEvidence(Record):
    """Views of a board: their number, and the corners' residuals, px."""

    board: Board
    printed: str
    frames: int
    views: int
    corners: int
    rms_px: float
    outliers: tuple[str, ...] = ()
    """A sentence for each view or camera that fits much worse than the others."""
    places: tuple[BoardPlace, ...] = ()
    """Poses by frame; cameras that never saw the board together have poses of their own."""


class ChartPatch(Record):
    """One patch of a colour chart, as the calibrated camera sees it and as it was published.

    Both linear Rec.709 under D65, a perfect diffuser being (1, 1, 1).
    """

    number: int = Field(ge=1)
    """Number on the chart, row by row."""
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
    """Mean colour difference with the matrix of the camera's files and the chart's white; None if they state
    none.
    """
    corners: tuple[tuple[float, float], ...] = ()
    """Corners of the chart in the image, px: of patches 1, 6, 24 and 19."""
