"""Departures of the shots of a plan from it: in exposure, and in the time at which their shutters opened."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from capture.bracket.deviation import deviates, stops_apart
from capture.record.capture_result import span
from capture.record.shot_files import ShotId
from capture.record.threads.exposure_step import ExposureStep, SavedShot
from imaging.session.records import PlanRecord, ShotRecord


@dataclass(frozen=True)
class FirstOrder:
    """Time of the first order of a step, and of the first shutter opening, if known.

    earliest: before which no shutter opened, None if unknown.
    """

    ordered: float
    opened: float | None
    earliest: float | None

    @classmethod
    def of(cls, step: ExposureStep) -> Self:
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


class Departures:
    """Departures of the shots of one run. tolerance: seconds that shutters of a step may open apart."""

    def __init__(self, plan: PlanRecord, tolerance: float) -> None:
        self._plan, self._tolerance = plan, tolerance
        self._deviating: dict[str, list[ShotRecord]] = {}
        self._apart: dict[int, list[tuple[float, ShotId, bool]]] = {}
        self._untimed: dict[str, list[float]] = {}
        self._unknown: dict[str, None] = {}

    def add(self, shot_id: ShotId, shot: ShotRecord, written: SavedShot) -> None:
        """Compare a shot with the plan, and its shutter with the first of its step."""
        host = written.host
        if host is not None and host.jumped:
            self._unknown[
                f"the skew of {shot_id} is unknown: the clock of node {host.node} jumped during the shot"
            ] = None
        elif len(self._plan.cameras) > 1 and written.opened is None:
            self._untimed.setdefault(shot_id.camera, [])
            if shot.skew_bound is not None and not shot.retries:
                self._untimed[shot_id.camera].append(shot.skew_bound)
        self._unknown |= dict.fromkeys(written.unknown)
        if shot.requested is not None and deviates(written.reported, shot.requested):
            self._deviating.setdefault(shot.camera, []).append(shot)
        # Where shutters are unknown, orders that went out too far apart are enough to say so.
        apart = shot.trigger_delay if shot.skew is None else shot.skew
        if apart is not None and apart > self._tolerance and not shot.retries:
            self._apart.setdefault(shot_id.step, []).append((apart, shot_id, shot.skew is not None))

    def problems(self) -> tuple[str, ...]:
        """A sentence for each camera whose exposures deviate, and each step whose shutters are apart."""
        return (*self._deviations(), *self._skews())

    def unknown(self) -> tuple[str, ...]:
        """A sentence for each fact on the shots that the cameras do not say."""
        return (*self._without_times(), *self._unknown)

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
            worst, shot, opened = max(late)
            frames = len({shot.frame for _, shot, _ in late})
            what = "shutters opened" if opened else "orders to expose went out"
            yield (
                f"step {step}: in {frames} of {len(self._plan.frames)} frames the {what} more than "
                f"{span(self._tolerance)} apart, up to {span(worst)} ({shot.camera}, frame {shot.frame}): "
                "keep the scene still, or trigger the cameras by a hardware line"
            )


def _stops_off(shot: ShotRecord) -> float:
    assert shot.reported is not None
    assert shot.requested is not None
    return stops_apart(shot.reported, shot.requested)


def _deviation(shot: ShotRecord) -> str:
    return f"{shot.reported} where {shot.requested} was asked for ({_stops_off(shot):+.2f} stops)"
