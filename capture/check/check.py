"""`rig check`: proof of what a session holds, and a sentence for each thing that is wrong with it."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import count
from os import PathLike
from pathlib import Path

import numpy as np

from capture.bracket.deviation import deviates, stops_apart
from capture.check.companions import companion_problems, developed_problems
from capture.check.examine import Read, examine_all
from capture.check.findings import CheckReport, Exposed, Problem, ProblemKind, StepSkew
from capture.check.picture_warnings import warnings
from capture.check.repair import RepairReport, repair
from capture.check.shot_index import read_index, source_names, stray_files
from capture.pictures.read import PictureFacts, is_without_tones
from capture.record.capture_result import span
from capture.record.capture_run import planned_shots
from capture.record.recorder import leftovers
from imaging.arguments import checked
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported
from imaging.session.records import PlanRecord, ShotRecord
from imaging.session.session import Session

__all__ = ["CheckReport", "Exposed", "Problem", "RepairReport", "check", "repair"]

SKEW_TOLERANCE = 0.02
"""Seconds between two shutters of one bracket step: a person who walks moves 3 cm, a pixel or more.
What holds where no plan says another."""

_MENDS = {"captured": "take it again with rig capture --resume", "imported": "import the photographs again"}


@checked
def check(session: str | PathLike[str], *, on_progress: Progress = unreported) -> CheckReport:
    """Compare every file of a session with its record, the plans and the rest of its bracket.

    Nothing is changed, not even the record of a shot whose exposure is found to be another than its label: a
    calibration names the index that it was made from, and estimates exposures for itself.

    Args:
        session: Session, or its folder.
        on_progress: Callback for the file being read, files read, and files to read.

    Returns:
        Problems of files and records, and warnings about pictures.

    Raises:
        InputError: The folder is no session.
    """
    session = Path(session)
    opened = Session.open(session)
    again = _MENDS["imported" if opened.record.origin == "import" else "captured"]
    shots, damaged = read_index(opened)
    problems = [Problem(kind="index", file="shots.jsonl", message=sentence) for sentence in damaged]
    try:
        plans = opened.plans()
    except InputError as error:
        plans = []
        problems.append(Problem(kind="index", file="plans.jsonl", message=str(error)))
    else:
        problems.extend(_strangers(opened, plans, shots))
    started = count()
    read, failed = examine_all(
        opened, shots, lambda shot: on_progress(f"reading {shot.file}", next(started), len(shots))
    )
    on_progress("read", len(shots), len(shots))
    pictures: list[tuple[ShotRecord, Read]] = []
    for shot in shots:
        if shot.file in failed:
            kind, what = failed[shot.file]
            mend = _mend(kind, shot, imported=opened.record.origin == "import")
            problems.append(_problem(kind, shot, f"{what}: {mend}."))
            continue
        differences = list(_against_record(shot, read[shot.file]))
        if not any(problem.kind == "altered" for problem in differences):
            pictures.append((shot, read[shot.file]))
        problems.extend(differences)
    problems.extend(_missing(plans, shots, again))
    problems.extend(companion_problems(opened, shots, again))
    problems.extend(developed_problems(opened, shots))
    sources = source_names(shots)
    problems.extend(_duplicates(opened, shots, {shot.file for shot, _ in pictures}, sources))
    problems.extend(_unrecorded(opened, shots))
    together = {plan.plan: plan.tolerance for plan in plans if plan.tolerance is not None}
    problems.extend(_skewed(shots, together))
    looks = [content.look for _, content in pictures]
    # Under covered lenses it does not matter when a shutter opens.
    timed = [shot for shot in shots if shot.kind != "dark" and shot.trigger_delay is not None]
    several = len({shot.camera for shot in timed}) > 1
    untimed = [shot for shot in timed if several and shot.skew is None]
    alarms = (*warnings(looks, opened.record.cameras), *_taken_again(shots, together))
    return CheckReport(
        session=str(session),
        planned=sum(len(planned_shots(plan)) for plan in plans),
        shots=len(shots),
        sound=len(pictures),
        exposures=tuple(_exposed(pictures)),
        problems=tuple(_with_source(problem, sources) for problem in problems),
        warnings=tuple(_with_source(alarm, sources) for alarm in alarms),
        looks=tuple(looks),
        skews=tuple(_skews(shots)),
        untimed=tuple(sorted({shot.camera for shot in untimed})),
        untimed_bound=max((shot.skew_bound for shot in untimed if shot.skew_bound is not None), default=None),
        thumbnails={shot.file: content.thumbnail for shot, content in pictures},
        sources=sources,
    )


def _mend(kind: ProblemKind, shot: ShotRecord, *, imported: bool) -> str:
    """Return what makes the file of a shot readable again."""
    if not imported:
        first = "set it aside in torn/" if kind == "torn" else "drop its record"
        return f"{first} with rig check --repair, and take it again with rig capture --resume"
    if kind != "torn":
        return "drop its record with rig check --repair, and import the photographs again"
    if shot.source is not None and not shot.shifted:  # else it was made of its originals
        return f"restore it from {shot.source}"
    return "import the photographs again into a new folder"


def _problem(kind: ProblemKind, shot: ShotRecord, message: str) -> Problem:
    return Problem(
        kind=kind, file=shot.file, camera=shot.camera, frame=shot.frame, step=shot.step, message=message
    )


def _with_source(problem: Problem, sources: Mapping[str, str]) -> Problem:
    """The problem, which names the user's own file beside the one that was imported from it."""
    file, name = problem.file, sources.get(problem.file)
    if name is None:
        return problem
    return problem.model_copy(update={"message": problem.message.replace(file, f"{file} ({name})", 1)})


