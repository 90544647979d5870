"""Cameras driven through a plan, every shot on the disk before the next is taken.

The order on the disk is what makes a capture safe to kill: the file is written whole, then its line
is appended to shots.jsonl. A line therefore always has its file; a file without a line is a shot
that was not finished, and it is taken again.
"""

import hashlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from capture.deviation import deviates, stops_apart
from capture.exposing import Taken, expose
from drivers.camera import Camera
from drivers.clock import THIS_MACHINE, Clock
from imaging import store
from imaging.dng import Compression, encode_dng
from imaging.errors import CameraError, CaptureError, PartialError
from imaging.exposure import Exposure
from imaging.mosaic import RawMosaic
from imaging.records import CameraRecord, PlanRecord, ShotRecord
from imaging.session import Session

Progress = Callable[[str, int, int], None]

GIVE_UP_AFTER = 3
"""Shots that a camera may miss in a row before the run goes on without it."""


class Slot(NamedTuple):
    """A shot of a plan: which camera, at which frame, at which step of the bracket."""

    camera: str
    frame: int
    step: int

    def __str__(self) -> str:
        return f"{self.camera}, frame {self.frame}, step {self.step}"


@dataclass(frozen=True)
class CaptureResult:
    """What a capture came to.

    session: its folder. planned: shots of the plan. taken: by this run. kept: by earlier runs.
    missing: a sentence for each shot that is not there. problems: for each shot that is there,
    but not as it was asked for.
    """

    session: Path
    planned: int
    taken: int
    kept: int
    missing: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()

    def require_complete(self) -> None:
        """PartialError that lists what is missing, if anything is."""
        if self.missing:
            raise PartialError(
                f"{self.session}: {len(self.missing)} of {self.planned} shots are missing "
                f"({'; '.join(self.missing)}): repeat the command with --resume to take them."
            )


def slots(plan: PlanRecord) -> list[Slot]:
    """Every shot of a plan in the order of shooting: all cameras expose the same step together."""
    return [
        Slot(camera, frame, step)
        for frame in plan.frames
        for step in range(len(plan.bracket))
        for camera in plan.cameras
    ]


def finished(session: Session, plan: PlanRecord) -> dict[Slot, ShotRecord]:
    """The shots of a plan that are recorded and whose file is there."""
    return {
        Slot(shot.camera, shot.frame, shot.step): shot
        for shot in session.shots()
        if shot.plan == plan.plan and session.file(shot).is_file()
    }


def record(
    session: Session,
    plan: PlanRecord,
    cameras: Mapping[str, Camera],
    *,
    clock: Clock = THIS_MACHINE,
    move_to: Callable[[int], None] = lambda frame: None,
    compression: Compression = "none",
    progress: Progress = lambda message, done, total: None,
) -> CaptureResult:
    """Take the shots of `plan` that are not finished; those that are stay as they are.

    cameras: by the names of the plan. clock: the one that their drivers were given. move_to: brings rig
    or scene to a frame, before its first shot. progress: called with the file of each shot once it is
    finished, shots done, shots planned.
    A camera that fails is retried, then left out; what is missing is in the result. StorageError
    when the disk refuses: everything finished stays, and another call goes on from there. CaptureError
    if a camera is not the one that the session knows by its name.
    """
    for name in plan.cameras:
        _must_be(cameras[name], session.camera(name))
    planned = slots(plan)
    for leftover in leftovers(session):
        store.discard(leftover)
    done = finished(session, plan)
    kept = len([slot for slot in planned if slot in done])
    problems: list[str] = []
    missing: dict[Slot, str] = {}
    failures = dict.fromkeys(plan.cameras, 0)
    progress("shooting", kept, len(planned))
    for frame in plan.frames:
        open_slots = [slot for slot in planned if slot.frame == frame and slot not in done]
        if not open_slots:
            continue
        move_to(frame)
        for step in dict.fromkeys(slot.step for slot in open_slots):
            wanted = [slot.camera for slot in open_slots if slot.step == step]
            trusted = {name: cameras[name] for name in wanted if failures[name] < GIVE_UP_AFTER}
            requested = _known(plan.bracket[step])
            taken, errors = expose(trusted, requested)
            skews = _skews(taken, together=len(wanted) == len(plan.cameras))
            for name, shot in taken.items():
                slot = Slot(name, frame, step)
                done[slot] = _store(session, plan, slot, requested, shot, skews[name], compression)
                if deviates(shot.reported, requested):
                    problems.append(_deviation(slot, requested, shot.reported))
                failures[name] = 0
                progress(done[slot].file, len(done), len(planned))
            for name in wanted:
                if name not in taken:
                    failures[name] += 1
                    reason = str(errors[name]) if name in errors else "given up after failing before"
                    missing[Slot(name, frame, step)] = reason.rstrip(".")
    return CaptureResult(
        session=session.folder,
        planned=len(planned),
        taken=len(done) - kept,
        kept=kept,
        missing=tuple(f"{slot}: {reason}" for slot, reason in missing.items()),
        problems=tuple(problems),
    )


