"""Rolling shutter, which is not modelled: the doubt that is raised where it may matter.

Residuals hardly show it: poses and lens bend until the points fit (`bench/calibration/rolling_shutter.py`).
"""

from collections.abc import Iterable
from itertools import pairwise
from statistics import median

from imaging.session.records import Rung, ShotRecord

FREQUENT = 0.5
"""Interval between frames, seconds, below which the rig cannot have stood still in between."""
FEWEST_STEPS = 5
_ROWS = (
    "all rows of an image count as exposed at the same time, which they are where the camera stands still or "
    "has a global shutter"
)


def rungs(shots: Iterable[ShotRecord]) -> tuple[Rung, ...]:
    """Rungs that state the global shutter, and a doubt, where shots of a scene follow each other quickly."""
    begun: dict[str, dict[int, float]] = {}
    for shot in shots:
        if shot.kind == "scene" and shot.captured_at is not None:
            frames, moment = begun.setdefault(shot.camera, {}), shot.captured_at.timestamp()
            frames[shot.frame] = min(moment, frames.get(shot.frame, moment))
    frequent = {
        name: pause for name, frames in begun.items() if (pause := _pause(frames.values())) < FREQUENT
    }
    granted = Rung(name="pose_rolling_shutter", taken=False, reason=_ROWS)
    if not frequent:
        return (granted,)
    name = min(frequent, key=lambda name: frequent[name])
    reason = (
        f"{name} took a frame every {frequent[name]:.2g} s, as a moving camera does: unless its shutter is "
        "global, poses may be off by tenths of a degree and by centimetres, even with small residuals; "
        "stand still for every frame"
    )
    return granted, Rung(name="pose_moving", taken=True, reason=reason)


def _pause(moments: Iterable[float]) -> float:
    """Median interval, seconds; inf with too few times, or with clocks of whole seconds."""
    ordered = sorted(moments)
    steps = [after - before for before, after in pairwise(ordered)]
    usual = median(steps) if len(steps) >= FEWEST_STEPS else 0.0
    return usual if usual > 0 else float("inf")
