"""The shots of a plan that one call of `record` takes, those it finds there, and those that are missing."""

from collections.abc import Callable, Iterator, Mapping, Set
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

from capture.bracket.acceptance import RETRIES, Acceptance
from capture.record.capture_result import CaptureResult
from capture.record.departures import Departures, FirstOrder, after
from capture.record.shot_files import ShotId, drop_aside, put_back, set_aside
from capture.record.threads.camera_worker import CameraGivenUp
from capture.record.threads.capture_threads import CaptureThreads
from capture.record.threads.exposure_step import PATIENCE, ExposureStep, RunState, SavedShot
from drivers.clock import Clock
from drivers.errors import CameraLost
from imaging.errors import RigError, StorageError
from imaging.optics.exposure import Exposure
from imaging.progress import Progress
from imaging.session.records import PlanRecord, ShotRecord
from imaging.session.session import Session


def planned_shots(plan: PlanRecord) -> list[ShotId]:
    """Every shot of a plan in the order of shooting: all cameras expose the same step together."""
    return [
        ShotId(camera, frame, step)
        for frame in plan.frames
        for step in range(len(plan.bracket))
        for camera in plan.cameras
    ]


def finished(session: Session, plan: PlanRecord) -> dict[ShotId, ShotRecord]:
    """The shots of a plan that are recorded and whose file is there."""
    return {
        ShotId(shot.camera, shot.frame, shot.step): shot
        for shot in session.shots()
        if shot.plan == plan.plan and session.file(shot).is_file()
    }


def _exposure_of(requested: Exposure | None) -> Exposure:
    if requested is None:
        raise ValueError("a plan to be shot names every exposure")
    return requested


@dataclass(frozen=True)
class _Bracket:
    """Attempts at steps of a bracket at one frame.

    together: steps that all cameras take, in which shutters are compared; a repeat by one camera says nothing
    of the others. first: the first order of each of these.
    """

    frame: int
    together: Set[int]
    first: dict[int, FirstOrder] = field(default_factory=dict)
    acceptance: Acceptance[ShotId, SavedShot] = field(default_factory=Acceptance)


