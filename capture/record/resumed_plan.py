"""A session is completed by the cameras that began it, and with the plan that it has."""

from collections.abc import Callable, Sequence

from capture.bracket.fixed_exposures import exposures_around
from capture.bracket.goals import BracketGoals
from capture.record.session_plan import asked_for
from capture.record.source import Source
from capture.request import CaptureRequest
from imaging.errors import InputError
from imaging.session.records import CameraRecord, PlanRecord, SessionRecord
from imaging.session.session import Session


def must_be_the_same(session: Session, wanted: SessionRecord) -> None:
    """InputError that says in what the cameras of a session are others than these."""
    there = session.record
    by_name = there.origin == wanted.origin or (_is_rig_file(there.origin) and _is_rig_file(wanted.origin))
    if not by_name:
        raise InputError(
            f"{session.folder} was captured from {there.origin}, not {wanted.origin}: "
            "resume it with the same rig, or name a new folder."
        )
    if there.seed != wanted.seed:
        raise InputError(
            f"{session.folder} was captured with seed {there.seed}, not {wanted.seed}: "
            "resume it with the same seed, or name a new folder."
        )
    if there.bands != wanted.bands and there.cameras == wanted.cameras:
        had, has = (", ".join(band.name for band in one.bands) or "none" for one in (there, wanted))
        raise InputError(
            f"{session.folder} was captured through the filters {had}, and {wanted.origin} now has {has}: "
            "resume it with the rig file that began it, or name a new folder."
        )
    if not _is_rig_file(there.origin):
        if there.cameras != wanted.cameras:
            raise InputError(
                f"{session.folder} was captured with other cameras than {wanted.origin} has now: "
                "resume it with the version of rig that began it, or name a new folder."
            )
        return
    recorded, given = ({each.name: _summary(each) for each in record.cameras} for record in (there, wanted))
    for name in {**recorded, **given}:
        had, has = (cameras.get(name, f"no camera {name}") for cameras in (recorded, given))
        if had != has:
            raise InputError(
                f"{session.folder} was captured with {had}, and {wanted.origin} now has {has}: "
                "resume it with the rig file that began it, or name a new folder."
            )


def _is_rig_file(origin: str) -> bool:
    """A file may be called otherwise the next time; its cameras are what counts."""
    return origin != "import" and not origin.startswith("sim:")


def _summary(camera: CameraRecord) -> str:
    """All that has to be the same again."""
    rig = "no rig" if camera.rig is None else f"rig {camera.rig}"
    band = "" if camera.band is None else f", behind {camera.band}"
    return f"{camera.name} as {camera.serial} ({camera.kind}, {rig}{band})"


def continued(
    session: Session,
    source: Source,
    request: CaptureRequest,
    plans: Sequence[PlanRecord],
    say: Callable[[str], None],
) -> PlanRecord | None:
    """The last plan of the kind that is requested.

    Args:
        session: Session to complete.
        source: Cameras, and what is usual with them.
        request: Options of the capture.
        plans: Plans of the session, in order.
        say: Callback for a line that says so where the rig's usual bracket is now another.

    Returns:
        The plan; None if there is no such plan.

    Raises:
        InputError: The request contradicts the plan, or the rig cannot take its shots.
    """
    last = next((plan for plan in reversed(plans) if plan.kind == request.kind), None)
    if last is None:
        return None
    within = source.positions is None or last.kind != "scene" or max(last.frames) < source.positions
    if not (within and set(last.cameras) <= set(source.cameras) and all(last.bracket)):
        raise InputError(
            f"{session.folder / 'plans.jsonl'} plans shots that the rig cannot take: restore the file."
        )
    if request.frames is not None and request.frames != len(last.frames):
        raise InputError(
            f"{session.folder} was planned with {len(last.frames)} frames, not {request.frames}: "
            "resume it with the same number, or name a new folder."
        )
    _must_be_the_bracket(session, source, request, last)
    usual = asked_for(source.bracket) if request.kind == "scene" and request.bracket is None else None
    if usual is not None and usual != last.asked:
        say(f"{session.folder} continues as planned, with {_bracket(last)}; {source.called} now has {usual}.")
    return last


def _must_be_the_bracket(session: Session, source: Source, request: CaptureRequest, plan: PlanRecord) -> None:
    """InputError if a bracket is asked for that is not the one of the plan."""
    asked = request.bracket
    if asked is None or asked_for(asked) == plan.asked:
        return
    middle = source.middle
    if (
        middle
        and not isinstance(asked, BracketGoals)
        and exposures_around(middle, asked, source.cameras) * max(1, len(source.wheel)) == plan.bracket
    ):
        return
    raise InputError(
        f"{session.folder} was planned with the bracket {_bracket(plan)}: "
        f"leave --bracket out to resume it, or name a new folder for {asked_for(asked)}."
    )


def _bracket(plan: PlanRecord) -> str:
    """`auto, snr 20 (1/60 s, 1/4 s)`."""
    steps = ", ".join(str(exposure) for exposure in plan.bracket)
    return f"{plan.asked} ({steps})" if plan.asked else steps
