"""A session is begun, added to or completed with whatever cameras there are: the one way to shoot."""

from collections.abc import Callable, Sequence, Set
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from capture.bracket.automatic import Automatic, meter_rig
from capture.bracket.metering.meter import Metering
from capture.bracket.planner import BracketPlan
from capture.record.capture_result import CaptureResult
from capture.record.capture_run import finished, planned_shots
from capture.record.forecast import Forecast, Stopwatch, TimedCamera, forecast_of
from capture.record.new_session import begin, folder_made, is_vacant, must_be_no_file
from capture.record.recorder import record
from capture.record.resumed_plan import continued, must_be_the_same
from capture.record.session_plan import like, metered_at, plan_for
from capture.record.shot_files import ShotId
from capture.record.source import Source
from capture.request import CaptureRequest
from imaging.errors import CaptureError, InputError, StorageError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.lock import sole_writer
from imaging.session.records import PlanRecord, RunRecord, SessionRecord
from imaging.session.session import LAMPS, TURNTABLE, Session

Say = Callable[[str], None]


def shoot(
    source: Source,
    out: Path,
    request: CaptureRequest,
    *,
    progress: Progress = unreported,
    say: Say = lambda line: None,
    announce: Callable[[Forecast], None] = lambda forecast: None,
) -> CaptureResult:
    """Shoot what is asked for into the session folder `out`.

    A vacant folder becomes a session. One that is a session of the same cameras is added to: darks, flats and
    the board as often as one likes, the scene once.

    Args:
        source: Cameras, and what is usual with them.
        out: Folder of the session.
        request: Options of the capture.
        progress: Callback for the current step, the shots done, and all of them.
        say: Callback that shows a line that a person should know.
        announce: Callback that shows the forecast, before the first shot; `runs.jsonl` has it beside what it
            came to.

    Returns:
        The number of shots, and what is missing or deviates.

    Raises:
        InputError: `out` is something else, holds another capture, or is written by another process; or the
            request is impossible.
        CaptureError: The scene cannot be metered, no bracket fits into the limits, or a camera is not the one
            that the session knows by its name.
        StorageError: The disk refuses; what was finished stays.
    """
    _must_be_there(out, request)
    with folder_made(out), sole_writer(out):
        start = _prepared(source, out, request, progress, say)
        session, plan, done = start.session, start.plan, start.done
        if start.is_new:
            session = session or begin(out, start.identity)
            if source.turntable is not None and request.kind == "scene":
                store.write_json(out / TURNTABLE, source.turntable.model_dump(mode="json"))
            if source.lamps is not None and request.kind == "scene":
                store.write_json(out / LAMPS, source.lamps.model_dump(mode="json"))
            session.append_plan(plan)
        assert session is not None
        forecast = forecast_of(plan, start.pending, start.timed, out, session)
        if start.pending:
            announce(forecast)
            source.operator.show(request.kind)
        if done:
            # From it the operator knows that the next frame is not the first.
            source.operator.move_to(plan.frames[0])
        with source.beside(session, plan, progress):
            moving = Stopwatch(source.clock)
            began = source.clock.now()
            result = record(
                session,
                plan,
                source.cameras,
                clock=source.clock,
                move_to=moving.timing(source.operator.move_to),
                turn_to=moving.timing(source.operator.turn_to),
                compression=request.compression,
                progress=progress,
                tolerance=source.tolerance,
                leader=source.leader,
            )
            seconds = source.clock.now() - began - moving.seconds
            return replace(result, run=_recorded(session, plan, done, forecast, seconds))


@dataclass(frozen=True)
class _Start:
    """State before the first shot.

    session: None where `identity` is to begin one. done, pending: shots of the plan. timed: the source with
    the test shots of the meter. automatic: how a new plan's bracket was planned, if it was.
    """

    session: Session | None
    identity: SessionRecord
    plan: PlanRecord
    is_new: bool
    done: Set[ShotId]
    pending: Sequence[ShotId]
    timed: Source
    automatic: Automatic | None


def _must_be_there(out: Path, request: CaptureRequest) -> None:
    """InputError if nothing is there to be resumed."""
    if request.resume and not out.is_dir():
        raise InputError(f"{out} is not a folder: leave --resume out to begin a session there.")


def _prepared(source: Source, out: Path, request: CaptureRequest, progress: Progress, say: Say) -> _Start:
    """Find or make the plan and write nothing; InputError and CaptureError as of `shoot`."""
    identity = SessionRecord(
        name=out.resolve().name,
        created=datetime.now(UTC),
        origin=source.origin,
        seed=source.seed,
        cameras=source.records,
        bands=source.bands,
    )
    session, timed, automatic = _existing(out, request), _timed(source, request), None
    plans = [] if session is None else session.plans()
    plan: PlanRecord | None = None
    if session is not None:
        must_be_the_same(session, identity)
        plan = continued(session, source, request, plans, say) if request.resume else None
    is_new = plan is None
    if plan is None:
        if session is not None:
            _must_be_planned(session, request, plans)
        progress("planning", 0, 0)
        plan, automatic = plan_for(timed, request, plans, progress)
    done = set() if session is None else set(finished(session, plan))
    pending = [shot for shot in planned_shots(plan) if shot not in done]
    return _Start(session, identity, plan, is_new, done, pending, timed, automatic)


