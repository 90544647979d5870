"""The exposure scale of every shot: from labels, corrected by what overlapping exposures say."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calib.data.views import View, of_one_band, read_view
from imaging.merge.linear_frame import LinearFrame
from imaging.merge.masks import masked
from imaging.merge.power_law import exponent
from imaging.merge.ratios import LABEL_SIGMA, Linearity, Overlap, Ratio, linearity, overlap, ratio, solve
from imaging.progress import Progress
from imaging.session.calibration import Response
from imaging.session.records import Rung, ShotRecord
from imaging.session.session import Session

LINEAR = Response(kind="linear", evidence="RAW")
UNKNOWN_SIGMA = 3.0
"""Trust in an exposure that was guessed from the brightness of its image, natural log."""
JITTER = 2e-3
"""Scatter of a step's ratio over the frames, beyond noise, from which every shot gets a scale of its own."""

Key = float
"""Key of a camera's steps: ln of the label, or the step's index plus `_UNLABELLED` where labels lack."""
_UNLABELLED = 1000.0
"""More than the ln of any label, so that 1 s is not taken for a first step without one."""


@dataclass(frozen=True)
class Exposures:
    """scale: k of each shot's file, s; linearity: of each camera that has overlapping exposures.

    measured: whether any scale is more than its label. powers: of cameras whose signal goes with a power of
    light other than 1, that power.
    """

    scale: dict[str, float]
    measured: bool
    linearity: dict[str, Linearity]
    powers: dict[str, float]
    rungs: tuple[Rung, ...]


@dataclass(frozen=True)
class _Steps:
    """The steps of one camera through one filter: ln of the labels, trust in them, overlaps by longer and
    shorter step."""

    labels: dict[Key, float]
    sigma: float
    overlaps: dict[tuple[Key, Key], list[tuple[int, Overlap]]]
    """Overlaps in every frame that has both steps."""


@dataclass(frozen=True)
class _Solved:
    """ln k by frame and step; the largest shift from a label; scatter between frames."""

    scale: dict[tuple[int, Key], float]
    shift: float
    error: float
    linearity: Linearity | None
    power: float | None
    scatter: float | None
    per_shot: bool


def label_scale(shot: ShotRecord) -> float:
    """The exposure scale that a shot's record claims, s; 1 where it claims none."""
    return 1.0 if shot.exposure is None else shot.exposure.scale


def labelled(views: Sequence[View]) -> dict[str, float]:
    """The scale of each shot's file as the records claim it, s."""
    return {shot.file: label_scale(shot) for view in views for shot in view.shots}


def estimate(session: Session, views: Sequence[View], progress: Progress) -> Exposures:
    """Scales of RAW shots, estimated from overlaps where there are any; all views are of RAW cameras.

    A step keeps one scale over all frames of its camera, unless the frames disagree by more than
    noise explains.
    """
    scale = labelled(views)
    by_camera: dict[tuple[str, str | None], dict[int, View]] = {}
    parts = of_one_band(views)
    for view in parts:
        by_camera.setdefault((view.camera.name, view.shots[0].band), {})[view.frame] = view
    solved: dict[tuple[str, str | None], _Solved] = {}
    done = 0

    def step() -> None:
        nonlocal done
        progress("comparing exposures", done, len(parts))
        done += 1

    for key, camera_views in by_camera.items():
        steps = _measure(session, camera_views, step)
        result = _solve(steps, list(camera_views))
        if result is None:
            continue
        solved[key] = result
        for frame, view in camera_views.items():
            for shot in view.shots:
                scale[shot.file] = float(np.exp(result.scale[frame, _key(shot)]))
    lines = {name: result.linearity for (name, _), result in solved.items() if result.linearity is not None}
    powers = {name: result.power for (name, _), result in solved.items() if result.power is not None}
    return Exposures(scale, bool(solved), lines, powers, _rungs(list(solved.values())))


def _key(shot: ShotRecord) -> Key:
    if shot.exposure is None:
        return _UNLABELLED + shot.step
    return round(float(np.log(shot.exposure.scale)), 6)


def _measure(session: Session, views: Mapping[int, View], step: Callable[[], None]) -> _Steps:
    """Overlaps of every pair of steps; where a label lacks, the brightness of the image stands in."""
    known = all(shot.exposure is not None for view in views.values() for shot in view.shots)
    # A view of one exposure overlaps with nothing, and its brightness is needed only beside brackets.
    guessed = not known and any(len(view.shots) > 1 for view in views.values())
    labels: dict[Key, float] = {}
    brightness: dict[Key, list[float]] = {}
    overlaps: dict[tuple[Key, Key], list[tuple[int, Overlap]]] = {}
    for frame, view in views.items():
        step()
        steps = {_key(shot): shot for shot in view.shots}
        if known:
            labels |= {key: float(np.log(label_scale(shot))) for key, shot in steps.items()}
        if len(steps) < 2 and not guessed:
            continue
        read = read_view(session, view, {shot.file: 1.0 for shot in view.shots}, LINEAR)
        read = masked(session, view.shots, read)
        frames = dict(zip((_key(shot) for shot in view.shots), read, strict=True))
        mean = {key: _brightness(frame) for key, frame in frames.items()}
        for key, value in mean.items():
            brightness.setdefault(key, []).append(value)
        for shorter, longer in combinations(sorted(steps, key=labels.get if known else mean.get), 2):  # type: ignore[arg-type]
            overlaps.setdefault((longer, shorter), []).append(
                (frame, overlap(frames[longer], frames[shorter]))
            )
    if not known:
        labels = {key: float(np.log(np.median(values))) for key, values in brightness.items()}
    return _Steps(labels, LABEL_SIGMA if known else UNKNOWN_SIGMA, overlaps)