def _must_be(camera: Camera, known: CameraRecord) -> None:
    """Cables get swapped: names stand for serial numbers. A camera that does not answer fails later."""
    with suppress(CameraError):
        serial = camera.identify().serial
        if serial != known.serial:
            raise CaptureError(
                f"the camera in the place of {known.name} has the serial number {serial!r}, "
                f"not {known.serial!r}: "
                "connect the one that began the session, or begin a new one."
            )


def _known(requested: Exposure | None) -> Exposure:
    if requested is None:
        raise ValueError("a plan to be shot names every exposure")
    return requested


def _skews(taken: Mapping[str, Taken], *, together: bool) -> dict[str, float | None]:
    """Seconds after the first trigger; unknown where part of the rig exposed in another run."""
    first = min((shot.opened for shot in taken.values()), default=0.0)
    return {name: shot.opened - first if together else None for name, shot in taken.items()}


def _deviation(slot: Slot, requested: Exposure, reported: Exposure) -> str:
    apart = stops_apart(reported, requested)
    return f"{slot}: the camera reports {reported} where {requested} was asked for ({apart:+.2f} stops)"


def _store(
    session: Session,
    plan: PlanRecord,
    slot: Slot,
    requested: Exposure,
    taken: Taken,
    skew: float | None,
    compression: Compression,
) -> ShotRecord:
    """File first, line second. The hash is of the bytes that were meant, so that `check` proves the disk."""
    frame = taken.frame
    if isinstance(frame, RawMosaic):
        data, suffix = encode_dng(frame, compression), "dng"
        height, width = frame.pixels.shape
    else:
        data, suffix = frame.data, frame.suffix.lstrip(".").lower()
        height, width = frame.height, frame.width
    file = shot_file(slot, suffix)
    store.write_bytes(session.folder / file, data)
    shot = ShotRecord(
        kind=plan.kind,
        plan=plan.plan,
        camera=slot.camera,
        frame=slot.frame,
        step=slot.step,
        file=file,
        sha256=hashlib.sha256(data).hexdigest(),
        requested=requested,
        reported=taken.reported,
        width=width,
        height=height,
        captured_at=frame.metadata.captured_at or datetime.now(UTC),
        skew=skew,
        retries=taken.retries,
    )
    session.append_shot(shot)
    return shot


def shot_file(slot: Slot, suffix: str) -> str:
    """Where the file of a shot stands, relative to the session folder."""
    return f"raw/{slot.frame:04d}/{slot.camera}_{slot.step}.{suffix}"


def leftovers(session: Session) -> list[Path]:
    """What a killed capture left half-written: beside the records and in the folders of the frames."""
    frames = [folder for folder in (session.folder / "raw").glob("*/") if not folder.is_symlink()]
    return [part for folder in [session.folder, *sorted(frames)] for part in store.leftovers(folder)]