def _must_be_planned(session: Session, request: CaptureRequest, plans: Sequence[PlanRecord]) -> None:
    """InputError if shots have lost their plan: a new one would take their names."""
    names = {plan.plan for plan in plans}
    lost = [shot for shot in session.shots(request.kind) if shot.plan not in names]
    if lost:
        shots = f"its {request.kind} shot" if len(lost) == 1 else f"its {len(lost)} {request.kind} shots"
        raise InputError(
            f"{session.folder / 'plans.jsonl'} lacks the plan of {shots}: restore it from a copy."
        )


def _timed(source: Source, request: CaptureRequest) -> Source:
    """The source with its cameras timed while they are metered."""
    return replace(
        source,
        cameras={
            name: TimedCamera(camera, source.clock, request.compression)
            for name, camera in source.cameras.items()
        },
    )


def _recorded(
    session: Session, plan: PlanRecord, before: Set[ShotId], forecast: Forecast, seconds: float
) -> RunRecord | None:
    """The line of a run that took shots; None without any. before: shots of earlier runs."""
    taken = {shot_id: shot for shot_id, shot in finished(session, plan).items() if shot_id not in before}
    if not taken:
        return None
    steps = {(shot_id.frame, shot_id.step) for shot_id in taken}
    exposed = sum(exposure.time for _, step in steps if (exposure := plan.bracket[step]) is not None)
    files = [file for shot in taken.values() for file in (shot.file, shot.developed) if file is not None]
    run = RunRecord(
        plan=plan.plan,
        ended=datetime.now(UTC),
        shots=len(taken),
        forecast_shots=forecast.shots,
        basis=forecast.basis,
        forecast_seconds=forecast.seconds,
        seconds=seconds,
        forecast_bytes=forecast.size,
        bytes=sum((session.folder / file).stat().st_size for file in files),
        beyond=max(0.0, seconds - exposed) / len(steps),
    )
    with suppress(StorageError):  # the shots are there, and count
        session.append_run(run)
    return run


def _existing(out: Path, request: CaptureRequest) -> Session | None:
    """The session in `out`, if it may be added to; None if one may begin there. InputError otherwise."""
    if is_vacant(out):
        return None
    if request.resume:
        return Session.open(out)
    plans = Session.open(out).plans() if (out / "session.json").exists() else []
    if not plans or (request.kind == "scene" and any(plan.kind == "scene" for plan in plans)):
        raise InputError(f"{out} is not empty: name a new folder, or --resume the session in it.")
    return Session.open(out)


@dataclass(frozen=True)
class Rehearsal:
    """Preview of a capture, and its quality.

    size: width and height of a picture, None if no camera reports it. metering: of a scene; None where the
    cameras cannot be metered, for the reason `unmetered`. plan: of an automatic bracket only.
    """

    record: PlanRecord
    size: tuple[int, int] | None
    metering: Metering | None
    forecast: Forecast
    plan: BracketPlan | None = None
    unmetered: str | None = None


def rehearse(
    source: Source,
    out: Path,
    request: CaptureRequest,
    *,
    progress: Progress = unreported,
    say: Say = lambda line: None,
) -> Rehearsal:
    """Plan what `shoot` would take, with the scene metered, and write nothing.

    InputError and CaptureError as there; but a bracket that is given needs no meter.
    """
    _must_be_there(out, request)
    must_be_no_file(out)
    start = _prepared(source, out, request, progress, say)
    metering = None if start.automatic is None else start.automatic.metering
    unmetered = None if start.pending else "all shots are taken"
    if start.automatic is None and start.pending and request.kind == "scene":
        try:
            metering = meter_rig(
                start.timed.cameras,
                like(source),
                frames=metered_at(source, "scene", start.plan.frames),
                move_to=source.operator.move_to,
                progress=progress,
            )
        except CaptureError as error:
            unmetered = str(error)
    return Rehearsal(
        record=start.plan,
        size=_size(source),
        metering=metering,
        plan=None if start.automatic is None else start.automatic.plan,
        unmetered=unmetered,
        forecast=forecast_of(start.plan, start.pending, start.timed, out, start.session),
    )


def _size(source: Source) -> tuple[int, int] | None:
    """Size of the first camera's picture: on some buses it is known only once there is a picture."""
    if source.size is not None:
        return source.size
    able = next(iter(source.cameras.values())).capabilities()
    return (able.width, able.height) if able.width and able.height else None


def nothing_beside(session: Session, plan: PlanRecord, progress: Progress) -> AbstractContextManager[None]:
    """Write nothing, for real cameras: only a simulator knows the truth."""
    return nullcontext()
