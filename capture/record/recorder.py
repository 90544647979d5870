"""Cameras driven through a plan, every shot written while the next is taken.

The order on the disk is what makes a capture safe to kill: the file is written whole, then its line
is appended to shots.jsonl. A line therefore always has its file; a file without a line is a shot
that was not finished, and it is taken again.
"""

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path

from capture.record.capture_result import CaptureResult
from capture.record.capture_run import CaptureRun
from capture.record.shot_files import must_decode, save_frame
from capture.record.threads.capture_threads import CaptureThreads
from capture.record.threads.memory_budget import MemoryBudget
from drivers.camera import Camera
from drivers.clock import THIS_MACHINE, Clock
from imaging.choices import Compression
from imaging.errors import CameraError, CaptureError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.records import CameraRecord, PlanRecord
from imaging.session.session import Session


def record(
    session: Session,
    plan: PlanRecord,
    cameras: Mapping[str, Camera],
    *,
    clock: Clock = THIS_MACHINE,
    move_to: Callable[[int], None] = lambda frame: None,
    turn_to: Callable[[str], None] = lambda band: None,
    compression: Compression = "none",
    progress: Progress = unreported,
    tolerance: float = math.inf,
    leader: str | None = None,
) -> CaptureResult:
    """Take the shots of `plan` that are not finished; those that are stay as they are.

    A thread a camera: all that are to expose a step wait for one another before they are triggered, and none
    for another's download. What a frame lacks is taken again at its end, RETRIES times, then left out; what
    is missing is in the result, also when the disk refuses after the first shot: another call goes on from
    there.

    Args:
        session: Session that has the plan.
        plan: Plan.
        cameras: Cameras by the names of the plan, and the leader.
        clock: Clock that their drivers were given.
        move_to: Callback that brings rig or scene to a frame, before its first shot.
        turn_to: Callback that brings a filter of the wheel before every camera, if the plan has bands.
        compression: Compression of the RAW files.
        progress: Callback for the file of each shot once it is finished, the shots done, and those planned.
        tolerance: Time between the shutters of a step, s, beyond which the result's problems say so.
        leader: Camera whose exposure triggers all others by a wire, if one does; it exposes along whenever
            one of them is to, and a frame of its own that is there already stays.

    Returns:
        The number of shots, and what is missing or deviates.

    Raises:
        StorageError: The disk refuses before the first shot.
        CaptureError: A camera is not the one that the session knows by its name.
    """
    names = plan.cameras if leader is None else dict.fromkeys([*plan.cameras, leader])
    taking_part = {name: cameras[name] for name in names}
    for name, camera in taking_part.items():
        _must_be(camera, session.camera(name))
    for leftover in leftovers(session):
        store.discard(leftover)
    run = CaptureRun(session, plan, clock, progress, tolerance, leader)
    save, prove = partial(save_frame, session, compression), partial(must_decode, session)
    progress("shooting", run.earlier, len(run.planned))
    if any(shot not in run.done for shot in run.planned):
        budget = MemoryBudget(clock)
        with (
            clock.worker("recorder"),
            CaptureThreads(taking_part, clock, save, prove, run.state, budget) as threads,
        ):
            for frame in run.frames():
                move_to(frame)
                for band, steps in run.filters(frame):
                    if band is not None:
                        turn_to(band)
                    run.take(frame, steps, threads)
            return run.result()
    return run.result()


def _must_be(camera: Camera, recorded: CameraRecord) -> None:
    """Check the serial numbers behind the names: cables get swapped. A camera that does not answer fails
    later.
    """
    with suppress(CameraError):
        serial = camera.identify().serial
        if serial != recorded.serial:
            raise CaptureError(
                f"the camera in the place of {recorded.name} has the serial number {serial!r}, "
                f"not {recorded.serial!r}: "
                "connect the one that began the session, or begin a new one."
            )


def leftovers(session: Session) -> list[Path]:
    """Return what a killed capture left half-written: beside the records and in the folders of the frames."""
    frames = [folder for folder in (session.folder / "raw").glob("*/") if not folder.is_symlink()]
    return [part for folder in [session.folder, *sorted(frames)] for part in store.leftovers(folder)]
