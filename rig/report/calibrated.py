"""The section "What was calibrated": verdicts, poses, lens, exposure ratios, vignetting, response, rungs."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Literal

import numpy as np
from markupsafe import Markup

from imaging import store
from imaging.calibration import CalibrationRecord, CameraCalibration
from imaging.colmap import SparsePoints, read_points
from imaging.errors import InputError
from imaging.records import Rung
from imaging.session import Session
from rig.report.calibration_charts import charts
from rig.report.topview import top_view
from rig.words import counted, number, sentence

Grade = Literal["pass", "warn", "fail"]

GOOD_PX, POOR_PX = 0.8, 1.5
"""Mean reprojection error: below the first is good for photographs, above the second something is wrong."""
FEW_POINTS = 30
"""A view that sees fewer scene points than this has a pose that should not be trusted."""


@dataclass(frozen=True)
class Verdict:
    """One line that says whether to go on: the number, and what it is held against."""

    grade: Grade
    text: str


@dataclass(frozen=True)
class LensRow:
    """One row of the table of cameras."""

    name: str
    views: str
    points: str
    model: str
    focal: str
    field_of_view: str
    centre: str
    distortion: str
    corner: str
    gain: str
    noise: str


@dataclass(frozen=True)
class RungRow:
    """One step of a ladder, as words."""

    name: str
    taken: bool
    gain: str
    reason: str


@dataclass(frozen=True)
class Calibrated:
    """Everything the section shows."""

    summary: str
    posed: bool
    registered: str
    verdicts: tuple[Verdict, ...]
    unregistered: tuple[str, ...]
    lenses: tuple[LensRow, ...]
    top: Markup | None
    charts: tuple[tuple[str, str, Markup], ...]
    """Heading, explanation, drawing."""
    responses: tuple[tuple[str, str, str], ...]
    """Cameras, kind, evidence."""
    rungs: tuple[RungRow, ...]
    stale: bool


def is_stale(session: Session, record: CalibrationRecord) -> bool:
    """Whether shots were added, or taken away, after the calibration."""
    return store.sha256(session.folder / "shots.jsonl") != record.shots_sha256


def calibrated(session: Session, record: CalibrationRecord, stale: bool) -> Calibrated:
    """Turn a calibration into what the page shows."""
    points = _points(session.folder / "calibration" / "colmap")
    images = len(record.views) + len(record.unregistered)
    return Calibrated(
        summary=f"{len(record.views)} of {counted(images, 'image')} with a pose, "
        f"{counted(record.points, 'scene point')}, reprojection error {number(record.reprojection_px)} px"
        if record.views
        else "Exposures and cameras; no image has a pose",
        posed=bool(record.views),
        registered=f"{len(record.views)} of {images}",
        verdicts=tuple(_verdicts(session, record)),
        unregistered=record.unregistered,
        lenses=tuple(_lens_row(camera, record) for camera in record.cameras),
        top=_top(record, points),
        charts=tuple(charts(session, record, points)),
        responses=tuple(_responses(record)),
        rungs=rung_rows(record.rungs),
        stale=stale,
    )


def _points(folder: Path) -> SparsePoints | None:
    """The scene points; a calibration that came without a COLMAP model still gets its page."""
    try:
        return read_points(folder)
    except InputError:
        return None


def _verdicts(session: Session, record: CalibrationRecord) -> Iterable[Verdict]:
    if not record.views:
        yield Verdict("warn", "No image has a pose: only what needs none was measured")
        return
    error = record.reprojection_px
    if error is not None:
        grade: Grade = "pass" if error < GOOD_PX else "warn" if error < POOR_PX else "fail"
        yield Verdict(
            grade,
            f"Mean reprojection error {number(error)} px (good below {GOOD_PX}, doubtful above {POOR_PX} px)",
        )
    for camera in record.cameras:
        own = [view for view in record.views if view.camera == camera.name]
        missed = [name for name in record.unregistered if name.split("/", 1)[0] == camera.name]
        total = len(own) + len(missed)
        weak = [view for view in own if view.points < FEW_POINTS]
        if not own:
            yield Verdict("fail", f"{camera.name}: none of {counted(total, 'image')} has a pose")
        elif missed or weak:
            words = [f"{len(own)} of {counted(total, 'image')} with a pose"]
            words += [f"{len(weak)} of them from fewer than {FEW_POINTS} scene points"] if weak else []
            yield Verdict("warn", f"{camera.name}: {', '.join(words)}")
        else:
            least = min(view.points for view in own)
            yield Verdict(
                "pass",
                f"{camera.name}: all {counted(total, 'image')} with a pose, from {least} points or more",
            )


def _lens_row(camera: CameraCalibration, record: CalibrationRecord) -> LensRow:
    own = [view.points for view in record.views if view.camera == camera.name]
    lens, noise = camera.lens, camera.noise
    corner = 1 + sum(camera.vignetting)
    return LensRow(
        name=camera.name,
        views=str(len(own)),
        points=f"{min(own)} / {median(own):.0f}" if own else "n/a",
        model=lens.model if lens else "none",
        focal=(f"{lens.fx:.2f}" if lens.fx == lens.fy else f"{lens.fx:.2f}, {lens.fy:.2f}")
        if lens
        else "n/a",
        field_of_view=f"{2 * math.degrees(math.atan(lens.width / 2 / lens.fx)):.1f}°" if lens else "n/a",
        centre=f"{lens.cx:.2f}, {lens.cy:.2f}" if lens else "n/a",
        distortion=", ".join(
            f"{name} {value:+.4f}".replace("-", "−")
            for name, value in (("k1", lens.k1), ("k2", lens.k2), ("p1", lens.p1), ("p2", lens.p2))
            if abs(value) >= 5e-5
        )
        or "none"
        if lens
        else "n/a",
        corner=f"{math.log2(corner):+.2f} stops".replace("-", "−")
        if corner > 0 and any(camera.vignetting)
        else "none",
        gain=f"{camera.gain:.4f}",
        noise=f"K {number(noise.gain)} DN/e⁻, read {number(noise.read_noise)} e⁻" if noise else "not known",
    )


def _top(record: CalibrationRecord, points: SparsePoints | None) -> Markup | None:
    if not record.views:
        return None
    poses = {(view.frame, view.camera): view.cam_from_world.matrix() for view in record.views}
    cloud = points.xyz if points is not None else np.zeros((0, 3))
    return top_view(poses, cloud, "Cameras and scene points seen from above")


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


def rung_rows(rungs: Sequence[Rung]) -> tuple[RungRow, ...]:
    """The ladder as words: what was modelled, what not, and what it would have bought."""
    return tuple(
        RungRow(
            name=rung.name.replace("_", " "),
            taken=rung.taken,
            gain="decided without a trial"
            if rung.gain is None
            else f"{rung.gain:+.3g}"
            + (f" ± {rung.standard_error:.2g}" if rung.standard_error is not None else "")
            + (f" {rung.unit}" if rung.unit else ""),
            reason=rung.reason,
        )
        for rung in rungs
    )