def _against_record(shot: ShotRecord, read: Read) -> Iterator[Problem]:
    """Yield what a readable file and its record disagree about, and the record with the request."""
    picture = read.picture
    if read.sha256 != shot.sha256:
        yield _problem(
            "altered",
            shot,
            f"{shot.file} is not the file that was recorded (its SHA-256 differs): restore it from a copy, "
            "or move it away and take it again.",
        )
    if (picture.width, picture.height) != (shot.width, shot.height):
        yield _problem(
            "size",
            shot,
            f"{shot.file} has {picture.width}x{picture.height} pixels and its record says "
            f"{shot.width}x{shot.height}: restore the file from a copy.",
        )
    requested, reported = shot.requested, picture.metadata.exposure or shot.reported
    if requested is not None and reported is not None and deviates(reported, requested):
        yield _problem(
            "exposure",
            shot,
            f"{shot.file} was exposed at {reported} where {requested} was asked for "
            f"({stops_apart(reported, requested):+.2f} stops): set the camera to manual and take it again.",
        )


def _strangers(
    session: Session, plans: Sequence[PlanRecord], shots: Sequence[ShotRecord]
) -> Iterator[Problem]:
    """Records of cameras or shots that the session does not know."""
    cameras = {camera.name for camera in session.record.cameras}
    planned = {(plan.plan, *shot_id) for plan in plans for shot_id in planned_shots(plan)}
    names, unplanned = {plan.plan for plan in plans}, dict[tuple[str, str], int]()
    for shot in shots:
        if shot.camera not in cameras:
            yield _problem(
                "index",
                shot,
                f"{shot.file} is of {shot.camera!r}, which is not a camera of the session: correct its "
                "record.",
            )
        elif shot.plan not in names:
            unplanned[shot.kind, shot.plan] = unplanned.get((shot.kind, shot.plan), 0) + 1
        elif shot.identity not in planned:
            yield _problem(
                "index", shot, f"{shot.file} belongs to no plan: correct its record in shots.jsonl."
            )
    for (kind, name), number in unplanned.items():
        shots_of = f"its {kind} shot" if number == 1 else f"its {number} {kind} shots"
        message = f"plans.jsonl lacks the plan {name} of {shots_of}: restore it from a copy."
        yield Problem(kind="index", file="plans.jsonl", message=message)


def _missing(plans: Sequence[PlanRecord], shots: Sequence[ShotRecord], again: str) -> Iterator[Problem]:
    there = {shot.identity for shot in shots}
    for plan in plans:
        for shot_id in planned_shots(plan):
            if (plan.plan, *shot_id) not in there:
                message = f"The shot of {shot_id} is missing: {again}."
                yield Problem(
                    kind="missing",
                    camera=shot_id.camera,
                    frame=shot_id.frame,
                    step=shot_id.step,
                    message=message,
                )


