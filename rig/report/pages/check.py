"""SESSION/check/report.html: every shot of a session as `rig check` saw it, and what it found."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from markupsafe import Markup

from capture.check.check import CheckReport
from capture.check.examine import label
from capture.check.findings import Problem, ShotLook
from capture.check.picture_warnings import OFF_STOPS, doubted
from capture.record.capture_result import span
from imaging.files import store
from imaging.optics.exposure import Exposure
from imaging.session.session import Session
from rig.report.charts.chart import AxisStyle, Series, chart
from rig.report.charts.topic import Tile
from rig.report.page import environment, now
from rig.terminal.text import counted

MOST_ROWS = 200
"""Findings that are listed; a session with more has one cause."""
MOST_OPEN = 12
"""Frames that are unfolded from the start."""
KINDS = {
    "scene": "Scene",
    "board": "Board",
    "flat": "Flat frames",
    "dark": "Dark frames",
}

Place = tuple[str, int, int]
"""Camera, frame, step."""
Rows = tuple[tuple[str, tuple["SheetCell | None", ...]], ...]
"""The shots of a frame by camera."""


@dataclass(frozen=True)
class SheetCell:
    """Shot in the grid; uri is None without a picture."""

    title: str
    frame: int
    uri: str | None
    lines: tuple[tuple[str, str, bool], ...]
    """Name, value, whether it is marked."""
    marks: tuple[tuple[str, str], ...]
    """Kind of what was found, and the sentence."""


@dataclass(frozen=True)
class ContactSheet:
    """The shots of one frame, a row a camera; or, of one exposure a frame, all of one camera in a flow."""

    title: str
    rows: Rows
    flow: bool
    open: bool
    marked: int


@dataclass(frozen=True)
class ProblemRow:
    """One finding of the table."""

    grade: str
    kind: str
    where: str
    message: str


def check_report(folder: Path, report: CheckReport) -> Path:
    """Write SESSION/check/report.html; StorageError where the folder cannot be written."""
    session = Session.open(folder)
    path = folder / "check" / "report.html"
    store.make_folder(path.parent)
    html = (
        environment()
        .get_template("contact_sheet.html")
        .render(
            title=session.record.name,
            version=version("hdr-rig"),
            made=now(),
            verdict=_verdict(report),
            tiles=tuple(_tiles(report)),
            rows=tuple(_rows(report))[:MOST_ROWS],
            left_out=max(0, len(report.problems) + len(report.warnings) - MOST_ROWS),
            charts=tuple(_charts(report)),
            sheets=tuple(_sheets(report)),
        )
    )
    store.write_bytes(path, html.encode("utf-8", "replace"))
    return path


def _verdict(report: CheckReport) -> tuple[str, str, str]:
    """Grade, word and sentence."""
    whole = f"{report.sound} of {counted(report.shots, 'shot')} intact"
    if report.problems:
        return "fail", "problems", f"{whole}; {counted(len(report.problems), 'problem')} to fix."
    if report.warnings:
        return "warn", "look", f"{whole}; {counted(len(report.warnings), 'thing')} worth a look."
    return "pass", "pass", f"{whole}; nothing to fix."


def _tiles(report: CheckReport) -> Iterable[Tile]:
    yield Tile(f"{report.sound} / {report.planned}", "", "shots intact, of those planned")
    yield Tile(str(len(report.problems)), "", "problems of files and records")
    yield Tile(str(len(report.warnings)), "", "warnings about pictures")
    off = [abs(look.off) for look in report.looks if look.off is not None]
    estimated = f"{len(off)} of {len(report.looks)} exposures estimated"
    yield Tile(
        f"{max(off):.3f}" if off else "n/a", "stops" if off else "", f"largest label error; {estimated}"
    )
    skews = [1000 * step.skew for step in report.skews]
    of = f"; unknown of {', '.join(report.untimed)}" if report.untimed else ""
    if report.untimed_bound is not None:
        of += f", at most {span(report.untimed_bound)}"
    largest = f"{max(skews):.2g}" if skews else "unknown" if report.untimed else "n/a"
    yield Tile(largest, "ms" if skews else "", f"largest trigger skew{of}")


def _rows(report: CheckReport) -> Iterable[ProblemRow]:
    for grade, problems in (("fail", report.problems), ("warn", report.warnings)):
        for problem in problems:
            yield ProblemRow(grade, problem.kind, _where(problem), problem.message)


def _where(problem: Problem) -> str:
    if problem.camera is None:
        return problem.file
    frame = "" if problem.frame is None or not problem.file else f" · frame {problem.frame}"
    return problem.camera + frame


def _charts(report: CheckReport) -> Iterable[tuple[str, str, Markup]]:
    """Heading, explanation, drawing."""
    labelled = [
        (look, exposure) for look in report.looks if look.off is not None and (exposure := label(look))
    ]
    if labelled:
        cameras = list(dict.fromkeys(look.camera for look, _ in labelled))
        series = [
            Series(
                camera,
                [exposure.scale for look, exposure in labelled if look.camera == camera],
                [look.off or 0.0 for look, _ in labelled if look.camera == camera],
                dots=True,
            )
            for camera in cameras
        ]
        yield (
            "Exposure: estimated against label",
            "Stops by which overlapping pixels say that a shot got more light than its label stands for "
            f"(1/60 s: 1/64 s), within its bracket. Doubted beyond {OFF_STOPS} and three standard errors.",
            chart(
                "Estimated exposure against label",
                series,
                AxisStyle("exposure of the label, s (time × ISO / 100 / f²)", "log"),
                AxisStyle("stops", zero=True),
                level=(OFF_STOPS, "doubted above")
                if max(abs(look.off or 0) for look, _ in labelled) > OFF_STOPS / 2
                else None,
            ),
        )
    sharp = [look for look in report.looks if look.sharpness is not None and look.kind == "scene"]
    if len({look.frame for look in sharp}) > 1:
        cameras = list(dict.fromkeys(look.camera for look in sharp))
        series = [_sharpness(camera, [look for look in sharp if look.camera == camera]) for camera in cameras]
        yield (
            "Focus",
            "Sharpness: fine/coarse detail ratio of the sharpest exposure of each bracket. It falls where "
            "focus is lost.",
            chart("Focus by frame", series, "frame", AxisStyle("sharpness", zero=True)),
        )
    if report.skews:
        values = [1000 * step.skew for step in report.skews]
        series = [Series("", range(len(values)), values, dots=True)]
        yield (
            "Skew",
            "Time from the first shutter of a bracket step to the last.",
            chart(
                "Skew by step",
                [Series("", range(len(values)), values, dots=True)],
                "step",
                AxisStyle("ms", zero=True),
            ),
        )


def _sharpness(camera: str, looks: Sequence[ShotLook]) -> Series:
    best: dict[int, float] = {}
    for look in looks:
        best[look.frame] = max(best.get(look.frame, 0.0), look.sharpness or 0.0)
    frames = sorted(best)
    return Series(camera, frames, [best[frame] for frame in frames])


def _sheets(report: CheckReport) -> Iterable[ContactSheet]:
    problems: dict[Place, list[Problem]] = {}
    for problem in (*report.problems, *report.warnings):
        if problem.camera is not None and problem.frame is not None and problem.step is not None:
            problems.setdefault((problem.camera, problem.frame, problem.step), []).append(problem)
    by_kind: dict[str, dict[Place, ShotLook]] = {}
    for look in report.looks:
        by_kind.setdefault(look.kind, {})[look.camera, look.frame, look.step] = look
    if not by_kind and problems:
        by_kind["scene"] = {}
    shown = 0
    for index, kind in enumerate(sorted(by_kind, key=list(KINDS).index)):
        looks = by_kind[kind]
        everywhere = {place for places in by_kind.values() for place in places}
        # A shot without a picture is shown among those of the first kind: no more is known of it.
        lost = set(problems) - everywhere if index == 0 else set()
        places = sorted(set(looks) | lost)
        cells = {place: _cell(place, looks.get(place), problems.get(place, []), report) for place in places}
        if len({step for _, _, step in places}) == 1:
            for camera in dict.fromkeys(camera for camera, _, _ in places):
                row = tuple(cells[place] for place in places if place[0] == camera)
                yield _sheet(f"{KINDS[kind]}: {camera}", ((camera, row),), True, shown < MOST_OPEN)
                shown += 1
            continue
        steps = _columns(looks.values(), places)
        for frame in sorted({frame for _, frame, _ in places}):
            cameras = [camera for camera, its_frame, _ in places if its_frame == frame]
            rows = tuple(
                (camera, tuple(cells.get((camera, frame, step)) for step in steps))
                for camera in dict.fromkeys(cameras)
            )
            yield _sheet(f"{KINDS[kind]}: frame {frame}", rows, False, shown < MOST_OPEN)
            shown += 1


def _sheet(title: str, rows: Rows, flow: bool, unfold: bool) -> ContactSheet:
    marked = sum(bool(cell and cell.marks) for _, cells in rows for cell in cells)
    return ContactSheet(title, rows, flow, unfold or bool(marked), marked)


def _columns(looks: Iterable[ShotLook], places: Iterable[Place]) -> list[int]:
    """The steps from the longest exposure to the shortest; those without a label last."""
    scale: dict[int, float] = {}
    for look in looks:
        exposure = label(look)
        if exposure is not None:
            scale.setdefault(look.step, exposure.scale)
    return sorted({step for _, _, step in places}, key=lambda step: (-scale.get(step, 0.0), step))


def _cell(place: Place, look: ShotLook | None, problems: Sequence[Problem], report: CheckReport) -> SheetCell:
    camera, frame, step = place
    said: dict[str, list[str]] = {}
    for problem in problems:
        said.setdefault(problem.kind, []).append(problem.message)
    marks = tuple((kind, " ".join(messages)) for kind, messages in said.items())
    title = f"{camera}, frame {frame}, step {step}"
    if look is None:
        return SheetCell(title, frame, None, (), marks)
    lines = [("from", report.sources[look.file], False)] if look.file in report.sources else []
    lines += [("asked", _exposure(look.requested), False)] if look.requested else []
    lines.append(("file", _exposure(look.reported), False))
    if look.estimated is not None and look.off is not None:
        text = f"{_time(look.estimated)}, {round(look.off, 2) + 0.0:+.2f} EV".replace("-", "−")
        lines.append(("est.", text, doubted(look)))
    lines.append(("clip", "/".join(_percent(share) for share in look.clipped) + " %", False))
    if look.sharpness is not None:
        lines.append(("sharp", f"{look.sharpness:.2f}", "focus" in said))
    if look.shift is not None and look.moved is not None:
        length = (look.shift[0] ** 2 + look.shift[1] ** 2) ** 0.5
        lines.append(("shift", f"{length:.1f} px, {_percent(look.moved)} %", "motion" in said))
    data = base64.b64encode(report.thumbnails[look.file]).decode("ascii")
    return SheetCell(title, frame, f"data:image/jpeg;base64,{data}", tuple(lines), marks)


def _exposure(exposure: Exposure | None) -> str:
    return "not stated" if exposure is None else str(exposure)


def _time(exposure: Exposure) -> str:
    return f"{exposure.time:.3g} s" if exposure.time >= 0.4 else f"1/{1 / exposure.time:.4g} s"


def _percent(share: float) -> str:
    return "0" if share == 0 else f"{100 * share:.2g}" if share >= 0.001 else "<0.1"
