"""The section "What was calibrated": verdicts, what to shoot next, and topic by topic what was found."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

from imaging.errors import InputError
from imaging.files.colmap import SparsePoints, read_points
from imaging.optics.lens import Lens, fisheye_angle
from imaging.session.calibration import CalibrationRecord, CameraCalibration
from imaging.session.records import Rung
from imaging.session.session import Session
from rig.report.charts.calibration_charts import charts
from rig.report.charts.colour_chart import colour_topic
from rig.report.charts.lens_charts import lens_topic
from rig.report.charts.luminance_table import luminance_tables
from rig.report.charts.poses.pose_charts import pose_topic
from rig.report.charts.residuals import read_residuals
from rig.report.charts.sensor_charts import sensor_topic
from rig.report.charts.topic import Figure, Table, Topic
from rig.report.sections.next_shots import next_shots
from rig.report.sections.verdicts import Verdict, outliers, verdicts
from rig.terminal.text import counted, number, sentence

TOPICS = (
    ("Sensors", ("sensor_",)),
    ("Exposure and response", ("exposure_", "response")),
    ("Colour", ("camera_colour", "colour_", "chart_", "white_")),
    ("Light over the image and between cameras", ("vignetting", "camera_gain")),
    ("Scale of light", ("luminance",)),
    ("Lenses", ("lens_", "board_lens")),
    ("Coordinates", ("survey", "gps", "onto")),
    ("Rig and poses", ("rig_", "board_", "pose_")),
)
"""Groups of rungs, by the beginning of their name; the first that fits."""


@dataclass(frozen=True)
class RungRow:
    """One step of a ladder, as words."""

    name: str
    taken: bool
    gain: str
    tried: bool
    cost: str
    """Cost in parameters of the model; empty if not counted."""
    reason: str


@dataclass(frozen=True)
class RungGroup:
    """The steps of one topic."""

    title: str
    rows: tuple[RungRow, ...]


@dataclass(frozen=True)
class CalibrationSection:
    """Everything the section shows."""

    summary: str
    posed: bool
    registered: str
    verdicts: tuple[Verdict, ...]
    outliers: tuple[str, ...]
    next: tuple[str, ...]
    unregistered: tuple[str, ...]
    topics: tuple[Topic, ...]
    responses: tuple[tuple[str, str, str], ...]
    """Cameras, kind, evidence."""
    rungs: tuple[RungGroup, ...]
    stale: bool


def calibrated(session: Session, record: CalibrationRecord, stale: bool) -> CalibrationSection:
    """Turn a calibration into what the page shows."""
    colmap = session.folder / "calibration" / "colmap"
    points, residuals = _points(colmap), read_residuals(colmap)
    images = len(record.views) + len(record.unregistered)
    topics = (
        pose_topic(record, points, residuals),
        lens_topic(record, residuals),
        sensor_topic(record),
        colour_topic(record),
        _light(session, record),
    )
    return CalibrationSection(
        summary=_summary(session, record, images),
        posed=bool(record.views),
        registered=f"{len(record.views)} of {images}",
        verdicts=tuple(verdicts(record, residuals)),
        outliers=tuple(outliers(record, residuals)),
        next=tuple(next_shots(session, record)),
        unregistered=tuple(map(str, record.unregistered)),
        topics=tuple(topic for topic in topics if not topic.empty),
        responses=tuple(_responses(record)),
        rungs=tuple(rung_groups(record.rungs)),
        stale=stale,
    )


def _summary(session: Session, record: CalibrationRecord, images: int) -> str:
    if record.views:
        return (
            f"{len(record.views)} of {counted(images, 'image')} with a pose, "
            f"{counted(record.points, 'scene point')}, reprojection error {number(record.reprojection_px)} px"
        )
    asked = record.unregistered or not session.shots("scene")
    poses = "no image has a pose" if asked else "poses were not asked for"
    if record.board is not None:
        return f"Lenses and rig from {counted(record.board.views, 'view')} of a board; {poses}"
    return f"Exposures and cameras; {poses}"


def _points(folder: Path) -> SparsePoints | None:
    """The scene points; a calibration that came without a COLMAP model still gets its page."""
    try:
        return read_points(folder)
    except InputError:
        return None


def _light(session: Session, record: CalibrationRecord) -> Topic:
    """Exposure, vignetting, response, and what each camera makes of the same light."""
    return Topic(
        "Light",
        figures=tuple(Figure(*chart) for chart in charts(session, record)),
        tables=(
            Table(
                "Cameras",
                "",
                ("Camera", "#Views", "#Points a view, least / median", "#Field of view",
                 "#Vignetting in the corner", "#Gain", "Noise model"),
                tuple(_row(camera, record) for camera in record.cameras),
            ),
            *luminance_tables(record),
        ),
    )  # fmt: skip


def _across(lens: Lens) -> float:
    """Return how much of the world an image is wide, degrees, as its terms have it for a fisheye."""
    half = lens.width / 2 / lens.fx
    angle = fisheye_angle(np.array(half), lens.terms[4:]) if lens.fisheye else math.atan(half)
    return 2 * math.degrees(float(angle))


def _row(camera: CameraCalibration, record: CalibrationRecord) -> tuple[str, ...]:
    points = [view.points for view in record.views if view.camera == camera.name]
    lens, noise = camera.lens, camera.noise
    corner = 1 + sum(camera.vignetting)
    return (
        camera.name,
        str(len(points)),
        f"{min(points)} / {median(points):.0f}" if points else "n/a",
        f"{_across(lens):.1f}°" if lens else "n/a",
        f"{math.log2(corner):+.2f} stops".replace("-", "−")
        if corner > 0 and any(camera.vignetting)
        else "none",
        f"{camera.gain:.4f}",
        f"K {number(noise.gain)} DN/e⁻, read {number(noise.read_noise)} e⁻" if noise else "not known",
    )


def _responses(record: CalibrationRecord) -> Iterable[tuple[str, str, str]]:
    """Each response once, with the cameras that have it."""
    cameras: dict[tuple[str, str], list[str]] = {}
    for camera in record.cameras:
        cameras.setdefault((_kind(camera), camera.response.evidence), []).append(camera.name)
    for (kind, evidence), names in cameras.items():
        yield ", ".join(names), kind, sentence(f"{evidence[:1].upper()}{evidence[1:]}")


def _kind(camera: CameraCalibration) -> str:
    return {
        "linear": "linear",
        "srgb": "sRGB, assumed and not measured",
        "curve": "a curve, measured from overlapping exposures",
    }[camera.response.kind]


def rung_groups(rungs: Sequence[Rung]) -> Iterable[RungGroup]:
    """Rungs by topic, in the order of `TOPICS`; those without a topic come last."""
    groups: dict[str, list[Rung]] = {title: [] for title, _ in TOPICS}
    for rung in rungs:
        title = next((title for title, starts in TOPICS if rung.name.startswith(starts)), "Other")
        groups.setdefault(title, []).append(rung)
    for title, members in groups.items():
        if members:
            yield RungGroup(title, rung_rows(members))


def rung_rows(rungs: Sequence[Rung]) -> tuple[RungRow, ...]:
    """The ladder as words: what was modelled, what not, and what it would have bought."""
    return tuple(
        RungRow(
            # The same step is climbed by corners of a board and by points of the scene.
            name=rung.name.replace("_", " ") + (", board" if "of the board" in rung.unit else ""),
            taken=rung.taken,
            gain="not tried: see why"
            if rung.gain is None
            else f"{rung.gain:+.3g}"
            + (f" ± {rung.standard_error:.2g}" if rung.standard_error is not None else "")
            + (f" {rung.unit}" if rung.unit else ""),
            tried=rung.gain is not None,
            cost="" if rung.parameters is None else counted(rung.parameters, "parameter"),
            reason=rung.reason,
        )
        for rung in rungs
    )