class CaptureRun:
    """State of one call of `record`. earlier: number of shots of earlier calls."""

    def __init__(
        self,
        session: Session,
        plan: PlanRecord,
        clock: Clock,
        progress: Progress,
        tolerance: float,
        leader: str | None,
    ) -> None:
        self._session, self._plan, self._clock = session, plan, clock
        self._progress, self._leader = progress, leader
        self._departures = Departures(plan, tolerance)
        self.planned = planned_shots(plan)
        self.done = finished(session, plan)
        self.earlier = len([shot_id for shot_id in self.planned if shot_id in self.done])
        self.state = RunState()
        self._missing: dict[ShotId, str] = {}
        self._lost: set[str] = set()

    def frames(self) -> Iterator[int]:
        """Frames of which shots are missing, as long as the disk takes them."""
        for frame in self._plan.frames:
            if self.state.halted is None and any(
                shot_id.frame == frame and shot_id not in self.done for shot_id in self.planned
            ):
                yield frame

    def filters(self, frame: int) -> Iterator[tuple[str | None, range]]:
        """The filters that a frame lacks shots of, in their order, and the steps through each."""
        bands, count = self._plan.bands, len(self._plan.bracket)
        starts = [step for step in range(count) if not step or (bands and bands[step] != bands[step - 1])]
        for start, end in pairwise([*starts, count]):
            lacking = any(
                shot_id.frame == frame and start <= shot_id.step < end and shot_id not in self.done
                for shot_id in self.planned
            )
            if lacking and self.state.halted is None:
                yield (bands[start] if bands else None), range(start, end)

    def take(self, frame: int, steps: range, threads: CaptureThreads) -> None:
        """Shoot what a frame lacks of these steps, one by one; then once more what failed, and once more.

        The only camera of a plan shoots them by its body's own bracket, if it has one and nothing is there
        yet. With several cameras this is not used: each body times the frames of its bracket itself, so the
        cameras would not be synchronised step by step.
        """
        pending = self._lacking(frame, steps)
        together = {step for step, names in pending.items() if len(names) == len(self._plan.cameras)}
        bracket = _Bracket(frame, together)
        alone = self._plan.cameras[0] if len(self._plan.cameras) == 1 and not self._leader else None
        # Failures are taken again after the whole bracket, so that one camera does not stop the others.
        for attempt in range(RETRIES + 1):
            bracketed = alone if not attempt and len(pending) == len(steps) else None
            shot = threads.shoot(self._steps(frame, pending), bracketed)
            failed = {step.number: self._settle(bracket, step, threads) for step in shot}
            pending = {step: names for step, names in failed.items() if names}
        # Where further attempts failed, a frame whose metadata disagree is better than none.
        for shot_id in [ShotId(name, frame, step) for step, names in pending.items() for name in names]:
            doubtful = bracket.acceptance.doubtful.get(shot_id)
            if doubtful and self._on_disk(partial(put_back, self._session, doubtful), shot_id, threads):
                self._book(shot_id, doubtful, bracket.first.get(shot_id.step), threads)

    def result(self) -> CaptureResult:
        """StorageError if the disk refused before there was any shot in the session."""
        refused = self.state.halted
        if refused is not None and not self._session.shots():
            raise refused
        what, _, mend = ("", "", "") if refused is None else str(refused).rstrip(".").rpartition(": ")
        reasons: dict[ShotId, str] = {}
        for shot_id in self.planned:
            if shot_id in self.done:
                continue
            reason = self._missing.get(shot_id)
            # The file that the disk refused may be that of another camera.
            stopped = refused is not None and reason in (None, str(refused))
            reasons[shot_id] = f"the capture stopped: {what}" if stopped else reason or "it was not taken"
        return CaptureResult(
            session=self._session.folder,
            planned=len(self.planned),
            taken=len(self.done) - self.earlier,
            earlier=self.earlier,
            missing=tuple(f"{shot_id}: {reason.rstrip('.')}" for shot_id, reason in reasons.items()),
            mend=mend.removesuffix(" and run again"),
            problems=self._departures.problems(),
            unknown=self._departures.unknown(),
        )

    def _lacking(self, frame: int, steps: range) -> dict[int, list[str]]:
        """The cameras whose shots are missing, by step."""
        lacking: dict[int, list[str]] = {}
        for shot_id in self.planned:
            if shot_id.frame == frame and shot_id.step in steps and shot_id not in self.done:
                lacking.setdefault(shot_id.step, []).append(shot_id.camera)
        return lacking

    def _settle(self, bracket: _Bracket, step: ExposureStep, threads: CaptureThreads) -> list[str]:
        """Book or refuse the frames of a step that was shot.

        Returns:
            The cameras that have to take it again.
        """
        if step.ordered and step.number in bracket.together:
            bracket.first.setdefault(step.number, FirstOrder.of(step))
        acceptance, again = bracket.acceptance, []
        for name in step.cameras:
            shot_id, outcome = ShotId(name, bracket.frame, step.number), step.outcomes[name]
            if isinstance(outcome, RigError):
                self._failed(shot_id, outcome)
            elif acceptance.accepts(shot_id, outcome, step.requested):
                self._book(shot_id, outcome, bracket.first.get(step.number), threads)
                if worse := acceptance.doubtful.get(shot_id):
                    self._on_disk(partial(drop_aside, self._session, worse), shot_id, threads)
                continue
            else:
                step.count_failure(name)
                self._on_disk(partial(set_aside, self._session, outcome), shot_id, threads)
            again.append(name)
        return again

    def _steps(self, frame: int, pending: Mapping[int, list[str]]) -> list[ExposureStep]:
        steps, before = [], 0.0
        for step, names in pending.items():
            requested = _exposure_of(self._plan.bracket[step])
            # The exposure before may be followed by a dark frame as long as itself.
            patience = PATIENCE + 2 * before
            # The leader exposes alone where it alone is missing: no other camera is armed then.
            leader = self._leader if names != [self._leader] else None
            steps.append(
                ExposureStep(
                    self._clock,
                    self.state,
                    frame,
                    step,
                    requested,
                    names,
                    patience=patience,
                    leader=leader,
                )
            )
            before = requested.time
        return steps

    def _failed(self, shot_id: ShotId, error: RigError) -> None:
        if not (isinstance(error, CameraGivenUp) and shot_id in self._missing):
            self._missing[shot_id] = str(error)
        if isinstance(error, CameraLost) and shot_id.camera not in self._lost:
            self._lost.add(shot_id.camera)
            others = ", the others go on" if len(self._plan.cameras) > 1 else ""
            self._progress(f"{shot_id.camera} is lost{others}: {error}", len(self.done), len(self.planned))

    def _on_disk(self, change: Callable[[], None], shot_id: ShotId, threads: CaptureThreads) -> bool:
        """Change files or the line of a shot; False, and the run halts, if the disk refuses."""
        try:
            change()
        except StorageError as error:
            threads.halt(error)
            self._failed(shot_id, error)
            return False
        return True

    def _book(
        self, shot_id: ShotId, written: SavedShot, first: FirstOrder | None, threads: CaptureThreads
    ) -> None:
        """Write the line of a shot whose file is whole; first: of its step."""
        shot = self._record(shot_id, written, first)
        if not self._on_disk(partial(self._session.append_shot, shot), shot_id, threads):
            return
        self.done[shot_id] = shot
        self._departures.add(shot_id, shot, written)
        back = f"{shot.camera} is back: " if shot.camera in self._lost else ""
        self._lost.discard(shot.camera)
        self._progress(f"{back}{shot.file}", len(self.done), len(self.planned))

    def _record(self, shot_id: ShotId, written: SavedShot, first: FirstOrder | None) -> ShotRecord:
        """The line of a shot, its times against the first order of its step."""
        requested, host = _exposure_of(self._plan.bracket[shot_id.step]), written.host
        skew = None if first is None else after(first.opened, written.opened)
        latest = written.opened if written.opened is not None else written.opened_by
        bound = None if first is None or skew is not None else after(first.earliest, latest)
        return ShotRecord(
            kind=self._plan.kind,
            plan=self._plan.plan,
            camera=shot_id.camera,
            frame=shot_id.frame,
            step=shot_id.step,
            file=written.file,
            sha256=written.sha256,
            developed=written.developed,
            developed_sha256=written.developed_sha256,
            requested=requested,
            reported=written.reported,
            width=written.width,
            height=written.height,
            captured_at=written.captured_at,
            skew=skew,
            skew_bound=bound,
            trigger_delay=None if first is None else after(first.ordered, written.ordered),
            retries=written.retries,
            band=self._plan.band(shot_id.step, self._session.camera(shot_id.camera)),
            node=host.node if host else None,
            clock_offset=host.offset if host else None,
            clock_error=host.error if host else None,
        )
