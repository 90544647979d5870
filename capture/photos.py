"""`rig import`: a session made of photographs that exist, copied byte for byte."""

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from capture.beginning import begin, folder_made, is_vacant
from capture.deviation import deviates
from capture.grouping import Bracket, sort_into_cameras, split_into_brackets
from capture.lock import sole_writer
from capture.originals import Original, Progress, shown, survey
from capture.recorder import Slot, shot_file
from imaging import store
from imaging.errors import InputError, PartialError, StorageError
from imaging.exposure import Exposure
from imaging.records import CameraRecord, PlanRecord, SessionRecord, ShotRecord
from imaging.session import Session

ORIGIN = "import"


@dataclass(frozen=True)
class ImportResult:
    """What an import came to. guesses: a sentence each; missing: a sentence for each file left out."""

    session: Path
    cameras: int
    frames: int
    shots: int
    guesses: tuple[str, ...]
    missing: tuple[str, ...] = ()

    def require_complete(self) -> None:
        """PartialError that lists what is missing, if anything is."""
        if self.missing:
            raise PartialError(
                f"{self.session}: {len(self.missing)} of {self.shots + len(self.missing)} photos are missing "
                f"({'; '.join(self.missing)}): mend those files and import again into a new folder."
            )


@dataclass(frozen=True)
class _Place:
    """Where an original goes: its shot, and the plan that this belongs to."""

    original: Original
    slot: Slot
    plan: str


def import_photos(
    folder: Path,
    out: Path,
    *,
    bracket: int | None = None,
    progress: Progress = lambda message, done, total: None,
) -> ImportResult:
    """Make a session at `out` of the photographs in `folder` and its subfolders; these stay untouched.

    bracket: so many consecutive photographs of a camera are one bracket; guessed when None.
    An import that was killed is completed by the same call. InputError when `folder` holds nothing
    usable, or `out` is not empty or inside `folder`; StorageError when the disk refuses; both leave
    nothing behind. Files that cannot be read are listed in the result.
    """
    _check_folders(folder, out, bracket)
    found = survey(folder, progress)
    if not any(original.picture for original in found.originals):
        raise _nothing_usable(folder, found.originals)
    series, guesses = sort_into_cameras(folder, found.originals)
    places: list[_Place] = []
    plans: list[PlanRecord] = []
    for one in series:
        brackets, why = split_into_brackets(one, bracket)
        guesses.append(why)
        new_plans = _plans(one.camera, brackets, why)
        plans.extend(new_plans)
        places.extend(_places(one.camera, brackets, new_plans))
    cameras = tuple(one.camera for one in series)
    with folder_made(out), sole_writer(out):
        session, begun_here = _session(out, cameras, plans, places)
        try:
            _append_plans(session, plans)
            unread = _copy_all(session, places, progress)
        except BaseException as error:
            if begun_here and not isinstance(error, KeyboardInterrupt):
                _remove(out)
            raise
    unreadable = [original.error for original in found.originals if original.error is not None]
    return ImportResult(
        session=out,
        cameras=len(cameras),
        frames=len({place.slot.frame for place in places}),
        shots=len([place for place in places if place.original.picture]) - len(unread),
        guesses=(*found.notes, *guesses),
        missing=(*unreadable, *unread),
    )


def _check_folders(folder: Path, out: Path, bracket: int | None) -> None:
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: name the folder that holds the photographs.")
    if out.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{out} lies inside {folder}: name a folder outside of the photographs.")
    if bracket is not None and bracket < 1:
        raise InputError(f"a bracket of {bracket} photos is none: give 1 or more.")


def _nothing_usable(folder: Path, originals: Sequence[Original]) -> InputError:
    if not originals:
        return InputError(
            f"{folder} holds no RAW, JPEG, PNG, TIFF or EXR file: name a folder of photographs."
        )
    names = "; ".join(str(original.error) for original in originals[:3])
    more = f"; and {len(originals) - 3} more" if len(originals) > 3 else ""
    return InputError(f"{folder} holds no photograph that can be read ({names}{more}): copy them again.")


def _plans(camera: CameraRecord, brackets: Sequence[Bracket], why: str) -> list[PlanRecord]:
    """One plan for each length of bracket; frames count from 0 in order."""
    plans = []
    for size in sorted({len(bracket) for bracket in brackets}):
        mine = {frame: bracket for frame, bracket in enumerate(brackets) if len(bracket) == size}
        plans.append(
            PlanRecord(
                plan=f"{ORIGIN}-{camera.name}-{size}",
                kind="scene",
                created=datetime.now(UTC),
                bracket=tuple(_agreed([bracket[step] for bracket in mine.values()]) for step in range(size)),
                frames=tuple(mine),
                cameras=(camera.name,),
                reason=why,
            )
        )
    return plans


