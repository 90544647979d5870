"""`rig capture --sim`: a session shot by simulated cameras, with the truth beside it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from os import PathLike
from pathlib import Path

from capture.record.capture_result import CaptureResult
from capture.record.capture_run import finished, planned_shots
from capture.record.shooting import Say, shoot
from capture.record.source import Source
from capture.request import CaptureRequest
from drivers.sim.bus_rig import BusRig
from drivers.sim.faults import Mix
from drivers.sim.rigs import SimulatedRig, simulate
from drivers.sim.truth import write_truth
from imaging.arguments import checked
from imaging.errors import PartialError, StorageError
from imaging.files import store
from imaging.progress import Progress, unreported
from imaging.session.bands import in_order
from imaging.session.records import Board, PlanRecord
from imaging.session.session import Session

_DEFAULTS = CaptureRequest()


@checked
def capture_simulated(
    name: str,
    out: str | PathLike[str],
    request: CaptureRequest = _DEFAULTS,
    *,
    seed: int = 0,
    mix: Mix | None = None,
    on_progress: Progress = unreported,
    on_message: Say = lambda line: None,
    **options: object,
) -> CaptureResult:
    """Shoot with a simulated rig into a session folder, and write the truth beside it.

    Args:
        name: Name of the rig.
        out: Session folder: vacant, or a session of the same rig.
        request: Options; with `resume` the RAW files are byte for byte those of an uninterrupted capture.
        seed: Seed of lenses, colours, sensors and noise.
        mix: Random faults of the bus; truth/faults.jsonl lists those that occurred.
        on_progress: Callback for the current step, the steps done, and all of them.
        on_message: Callback for lines that a person should read.
        options: Options by name, in place of those of `request`.

    Returns:
        The shots taken, kept and missing.

    Raises:
        InputError: There is no such rig, `out` is not empty, or (resume) holds another capture.
        CaptureError: The scene cannot be metered.
        StorageError: The disk refuses; finished shots stay.
    """
    with simulated_source(name, seed, mix) as source:
        return shoot(source, Path(out), request, progress=on_progress, say=on_message)


@contextmanager
def simulated_source(name: str, seed: int = 0, mix: Mix | None = None) -> Iterator[Source]:
    """The simulated rig `name` on a bus of its own; mix: see `capture_simulated`. InputError: no such rig."""
    rig = simulate(name, seed)
    bus = BusRig(rig, mix=mix)
    records = rig.records()
    able = rig.cameras[0].capabilities()  # a bus does not state the size of a picture before there is one
    middle = sorted(rig.bracket, key=lambda exposure: exposure.stops)[len(rig.bracket) // 2]
    source = Source(
        called=f"the simulated rig {name}",
        origin=f"sim:{name}",
        seed=seed,
        records=records,
        cameras={record.name: camera for record, camera in zip(records, bus.cameras(), strict=True)},
        clock=bus.clock,
        operator=rig,
        bracket=rig.bracket,
        middle=middle,
        f_number=middle.f_number,
        iso=middle.iso,
        positions=rig.frames,
        frames=rig.frames,
        leader=None,
        tolerance=math.inf,
        size=(able.width, able.height),
        board=Board.model_validate(rig.board.description()),
        beside=partial(_truth, rig, bus),
        pixels={record.name: able.width * able.height for record in records},
        bands=in_order(rig.settings.wheel),
        wheel=tuple(band.name for band in rig.settings.wheel),
        turntable=rig.turntable,
        lamps=rig.lamps,
    )
    try:
        yield source
    finally:
        source.close()


@contextmanager
def _truth(
    rig: SimulatedRig, bus: BusRig, session: Session, plan: PlanRecord, progress: Progress
) -> Iterator[None]:
    """truth/ is written once all is shot: it lists what was applied in every shot.

    PartialError if the disk has all shots and refuses the truth; where it lacks shots, resuming writes both.
    """
    truth = session.folder / "truth" / "truth.json"
    if truth.exists() and len(finished(session, plan)) < len(planned_shots(plan)):
        store.discard(truth)
    try:
        yield
    except BaseException:
        with suppress(StorageError):  # the first error is the one to report
            _list_faults(session.folder, bus)
        raise
    try:
        _list_faults(session.folder, bus)
        if not truth.exists():
            write_truth(rig, session.folder, progress)
    except StorageError as error:
        there = len(finished(session, plan))
        if there == len(planned_shots(plan)):
            raise PartialError(f"all shots were written, but not the simulator's truth: {error}") from error
        if not there:
            raise


def _list_faults(out: Path, bus: BusRig) -> None:
    """List the bus faults of this run, behind those of earlier ones."""
    if bus.plan.log:
        store.make_folder(out / "truth")
    for fault in bus.plan.log:
        line = {
            "time": round(fault.time, 6),
            "serial": fault.serial,
            "operation": fault.operation,
            "nth": fault.nth,
        }
        store.append_line(out / "truth" / "faults.jsonl", line | {"fault": str(fault.fault)})