def _brightness(frame: LinearFrame) -> float:
    """Mean signal of what is valid, at least 1e-6."""
    lit = np.clip(frame.signal[frame.valid], 1e-6, 1.0)
    return float(lit.mean()) if lit.size else 1e-6


def _solve(steps: _Steps, frames: Sequence[int]) -> _Solved | None:
    """Scales of one camera; None where no two exposures share enough photosites."""
    edges = {pair: ratio([o for _, o in overlaps]) for pair, overlaps in steps.overlaps.items()}
    pooled = {pair: edge for pair, edge in edges.items() if edge is not None}
    if not pooled:
        return None
    keys = sorted(steps.labels)
    labels = np.array([steps.labels[key] for key in keys])
    values, errors = solve(labels, _indexed(pooled, keys), steps.sigma)
    value = dict(zip(keys, values.tolist(), strict=True))
    scale = {(frame, key): value[key] for frame in frames for key in keys}
    alone: dict[int, dict[tuple[Key, Key], Ratio]] = {}
    for pair, overlaps in steps.overlaps.items():
        for frame, one in overlaps:
            edge = ratio([one]) if pair in pooled else None
            if edge is not None:
                alone.setdefault(frame, {})[pair] = edge
    scatter, significant = _scatter(alone, value)
    per_shot = significant and scatter is not None and scatter > JITTER
    if per_shot and scatter is not None:
        for frame, edges_alone in alone.items():
            own_values, _ = solve(values, _indexed(edges_alone, keys), scatter)
            scale |= {(frame, key): float(v) for key, v in zip(keys, own_values, strict=True)}
    stated = [
        (steps.labels[pair[0]] - steps.labels[pair[1]], [one for _, one in steps.overlaps[pair]])
        for pair in pooled
    ]
    return _Solved(
        scale=scale,
        power=exponent(stated) if steps.sigma == LABEL_SIGMA else None,
        shift=float(np.abs(values - labels).max()) if steps.sigma == LABEL_SIGMA else 0.0,
        error=float(errors.max()),
        linearity=linearity([(edge, [o for _, o in steps.overlaps[p]]) for p, edge in pooled.items()]),
        scatter=scatter,
        per_shot=per_shot,
    )


def _indexed(edges: Mapping[tuple[Key, Key], Ratio], keys: Sequence[Key]) -> dict[tuple[int, int], Ratio]:
    return {(keys.index(a), keys.index(b)): edge for (a, b), edge in edges.items()}


def _scatter(
    alone: Mapping[int, Mapping[tuple[Key, Key], Ratio]], value: Mapping[Key, float]
) -> tuple[float | None, bool]:
    """Scatter of the frames' own ratios beyond their errors, natural log, and whether it is significant."""
    departures = [
        (edge.log - (value[a] - value[b]), edge.error)
        for edges in alone.values()
        for (a, b), edge in edges.items()
    ]
    if len(alone) < 3:
        return None, False
    departed = np.array(departures)
    excess = float(np.mean(departed[:, 0] ** 2 - departed[:, 1] ** 2))
    whitened = float(np.mean((departed[:, 0] / departed[:, 1]) ** 2))
    return float(np.sqrt(max(excess, 0.0))), whitened > 2.0


def _rungs(solved: Sequence[_Solved]) -> tuple[Rung, ...]:
    if not solved:
        return (
            Rung(
                name="exposure_ratios",
                taken=False,
                reason="no two exposures of a view overlap, so the labels are taken as they are",
            ),
        )
    shift, error = max(s.shift for s in solved), max(s.error for s in solved)
    rungs = [
        Rung(
            name="exposure_ratios",
            taken=True,
            gain=100 * shift,
            standard_error=100 * error,
            unit="% of exposure, at most",
            reason="overlapping exposures determine the ratios better than the labels do",
        )
    ]
    scatters = [s.scatter for s in solved if s.scatter is not None]
    if scatters:
        worst = max(scatters)
        rungs.append(
            Rung(
                name="exposure_per_shot",
                taken=any(s.per_shot for s in solved),
                gain=100 * worst,
                unit="% scatter between frames",
                reason=f"a scale for every shot is needed when the ratios of a step scatter by more than "
                f"{100 * JITTER:g} % beyond noise",
            )
        )
    return tuple(rungs)
