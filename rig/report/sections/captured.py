"""The section "What was captured": rig, bracket, health of the exposures, contact sheet."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from capture.check.picture_warnings import lost_highlights
from imaging.optics.exposure import Exposure
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord
from imaging.session.records import ShotRecord
from imaging.session.session import Session
from rig.report.charts.calibration_charts import label_ratio
from rig.report.sections.shots import ShotPreviews, Thumbnail, read_previews
from rig.terminal.text import counted, number

DARK_IN_LONGEST = 0.25
"""Above this share dark in the longest exposure, shadows are lost in noise."""
LABEL_OFF = 0.06
"""A label further than this from the truth, as a ratio, is worth a word: 1/30 s that is 1/32 s is not."""


@dataclass(frozen=True)
class StepRow:
    """One row of the bracket table."""

    step: int
    requested: str
    reported: str
    ratio: str
    """Estimated over reported exposure scale."""
    off: bool
    clipped: str
    clipped_worst: str
    dark: str
    shots: int


@dataclass(frozen=True)
class CameraRow:
    """One row of the camera table."""

    name: str
    model: str
    serial: str
    kind: str
    rig: str
    image: str
    shots: int


@dataclass(frozen=True)
class CaptureSection:
    """Everything the section shows."""

    origin: str
    summary: str
    cameras: tuple[CameraRow, ...]
    steps: tuple[StepRow, ...]
    thumbnails: tuple[Thumbnail, ...]
    merged: bool
    looked: str
    advice: tuple[str, ...]
    retries: int
    skew_ms: str | None


KINDS = {"raw": "RAW mosaic", "ldr": "developed photo", "hdr": "linear EXR"}


def captured(
    session: Session,
    calibration: CalibrationRecord | None,
    progress: Progress,
    until: float = math.inf,
) -> CaptureSection:
    """Read the session for the page; until: as `read_previews` has it."""
    shots = session.shots("scene")
    previews = read_previews(session, progress, until)
    steps = {step: [s for s in shots if s.step == step] for step in sorted({s.step for s in shots})}
    frames = len({shot.frame for shot in shots})
    views = len({(shot.frame, shot.camera) for shot in shots})
    skews = [shot.skew for shot in shots if shot.skew is not None]
    return CaptureSection(
        origin=_origin(session),
        summary=f"{counted(len(session.record.cameras), 'camera')}, {counted(frames, 'frame')}, "
        f"{counted(views, 'view')}, {counted(len(shots), 'exposure')}{_others(session)}",
        cameras=tuple(_camera_rows(session, shots or session.shots())),
        steps=tuple(_step_row(step, group, previews, calibration) for step, group in steps.items()),
        thumbnails=previews.thumbnails,
        merged=previews.merged,
        looked="every view"
        if previews.views == previews.of_views
        else f"{previews.views} of {previews.of_views} views, evenly chosen",
        advice=tuple(_advice(steps, previews, views)),
        retries=sum(shot.retries for shot in shots),
        skew_ms=number(1000 * max(skews), 2) if skews else None,
    )


def _origin(session: Session) -> str:
    record = session.record
    if record.origin.startswith("sim:"):
        return f"Simulated rig “{record.origin[4:]}”, seed {record.seed}"
    return "Imported photographs" if record.origin == "import" else f"Rig {record.origin}"


def _others(session: Session) -> str:
    """Shots that show no scene, in words."""
    kinds = [shot.kind for shot in session.shots()]
    named = (("dark", "darks"), ("flat", "flats"), ("board", "shots of a board"))
    words = [f"{kinds.count(kind)} {words}" for kind, words in named if kind in kinds]
    return f"; {', '.join(words)}" if words else ""


def _camera_rows(session: Session, shots: Iterable[ShotRecord]) -> Iterable[CameraRow]:
    by_camera: dict[str, list[ShotRecord]] = {}
    for shot in shots:
        by_camera.setdefault(shot.camera, []).append(shot)
    for camera in session.record.cameras:
        taken = by_camera.get(camera.name, [])
        sizes = sorted({(shot.width, shot.height) for shot in taken})
        yield CameraRow(
            name=camera.name,
            model=" ".join(part for part in (camera.make, camera.model) if part) or "unknown",
            serial=camera.serial or "unknown",
            kind=KINDS[camera.kind],
            rig=camera.rig or "stands alone",
            image=", ".join(f"{width} × {height}" for width, height in sizes) or "none",
            shots=len(taken),
        )


def _step_row(
    step: int, shots: list[ShotRecord], previews: ShotPreviews, calibration: CalibrationRecord | None
) -> StepRow:
    shares = [previews.shares[shot.file] for shot in shots if shot.file in previews.shares]
    ratios = [ratio for shot in shots if (ratio := label_ratio(shot, calibration)) is not None]
    ratio = median(ratios) if ratios else None
    return StepRow(
        step=step,
        requested=_exposures(shot.requested for shot in shots),
        reported=_exposures(shot.reported for shot in shots),
        ratio="n/a" if ratio is None else f"{ratio:.3f}",
        off=ratio is not None and abs(math.log(ratio)) > math.log1p(LABEL_OFF),
        clipped=_percent(median([share[0] for share in shares])) if shares else "n/a",
        clipped_worst=_percent(max(share[0] for share in shares)) if shares else "n/a",
        dark=_percent(median([share[1] for share in shares])) if shares else "n/a",
        shots=len(shots),
    )


def _exposures(exposures: Iterable[Exposure | None]) -> str:
    """`1/60 s f/8 ISO 100`, a range of them, or `not stated`."""
    stated = sorted({e for e in exposures if e is not None}, key=lambda e: e.scale)
    if not stated:
        return "not stated"
    return str(stated[0]) if len(stated) == 1 else f"{stated[0]} to {stated[-1]}"


def _percent(share: float) -> str:
    return "0 %" if share == 0 else f"{100 * share:.2g} %" if share >= 0.0001 else "< 0.01 %"


def _advice(steps: dict[int, list[ShotRecord]], previews: ShotPreviews, views: int) -> Iterable[str]:
    """Yield what to shoot differently next time, from what the files show."""
    if previews.unreadable:
        files = counted(len(previews.unreadable), "file")
        yield f"{files} cannot be read, the first is {previews.unreadable[0]}: run rig check."
    measured = [
        (shot, previews.shares[shot.file])
        for group in steps.values()
        for shot in group
        if shot.file in previews.shares
    ]
    scales = {shot.file: shot.exposure.scale for shot, _ in measured if shot.exposure}
    if scales:
        high = max(scales.values())
        longest = [share[1] for shot, share in measured if scales.get(shot.file, 0.0) >= high / 1.3]
        lost = lost_highlights([(scales[s.file], share[0]) for s, share in measured if s.file in scales])
        if lost is not None:
            yield lost
        if longest and median(longest) > DARK_IN_LONGEST:
            yield (
                f"The longest exposure leaves {_percent(median(longest))} of its samples dark: "
                "add a longer one to lift the shadows above the noise."
            )
    if 0 < views < 8:
        yield f"{counted(views, 'view')} can hardly make a scene: take 20 or more that overlap."