def _duplicates(
    session: Session, shots: Sequence[ShotRecord], sound: Collection[str], sources: Mapping[str, str]
) -> Iterator[Problem]:
    """Files that two shots share, by name, or by content where both are as they were recorded.

    Several exposures may be equally black or white.
    """
    files: set[str] = set()
    by_content: dict[str, list[ShotRecord]] = {}
    for shot in shots:
        if shot.file in files:
            yield _problem(
                "duplicate", shot, f"{shot.file} is recorded for two shots: rig check --repair keeps one."
            )
        elif shot.file in sound:
            by_content.setdefault(shot.sha256, []).append(shot)
        files.add(shot.file)
    for first, *others in by_content.values():
        for shot in others if others and not is_without_tones(session.file(first)) else ():
            fix = "move the wrong one away"
            if session.record.origin == "import":
                name = sources.get(shot.file, shot.file)
                fix = f"take {name} out of the photographs and import them again into a new folder"
            yield _problem("duplicate", shot, f"{shot.file} is the same file as {first.file}: {fix}.")


def _unrecorded(session: Session, shots: list[ShotRecord]) -> Iterator[Problem]:
    for file in stray_files(session, shots):
        message = f"{file} has no record: add it with rig check --repair, or move it away."
        yield Problem(kind="stray", file=file, message=message)
    for part in leftovers(session):
        file = part.relative_to(session.folder).as_posix()
        message = f"{file} was left half-written by a run that was killed: delete it."
        yield Problem(kind="leftover", file=file, message=message)


def _skewed(shots: Iterable[ShotRecord], together: Mapping[str, float]) -> Iterator[Problem]:
    """together: seconds that are no skew, of the plans that say it."""
    for shot in shots:
        bound = together.get(shot.plan, SKEW_TOLERANCE)
        if shot.skew is not None and shot.skew > bound and not shot.retries:
            yield _problem(
                "skew",
                shot,
                f"{shot.file} was exposed {span(shot.skew)} after the first camera of its step, and "
                f"{span(bound)} are allowed: use a hardware trigger where the scene moves.",
            )


def _taken_again(shots: Iterable[ShotRecord], together: Mapping[str, float]) -> Iterator[Problem]:
    """Shots that came late because they had to be repeated, which no trigger would have helped."""
    for _, step_shots in _steps(shots):
        for shot in step_shots if len(step_shots) > 1 else ():
            late = max(shot.skew or 0.0, shot.trigger_delay or 0.0)
            if shot.retries and late > together.get(shot.plan, SKEW_TOLERANCE):
                yield _problem(
                    "skew",
                    shot,
                    f"{shot.file} had to be taken again, {span(late)} after the first "
                    "camera of its step: take the frame again if the scene moves.",
                )


def _steps(shots: Iterable[ShotRecord]) -> Iterator[tuple[tuple[str, int, int], list[ShotRecord]]]:
    """The shots of each bracket step of the rig, frames in order."""
    steps: dict[tuple[str, int, int], list[ShotRecord]] = {}
    for shot in shots:
        steps.setdefault((shot.plan, shot.frame, shot.step), []).append(shot)
    yield from sorted(steps.items())


def _skews(shots: Iterable[ShotRecord]) -> Iterator[StepSkew]:
    """The spread of the shutters of each step that says it."""
    for (plan, frame, step), step_shots in _steps(shot for shot in shots if shot.skew is not None):
        skew = max(shot.skew or 0.0 for shot in step_shots)
        yield StepSkew(kind=step_shots[0].kind, plan=plan, frame=frame, step=step, skew=skew)


def _exposed(pictures: Sequence[tuple[ShotRecord, Read]]) -> Iterator[Exposed]:
    """Clipping by camera and exposure; brightest first."""
    groups: dict[tuple[str, Exposure | None], list[tuple[ShotRecord, PictureFacts]]] = {}
    for shot, read in pictures:
        groups.setdefault((shot.camera, shot.requested or shot.reported), []).append((shot, read.picture))

    def order(key: tuple[str, Exposure | None]) -> tuple[str, float]:
        return key[0], -(key[1].stops if key[1] is not None else 0.0)

    for camera, exposure in sorted(groups, key=order):
        members = groups[camera, exposure]
        red, green, blue = np.mean([picture.clipped for _, picture in members], axis=0).tolist()
        skews = [shot.skew for shot, _ in members if shot.skew is not None]
        yield Exposed(
            camera=camera,
            exposure=exposure,
            shots=len(members),
            clipped=(red, green, blue),
            black=float(np.mean([picture.black for _, picture in members])),
            max_skew=max(skews, default=None),
        )
