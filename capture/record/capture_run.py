"""The shots of a plan that one call of `record` takes, those it finds there, and those that are missing."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

from capture.bracket.acceptance import RETRIES, Acceptance
from capture.bracket.deviation import deviates, stops_apart
from capture.record.camera_worker import CameraGivenUp
from capture.record.capture_result import CaptureResult, span
from capture.record.capture_threads import CaptureThreads
from capture.record.exposure_step import PATIENCE, ExposureStep, RunState, SavedShot
from capture.record.shot_files import ShotId, drop_aside, put_back, set_aside
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
class _First:
    """Time of the first order of a step, and of the first shutter opening, if known.

    earliest: before which no shutter opened, None if unknown.
    """

    ordered: float
    opened: float | None
    earliest: float | None

    @classmethod
    def of(cls, step: ExposureStep) -> "_First":
        """Compute from the times of all; a single camera that reports its opening has none to be compared
        with.
        """
        alone = len(step.opened) == 1 and len(step.ordered) > 1
        opened = None if alone or not step.opened else min(step.opened.values())
        # A shutter on a wire may open before its own camera is asked for the frame, not before any order.
        earliest = [*step.opened.values(), *(step.began[name] for name in step.ordered if name in step.began)]
        whole = len(step.ordered) > 1 and all(
            name in step.opened or name in step.began for name in step.ordered
        )
        return cls(min(step.ordered.values()), opened, min(earliest) if earliest and whole else None)


def after(first: float | None, moment: float | None) -> float | None:
    """Seconds from one moment to another; None where one of them is not known."""
    return None if first is None or moment is None else max(0.0, moment - first)


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
        self._progress, self._tolerance, self._leader = progress, tolerance, leader
        self.planned = planned_shots(plan)
        self.done = finished(session, plan)
        self.earlier = len([shot_id for shot_id in self.planned if shot_id in self.done])
        self.state = RunState()
        self._missing: dict[ShotId, str] = {}
        self._lost: set[str] = set()
        self._deviating: dict[str, list[ShotRecord]] = {}
        self._apart: dict[int, list[tuple[float, ShotId]]] = {}
        self._untimed: dict[str, list[float]] = {}
        self._unknown: dict[str, None] = {}

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
        pending: dict[int, list[str]] = {}
        for shot_id in self.planned:
            if shot_id.frame == frame and shot_id.step in steps and shot_id not in self.done:
                pending.setdefault(shot_id.step, []).append(shot_id.camera)
        # Shutters are compared in steps that all cameras take; a repeat by one says nothing of the others.
        together = {step for step, names in pending.items() if len(names) == len(self._plan.cameras)}
        first: dict[int, _First] = {}
        acceptance: Acceptance[ShotId, SavedShot] = Acceptance()
        alone = self._plan.cameras[0] if len(self._plan.cameras) == 1 and not self._leader else None
        # Failures are taken again after the whole bracket, so that one camera does not stop the others.
        for attempt in range(RETRIES + 1):
            failed: dict[int, list[str]] = {}
            bracketed = alone if not attempt and len(pending) == len(steps) else None
            for step in threads.shoot(self._steps(frame, pending), bracketed):
                if step.ordered and step.number in together:
                    first.setdefault(step.number, _First.of(step))
                for name in step.cameras:
                    shot_id, outcome = ShotId(name, frame, step.number), step.outcomes[name]
                    if isinstance(outcome, SavedShot):
                        if acceptance.accepts(shot_id, outcome, step.requested):
                            self._book(shot_id, outcome, first.get(step.number), threads)
                            if worse := acceptance.doubtful.get(shot_id):
                                self._on_disk(partial(drop_aside, self._session, worse), shot_id, threads)
                            continue
                        step.count_failure(name)
                        self._on_disk(partial(set_aside, self._session, outcome), shot_id, threads)
                    else:
                        self._failed(shot_id, outcome)
                    failed.setdefault(step.number, []).append(name)
            pending = failed
        # Where further attempts failed, a frame whose metadata disagree is better than none.
        for shot_id in [ShotId(name, frame, step) for step, names in pending.items() for name in names]:
            doubtful = acceptance.doubtful.get(shot_id)
            if doubtful and self._on_disk(partial(put_back, self._session, doubtful), shot_id, threads):
                self._book(shot_id, doubtful, first.get(shot_id.step), threads)

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
            problems=(*self._deviations(), *self._skews()),
            unknown=(*self._without_times(), *self._unknown),
        )

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
        self, shot_id: ShotId, written: SavedShot, first: _First | None, threads: CaptureThreads
    ) -> None:
        """The line of a shot whose file is whole; first: of its step."""
        requested, host = _exposure_of(self._plan.bracket[shot_id.step]), written.host
        skew = None if first is None else after(first.opened, written.opened)
        latest = written.opened if written.opened is not None else written.opened_by
        bound = None if first is None or skew is not None else after(first.earliest, latest)
        shot = ShotRecord(
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
        if not self._on_disk(partial(self._session.append_shot, shot), shot_id, threads):
            return
        self.done[shot_id] = shot
        if host is not None and host.jumped:
            self._unknown[
                f"the skew of {shot_id} is unknown: the clock of node {host.node} jumped during the shot"
            ] = None
        elif len(self._plan.cameras) > 1 and written.opened is None:
            self._untimed.setdefault(shot_id.camera, [])
            if bound is not None and not shot.retries:
                self._untimed[shot_id.camera].append(bound)
        self._unknown |= dict.fromkeys(written.unknown)
        if deviates(written.reported, requested):
            self._deviating.setdefault(shot.camera, []).append(shot)
        # Where shutters are unknown, orders that went out too far apart are enough to say so.
        apart = shot.trigger_delay if shot.skew is None else shot.skew
        if apart is not None and apart > self._tolerance and not shot.retries:
            self._apart.setdefault(shot_id.step, []).append((apart, shot_id))
        back = f"{shot.camera} is back: " if shot.camera in self._lost else ""
        self._lost.discard(shot.camera)
        self._progress(f"{back}{shot.file}", len(self.done), len(self.planned))

    def _deviations(self) -> Iterator[str]:
        """A sentence for each camera that reports other exposures than were asked for."""
        for camera, shots in self._deviating.items():
            worst = max(shots, key=lambda shot: abs(_stops_off(shot)))
            place = f"frame {worst.frame}, step {worst.step}"
            if len(shots) == 1:
                yield f"{camera}, {place}: the camera reports {_deviation(worst)}"
            else:
                yield (
                    f"{camera}: {len(shots)} shots report another exposure than was asked for, such as "
                    f"{place}: {_deviation(worst)}"
                )

    def _without_times(self) -> Iterator[str]:
        """A sentence on the cameras that do not say when their shutters opened."""
        if self._untimed and self._plan.kind != "dark":
            bounds = [bound for each in self._untimed.values() for bound in each]
            most = f", at most {span(max(bounds))}" if bounds else ""
            yield (
                f"the skew of {', '.join(sorted(self._untimed))} is unknown{most}: a camera that stamps no "
                "frames opens its shutter some time after its order; keep the scene still"
            )

    def _skews(self) -> Iterator[str]:
        """A sentence for each step whose shutters opened too far apart; a shot taken again is always late."""
        for step, late in sorted(self._apart.items()):
            worst, shot = max(late)
            frames = len({shot.frame for _, shot in late})
            opened = "shutters opened" if self.done[shot].skew is not None else "orders to expose went out"
            yield (
                f"step {step}: in {frames} of {len(self._plan.frames)} frames the {opened} more than "
                f"{span(self._tolerance)} apart, up to {span(worst)} ({shot.camera}, frame {shot.frame}): "
                "keep the scene still, or trigger the cameras by a hardware line"
            )


def _stops_off(shot: ShotRecord) -> float:
    assert shot.reported is not None
    return stops_apart(shot.reported, _exposure_of(shot.requested))


def _deviation(shot: ShotRecord) -> str:
    return f"{shot.reported} where {shot.requested} was asked for ({_stops_off(shot):+.2f} stops)"
