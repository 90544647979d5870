"""`rig capture --sim`: a session shot by simulated cameras, with the truth beside it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from capture.automatic import Automatic, meter_rig, plan_automatically
from capture.beginning import begin, folder_made, is_vacant
from capture.deviation import TOLERANCE_STOPS
from capture.lock import sole_writer
from capture.metering import Metering
from capture.planner import Plan, Wanted
from capture.recorder import CaptureResult, Progress, finished, record, slots
from drivers.camera import Camera
from drivers.sim.faults import Mix
from drivers.sim.on_bus import BusRig
from drivers.sim.rigs import SimulatedRig, simulate
from imaging import store
from imaging.dng import Compression
from imaging.errors import CaptureError, InputError
from imaging.exposure import Exposure
from imaging.records import PlanRecord, SessionRecord
from imaging.session import Session

PLAN = "scene"


def capture_simulated(
    name: str,
    out: Path,
    *,
    seed: int = 0,
    frames: int | None = None,
    bracket: tuple[float, ...] | None = None,
    auto: Wanted | None = None,
    resume: bool = False,
    compression: Compression = "none",
    mix: Mix | None = None,
    progress: Progress = lambda message, done, total: None,
) -> CaptureResult:
    """Shoot the simulated rig `name` into the session folder `out`, and write the truth beside it.

    frames: how many positions of the rig, from the first; all of them when None.
    bracket: stops relative to the middle exposure of the rig's own bracket, which is used when None.
    auto: instead of a bracket, what one has to reach that is metered and planned before the first shot.
    resume: take exactly the shots that `out` lacks; the raw files are then those, byte for byte, of
    a capture that was never interrupted. frames and bracket may be left out and are then those of
    the session; with auto they are, too, and nothing is metered again.
    mix: what goes wrong on the bus, at random; truth/faults.jsonl lists what did.

    InputError: no such rig, `out` is not empty, or (resume) holds another capture. CaptureError: the
    scene cannot be metered. StorageError: the disk refuses; what was finished stays.
    """
    if resume and not out.is_dir():
        raise InputError(f"{out} is not a folder: leave --resume out to begin a session there.")
    rig = simulate(name, seed)
    bus = BusRig(rig, mix=mix)
    cameras = {camera.name: device for camera, device in zip(rig.records(), bus.cameras(), strict=True)}
    wanted = _plan(rig, cameras, name, frames, bracket)
    identity = SessionRecord(
        name=out.resolve().name,
        created=datetime.now(UTC),
        origin=f"sim:{name}",
        seed=seed,
        cameras=rig.records(),
    )
    try:
        with folder_made(out), sole_writer(out):
            vacant = is_vacant(out)
            known = None
            if resume and not vacant:
                session = Session.open(out)
                _must_be_the_same(session, identity)
                known = next((plan for plan in session.plans() if plan.plan == PLAN), None)
            if known is None and auto is not None and (vacant or resume):
                wanted = _automatic(rig, cameras, wanted, auto)[0]
            if vacant or not resume:
                session = begin(out, identity)
            if known is None:
                session.append_plan(wanted)
                plan = wanted
            else:
                plan = _continued(session, rig, known, wanted, frames, bracket)
            truth = out / "truth" / "truth.json"
            if truth.exists() and len(finished(session, plan)) < len(slots(plan)):
                store.discard(truth)  # it lists what was applied in every shot, and there will be more
            try:
                result = record(
                    session,
                    plan,
                    cameras,
                    clock=bus.clock,
                    move_to=rig.move_to,
                    compression=compression,
                    progress=progress,
                )
            finally:
                _list_faults(out, bus)
            if not truth.exists():
                rig.write_truth(out, progress)
        return result
    finally:
        for camera in cameras.values():
            camera.close()


@dataclass(frozen=True)
class Rehearsal:
    """What a capture would shoot, and what that is worth.

    metering: None where the cameras cannot be metered, for the reason `unmetered`. plan: of an
    automatic bracket only.
    """

    record: PlanRecord
    width: int
    height: int
    metering: Metering | None
    plan: Plan | None = None
    unmetered: str | None = None


def rehearse_simulated(
    name: str,
    *,
    seed: int = 0,
    frames: int | None = None,
    bracket: tuple[float, ...] | None = None,
    auto: Wanted | None = None,
) -> Rehearsal:
    """Plan what `capture_simulated` would shoot, with the scene metered, and write nothing.

    InputError and CaptureError as there; but a bracket that is given needs no meter.
    """
    rig = simulate(name, seed)
    bus = BusRig(rig)
    cameras = {camera.name: device for camera, device in zip(rig.records(), bus.cameras(), strict=True)}
    try:
        able = rig.cameras[0].capabilities()  # a bus does not tell the size of a picture before there is one
        record = _plan(rig, cameras, name, frames, bracket)
        if auto is not None:
            record, planned = _automatic(rig, cameras, record, auto)
            return Rehearsal(record, able.width, able.height, planned.metering, planned.plan)
        try:
            metering = meter_rig(cameras, rig.bracket[0], frames=record.frames, move_to=rig.move_to)
        except CaptureError as error:
            return Rehearsal(record, able.width, able.height, None, unmetered=str(error))
        return Rehearsal(record, able.width, able.height, metering)
    finally:
        for camera in cameras.values():
            camera.close()


def _automatic(
    rig: SimulatedRig, cameras: Mapping[str, Camera], record: PlanRecord, auto: Wanted
) -> tuple[PlanRecord, Automatic]:
    """The plan with a metered bracket in the place of its own, and why it is that."""
    planned = plan_automatically(cameras, rig.bracket[0], auto, frames=record.frames, move_to=rig.move_to)
    changed = {"bracket": planned.plan.exposures, "reason": planned.reason}
    return record.model_copy(update=changed), planned


def _list_faults(out: Path, bus: BusRig) -> None:
    """What went wrong on the bus in this run, behind what did in earlier ones."""
    if bus.plan.log:
        store.make_folder(out / "truth")
    for one in bus.plan.log:
        told = {"time": round(one.time, 6), "serial": one.serial, "operation": one.operation, "nth": one.nth}
        store.append_line(out / "truth" / "faults.jsonl", told | {"fault": str(one.fault)})


def _plan(
    rig: SimulatedRig,
    cameras: Mapping[str, Camera],
    name: str,
    frames: int | None,
    bracket: tuple[float, ...] | None,
) -> PlanRecord:
    count = rig.frames if frames is None else frames
    if not 1 <= count <= rig.frames:
        raise InputError(
            f"the simulated rig {name} has {rig.frames} positions, not {count}: choose 1 to {rig.frames}."
        )
    if bracket is None:
        exposures, reason = rig.bracket, f"the bracket of the simulated rig {name}"
    else:
        exposures, reason = _exposures(rig, cameras, bracket), "stops given on the command line"
    return PlanRecord(
        plan=PLAN,
        kind="scene",
        created=datetime.now(UTC),
        bracket=exposures,
        frames=tuple(range(count)),
        cameras=tuple(cameras),
        reason=reason,
    )


def _exposures(
    rig: SimulatedRig, cameras: Mapping[str, Camera], bracket: tuple[float, ...]
) -> tuple[Exposure, ...]:
    """The nearest exposures that the cameras have; InputError if one is out of reach or comes twice."""
    if not bracket:
        raise InputError("the bracket is empty: give at least one exposure, as 0 or -2,0,2.")
    middle = sorted(rig.bracket, key=lambda exposure: exposure.stops)[len(rig.bracket) // 2]
    times = next(iter(cameras.values())).capabilities().times
    slack = 2.0**TOLERANCE_STOPS
    chosen: list[Exposure] = []
    for stops in bracket:
        if not math.isfinite(stops) or abs(stops) > 64:
            raise InputError(f"{stops} is no exposure: give stops relative to the middle, as -2,0,2.")
        ideal = middle.with_time(middle.time * 2.0**stops)
        if not times[0] / slack <= ideal.time <= times[-1] * slack:
            least, most = math.log2(times[0] / middle.time), math.log2(times[-1] / middle.time)
            raise InputError(
                f"{stops:+g} stops from {middle} is {ideal}, out of reach of the cameras: "
                f"choose stops between {least:+.1f} and {most:+.1f}."
            )
        nearest = middle.with_time(min(times, key=lambda time: abs(math.log2(time / ideal.time))))
        if nearest in chosen:
            raise InputError(
                f"{stops:+g} stops gives {nearest} a second time: choose stops at least 1/3 apart."
            )
        chosen.append(nearest)
    return tuple(chosen)


def _must_be_the_same(session: Session, wanted: SessionRecord) -> None:
    """A session is completed by the rig that began it, or not at all."""
    there = session.record
    if there.origin != wanted.origin:
        raise InputError(
            f"{session.folder} was captured from {there.origin}, not {wanted.origin}: "
            "resume it with the same rig, or name a new folder."
        )
    if there.seed != wanted.seed:
        raise InputError(
            f"{session.folder} was captured with seed {there.seed}, not {wanted.seed}: "
            "resume it with the same seed, or name a new folder."
        )
    if there.cameras != wanted.cameras:
        raise InputError(
            f"{session.folder} was captured with other cameras than {wanted.origin} has now: "
            "resume it with the version of rig that began it, or name a new folder."
        )


def _continued(
    session: Session,
    rig: SimulatedRig,
    known: PlanRecord,
    wanted: PlanRecord,
    frames: int | None,
    bracket: tuple[float, ...] | None,
) -> PlanRecord:
    """The plan of the session; InputError where what was asked for contradicts it."""
    possible = set(range(rig.frames))
    if not (
        set(known.frames) <= possible and set(known.cameras) <= set(wanted.cameras) and all(known.bracket)
    ):
        raise InputError(
            f"{session.folder / 'plans.jsonl'} plans shots that the rig cannot take: restore the file."
        )
    if frames is not None and wanted.frames != known.frames:
        raise InputError(
            f"{session.folder} was planned with {len(known.frames)} frames, not {frames}: "
            "resume it with the same number, or name a new folder."
        )
    if bracket is not None and wanted.bracket != known.bracket:
        steps = ", ".join(str(exposure) for exposure in known.bracket)
        raise InputError(
            f"{session.folder} was planned with the bracket {steps}: "
            "leave --bracket out to resume it, or name a new folder."
        )
    return known