def _agreed(originals: Sequence[Original]) -> Exposure | None:
    """The exposure that all of them have; None where they differ or one is unknown."""
    readable = [original.exposure for original in originals if original.picture is not None]
    first = readable[0] if readable else None
    same = first is not None and all(one is not None and not deviates(one, first) for one in readable)
    return first if same else None


def _places(camera: CameraRecord, brackets: Sequence[Bracket], plans: Sequence[PlanRecord]) -> list[_Place]:
    plan_of = {frame: plan.plan for plan in plans for frame in plan.frames}
    return [
        _Place(original, Slot(camera.name, frame, step), plan_of[frame])
        for frame, bracket in enumerate(brackets)
        for step, original in enumerate(bracket)
    ]


def _session(
    out: Path, cameras: tuple[CameraRecord, ...], plans: Sequence[PlanRecord], places: Sequence[_Place]
) -> tuple[Session, bool]:
    """A new session, or the one that a killed import of the same photographs left; and whether it is new."""
    if not is_vacant(out) and (out / "session.json").exists():
        session = Session.open(out)
        if _is_unfinished(session, cameras, plans, places):
            return session, False
    record = SessionRecord(name=out.resolve().name, created=datetime.now(UTC), origin=ORIGIN, cameras=cameras)
    return begin(out, record), True


def _append_plans(session: Session, plans: Sequence[PlanRecord]) -> None:
    known = {plan.plan for plan in session.plans()}
    for plan in plans:
        if plan.plan not in known:
            session.append_plan(plan)


def _is_unfinished(
    session: Session,
    cameras: tuple[CameraRecord, ...],
    plans: Sequence[PlanRecord],
    places: Sequence[_Place],
) -> bool:
    """Whether all that the session holds is a part, not the whole, of this import."""
    sources = {(p.plan, *p.slot): shown(p.original.path) for p in places if p.original.picture is not None}
    shots = {shot.identity: shot.source for shot in session.shots()}
    wanted = {plan.plan: (plan.bracket, plan.frames, plan.cameras) for plan in plans}
    there = {plan.plan: (plan.bracket, plan.frames, plan.cameras) for plan in session.plans()}
    return (
        session.record.origin == ORIGIN
        and session.record.cameras == cameras
        and there.items() <= wanted.items()
        and shots.items() <= sources.items()
        and len(shots) < len(sources)
    )


def _copy_all(session: Session, places: Sequence[_Place], progress: Progress) -> list[str]:
    """Copy what is not there yet, camera by camera; a sentence for each file that vanished meanwhile."""
    have = {shot.identity for shot in session.shots() if session.file(shot).is_file()}
    usable = [place for place in places if place.original.picture is not None]
    unread: list[str] = []
    for number, place in enumerate(usable):
        progress(f"copying {shown(place.original.path.name)}", number, len(usable))
        if (place.plan, *place.slot) not in have:
            try:
                data = place.original.path.read_bytes()
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                unread.append(f"{shown(place.original.path)} could not be read ({reason})")
                continue
            _copy(session, place, data)
    progress("copied", len(usable), len(usable))
    return unread


def _copy(session: Session, place: _Place, data: bytes) -> None:
    """File first, line second, as the recorder does."""
    original, slot = place.original, place.slot
    assert original.picture is not None
    file = shot_file(slot, original.path.suffix.lower().lstrip("."))
    store.write_bytes(session.folder / file, data)
    session.append_shot(
        ShotRecord(
            kind="scene",
            plan=place.plan,
            camera=slot.camera,
            frame=slot.frame,
            step=slot.step,
            file=file,
            sha256=hashlib.sha256(data).hexdigest(),
            reported=original.exposure,
            width=original.picture.width,
            height=original.picture.height,
            captured_at=original.picture.metadata.captured_at,
            source=shown(original.path),
        )
    )


def _remove(out: Path) -> None:
    """Take back an import that failed: the folder was vacant before, and the originals are untouched."""
    with suppress(StorageError):  # the failure that led here is the one to tell
        for entry in out.iterdir():
            store.discard(entry)
