"""A session is begun, added to or completed with whatever cameras there are: the one way to shoot."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from capture.bracket.automatic import meter_rig
from capture.bracket.metering import Metering
from capture.bracket.planner import BracketPlan
from capture.record.capture_run import CaptureResult, finished, planned_shots
from capture.record.new_session import begin, folder_made, is_vacant
from capture.record.recorder import record
from capture.record.resumed_plan import continued, must_be_the_same
from capture.record.session_plan import like, metered_at, plan_for
from capture.record.source import Source
from capture.request import CaptureRequest
from imaging.errors import CaptureError, InputError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.lock import sole_writer
from imaging.session.records import PlanRecord, SessionRecord
from imaging.session.session import LAMPS, TURNTABLE, Session

Say = Callable[[str], None]


def shoot(
    source: Source,
    out: Path,
    request: CaptureRequest,
    *,
    progress: Progress = unreported,
    say: Say = lambda line: None,
) -> CaptureResult:
    """Shoot what is asked for into the session folder `out`.

    A vacant folder becomes a session. One that is a session of the same cameras is added to: darks, flats
    and the board as often as one likes, the scene once. say: shows a line that a person should know.

    InputError: `out` is something else, or holds another capture. CaptureError: what is there cannot be
    metered. StorageError: the disk refuses; what was finished stays.
    """
    if request.resume and not out.is_dir():
        raise InputError(f"{out} is not a folder: leave --resume out to begin a session there.")
    identity = SessionRecord(
        name=out.resolve().name,
        created=datetime.now(UTC),
        origin=source.origin,
        seed=source.seed,
        cameras=source.records,
        bands=source.bands,
    )
    with folder_made(out), sole_writer(out):
        session = _existing(out, request)
        plans = [] if session is None else session.plans()
        if session is not None:
            must_be_the_same(session, identity)
        plan = continued(session, source, request, plans, say) if session and request.resume else None
        if plan is None:
            progress("planning", 0, 0)
            plan = plan_for(source, request, plans)[0]
            session = session or begin(out, identity)
            if source.turntable is not None and request.kind == "scene":
                store.write_json(out / TURNTABLE, source.turntable.model_dump(mode="json"))
            if source.lamps is not None and request.kind == "scene":
                store.write_json(out / LAMPS, source.lamps.model_dump(mode="json"))
            session.append_plan(plan)
        assert session is not None
        done = finished(session, plan)
        if len(done) < len(planned_shots(plan)):
            source.operator.show(request.kind)
        if done:
            # From it the operator knows that the next frame is not the first.
            source.operator.move_to(plan.frames[0])
        with source.beside(session, plan, progress):
            return record(
                session,
                plan,
                source.cameras,
                clock=source.clock,
                move_to=source.operator.move_to,
                turn_to=source.operator.turn_to,
                compression=request.compression,
                progress=progress,
                tolerance=source.tolerance,
                leader=source.leader,
            )


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
    plan: BracketPlan | None = None
    unmetered: str | None = None


def rehearse(source: Source, out: Path, request: CaptureRequest) -> Rehearsal:
    """Plan what `shoot` would take, with the scene metered, and write nothing.

    InputError and CaptureError as there; but a bracket that is given needs no meter.
    """
    session = Session.open(out) if (out / "session.json").exists() else None
    plans: Sequence[PlanRecord] = session.plans() if session is not None else []
    planned, automatic = plan_for(source, request, plans)
    if automatic is not None:
        return Rehearsal(planned, _size(source), automatic.metering, automatic.plan)
    if request.kind != "scene":
        return Rehearsal(planned, _size(source), None)
    try:
        metering = meter_rig(
            source.cameras,
            like(source),
            frames=metered_at(source, "scene", planned.frames),
            move_to=source.operator.move_to,
        )
    except CaptureError as error:
        return Rehearsal(planned, _size(source), None, unmetered=str(error))
    return Rehearsal(planned, _size(source), metering)


def _size(source: Source) -> tuple[int, int] | None:
    """Size of the first camera's picture: on some buses it is known only once there is a picture."""
    if source.size is not None:
        return source.size
    able = next(iter(source.cameras.values())).capabilities()
    return (able.width, able.height) if able.width and able.height else None


def nothing_beside(session: Session, plan: PlanRecord, progress: Progress) -> AbstractContextManager[None]:
    """Write nothing, for real cameras: only a simulator knows the truth."""
    return nullcontext()
