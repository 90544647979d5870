"""Conversion of a request to a line of plans.jsonl: the scene, darks, flats or the board."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from math import isfinite
from typing import Literal

from capture.bracket.automatic import Automatic, meter_rig, plan_automatically
from capture.bracket.deviation import deviates
from capture.bracket.fixed_exposures import (
    STILL,
    exposures_around,
    flat_levels,
    middle_exposure,
    single_exposures,
)
from capture.bracket.goals import BracketGoals
from capture.bracket.metering.meter import Metering
from capture.record.source import Source
from capture.request import CaptureRequest, Stops
from imaging.choices import Subject
from imaging.errors import InputError
from imaging.optics.exposure import Exposure
from imaging.progress import Progress, unreported
from imaging.session.records import PlanRecord

NAMES: dict[Subject, str] = {"scene": "scene", "dark": "darks", "flat": "flats", "board": "board"}
REPEATS: dict[Subject, int] = {"dark": 16, "flat": 16, "board": 20}
"""Frames where no number is asked for. The mean of 16 darks has a quarter of their read noise; 8 pairs of
flats measure the variance of every level; a board is shown in all corners and at all tilts in 20 poses."""


def plan_for(
    source: Source,
    request: CaptureRequest,
    plans: Sequence[PlanRecord],
    progress: Progress = unreported,
) -> tuple[PlanRecord, Automatic | None]:
    """The plan that is to follow `plans` in a session, and how its bracket was planned, if it was.

    Exposures that are not given are metered, and `progress` shows the probes. InputError and CaptureError for
    impossible requests.
    """
    frames = _frames(source, request, plans)
    bracket: tuple[Exposure, ...] | Stops | BracketGoals | None = request.bracket
    if bracket is None and request.kind == "scene":
        bracket = source.bracket
    _must_have(source, source.bracket if bracket is None and request.kind == "dark" else bracket)
    automatic: Automatic | None = None
    exposures: tuple[Exposure, ...] = ()
    bands: tuple[str, ...] = ()
    if bracket is not None and request.kind == "scene" and source.wheel:
        for band in source.wheel:
            if isinstance(bracket, BracketGoals) or not (source.middle or _is_exact(bracket)):
                source.operator.turn_to(band)  # to be metered
            chosen, reason, automatic = _asked(source, request, bracket, frames, progress)
            exposures, bands = (*exposures, *chosen), (*bands, *[band] * len(chosen))
    elif bracket is not None:
        exposures, reason, automatic = _asked(source, request, bracket, frames, progress)
    elif request.kind == "dark":
        exposures, reason = _darks(source, plans, frames)
    elif request.kind == "flat":
        targets = _metered(source, "flat", frames, progress).targets
        exposures = flat_levels(targets, single_exposures(source.cameras, source.f_number))
        full = max(target.bright for target in targets) * exposures[-1].scale
        reason = f"metered: levels down from {full:.0%} of white, where the camera that sees most light is"
    else:
        metering = _metered(source, "board", frames, progress)
        exposures = (
            middle_exposure(metering.targets, single_exposures(source.cameras, source.f_number, STILL)),
        )
        reason = "metered for the middle of the scene, short enough for a hand-held board"
    plan = PlanRecord(
        plan=_name(request.kind, plans),
        kind=request.kind,
        created=datetime.now(UTC),
        bracket=exposures,
        frames=frames,
        cameras=tuple(source.cameras),
        reason=reason,
        bands=bands,
        asked=asked_for(bracket),
        board=source.board if request.kind == "board" else None,
        tolerance=source.tolerance if isfinite(source.tolerance) else None,
    )
    return plan, automatic


def _asked(
    source: Source,
    request: CaptureRequest,
    bracket: tuple[Exposure, ...] | Stops | BracketGoals,
    frames: Sequence[int],
    progress: Progress,
) -> tuple[tuple[Exposure, ...], str, Automatic | None]:
    """The exposures that a bracket comes to with what is before the cameras now, why, and how planned."""
    if isinstance(bracket, BracketGoals):
        source.operator.show(request.kind)
        automatic = plan_automatically(
            source.cameras,
            like(source),
            bracket,
            frames=metered_at(source, request.kind, frames),
            move_to=source.operator.move_to,
            progress=progress,
        )
        return automatic.plan.exposures, automatic.reason, automatic
    reason = (
        f"the bracket of {source.called}" if request.bracket is None else "stops given on the command line"
    )
    return _given(source, request.kind, bracket, frames, progress), reason, None


def asked_for(bracket: tuple[Exposure, ...] | Stops | BracketGoals | None) -> str | None:
    """A bracket in the words in which it was asked for; None where it was not."""
    if isinstance(bracket, BracketGoals):
        limits = [f"{name} {value:g}" for name, value in asdict(bracket).items() if value is not None]
        return ", ".join(["auto", *limits]).replace("_", " ")
    stops = [stop for stop in bracket or () if isinstance(stop, int | float)]
    return f"stops {', '.join(f'{stop:g}' for stop in stops)}" if stops else None


def like(source: Source) -> Exposure:
    """Return what the meter takes the f-number from."""
    return source.middle or Exposure(time=1.0, f_number=source.f_number)


def metered_at(source: Source, kind: Subject, frames: Sequence[int]) -> Sequence[int]:
    """Return where the meter looks: a person is not asked to move things to and fro for it."""
    return frames if kind == "scene" and source.positions is not None else frames[:1]


def _metered(source: Source, kind: Subject, frames: Sequence[int], progress: Progress) -> Metering:
    source.operator.show(kind)
    return meter_rig(
        source.cameras,
        like(source),
        frames=metered_at(source, kind, frames),
        move_to=source.operator.move_to,
        progress=progress,
    )


def _given(
    source: Source,
    kind: Subject,
    bracket: tuple[Exposure, ...] | Stops,
    frames: Sequence[int],
    progress: Progress = unreported,
) -> tuple[Exposure, ...]:
    """Exposures as given, or stops around the middle one, which is metered if it is not given."""
    exposures = tuple(exposure for exposure in bracket if isinstance(exposure, Exposure))
    if exposures:
        return exposures
    stops = [stop for stop in bracket if not isinstance(stop, Exposure)]
    middle = source.middle
    if middle is None:
        if kind == "dark":
            raise InputError(
                f"{source.called} does not say which exposure stops count from, and in the dark it cannot be "
                'metered: add time = "1/60" to its [bracket].'
            )
        candidates = single_exposures(source.cameras, source.f_number)
        if source.iso is not None:
            candidates = tuple(one.model_copy(update={"iso": source.iso}) for one in candidates)
        middle = middle_exposure(_metered(source, kind, frames, progress).targets, candidates)
    return exposures_around(middle, stops, source.cameras)


def _must_have(source: Source, bracket: tuple[Exposure, ...] | Stops | BracketGoals | None) -> None:
    """InputError if a camera lacks the f-number of the source, or the ISO of its stops."""
    f_number, middle = like(source).f_number, source.middle
    iso = source.iso if middle is None else middle.iso
    if bracket is None or isinstance(bracket, BracketGoals) or _is_exact(bracket):
        iso = None
    for name, camera in source.cameras.items():
        able = camera.capabilities()
        if iso is not None and middle is None and not able.isos:
            raise InputError(f"{source.called} asks for ISO {iso:g}, which {name} lacks: leave iso out.")
        asks = f"{source.called} asks for"
        _must_be_among(able.f_numbers, "f_number", f_number, f"{asks} f/", name)
        _must_be_among(able.isos, "iso", iso, f"{asks} ISO ", name)


def _must_be_among(
    choices: Sequence[float], dial: Literal["f_number", "iso"], wanted: float | None, asks: str, name: str
) -> None:
    """InputError if a camera that states choices of a dial has none that is near what is wanted."""
    known = sorted(choice for choice in choices if choice > 0)
    if wanted is None or not known:
        return
    exposure = Exposure(time=1.0).model_copy(update={dial: wanted})
    if all(deviates(exposure.model_copy(update={dial: choice}), exposure) for choice in known):
        sign = "f/" if dial == "f_number" else ""
        raise InputError(
            f"{asks}{wanted:g}, which {name} lacks: "
            f"choose one from {sign}{known[0]:g} to {sign}{known[-1]:g}."
        )


def _darks(
    source: Source, plans: Sequence[PlanRecord], frames: Sequence[int]
) -> tuple[tuple[Exposure, ...], str]:
    """All exposures of the scene; before there is one, those that it will have, if they are known."""
    scene = [exposure for plan in plans if plan.kind == "scene" for exposure in plan.bracket if exposure]
    if scene:
        return tuple(dict.fromkeys(scene)), "the exposures of the scene"
    if isinstance(source.bracket, BracketGoals) or (source.middle is None and not _is_exact(source.bracket)):
        raise InputError(
            "the darks need the exposures of the scene, which is not shot yet: "
            "shoot the scene first, or give exposures as --bracket -4,0,4."
        )
    return _given(source, "dark", source.bracket, frames), f"the bracket of {source.called}"


def _is_exact(bracket: tuple[Exposure, ...] | Stops) -> bool:
    return any(isinstance(exposure, Exposure) for exposure in bracket)


def _frames(source: Source, request: CaptureRequest, plans: Sequence[PlanRecord]) -> tuple[int, ...]:
    """Numbers that no earlier plan has, since a frame's folder holds one shot of a camera and a step.

    A rig whose frames are positions keeps the numbers of these for the scene.
    """
    free = 1 + max((frame for plan in plans for frame in plan.frames), default=-1)
    if request.kind != "scene":
        first = max(free, source.positions or 0)
        count = REPEATS[request.kind] if request.frames is None else request.frames
        return tuple(range(first, first + count))
    count = source.frames if request.frames is None else request.frames
    if source.positions is None:
        return tuple(range(free, free + count))
    if not 1 <= count <= source.positions:
        raise InputError(
            f"{source.called} has {source.positions} positions, not {count}: choose 1 to {source.positions}."
        )
    return tuple(range(count))


def _name(kind: Subject, plans: Sequence[PlanRecord]) -> str:
    """`darks`, then `darks-2`."""
    taken = len([plan for plan in plans if plan.kind == kind])
    return NAMES[kind] if not taken else f"{NAMES[kind]}-{taken + 1}"
