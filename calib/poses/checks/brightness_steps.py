"""Pairs of views whose matches are not as bright in one as in the other: they only look alike.

A point of a matt surface is as bright from one place as from another nearby, and two sides of a thing that
only look alike are lit differently.
"""

from collections.abc import Collection, Mapping
from statistics import median

import numpy as np

from calib.data.features import FEWEST_MATCHES, MatchedPair
from imaging.arrays import Array
from imaging.session.view_id import ViewId

Pairs = Mapping[tuple[ViewId, ViewId], MatchedPair]

OTHERWISE_LIT = 0.03, 0.1
"""Median difference of natural log brightness between the two views of a pair beyond which they do not show
the same surface, at least and at most. Of neighbours that do, it is below 0.03 in RAW brackets."""
UNEVEN = 0.1, 0.3
"""The same of the median absolute difference, which distinguishes sides of equal overall brightness."""
BESIDE = 30.0
"""Degrees between views that see the same side."""
NEARBY, FEWEST_APART = 16.0, 3
"""Degrees between views within which shine hardly differs, and pairs that have to differ for light to count:
where sides of a crate are taken for one another, 96 % of the pairs within 8 degrees differ by more than a
tenth."""
FEW_LIT = 0.2
"""Share of such pairs that may differ by more than the most without a warning."""
MANY_BESIDE = 20
"""Pairs below which light that differs in most of them says nothing: of six, all differ in brackets of
fourteen stops."""
MOSTLY_LIT, DARKER = 0.8, 0.3
"""Share of such pairs that differ by more than the most, and their median difference, beyond which the light
would have had to change with every photograph: 0.88 and 0.50 of a crate with like sides."""
USUALLY_LIT = 4.0
"""Times the differences of the tenth of pairs that agree best, between those limits."""


def otherwise_lit(pairs: Pairs, brightness: Mapping[ViewId, Array]) -> set[tuple[ViewId, ViewId]]:
    """The pairs whose matches are not as bright in one view as in the other.

    Cameras may differ in gain: what all pairs of two cameras have in common is taken off.
    """
    steps: dict[tuple[ViewId, ViewId], Array] = {}
    for (one, other), pair in pairs.items():
        if one in brightness and other in brightness:
            step = brightness[other][pair.index[:, 1]] - brightness[one][pair.index[:, 0]]
            step = step[np.isfinite(step)]
            if len(step) >= FEWEST_MATCHES:
                steps[one, other] = step
    gains: dict[tuple[str, str], list[float]] = {}
    for (one, other), step in steps.items():
        gains.setdefault((one.camera, other.camera), []).append(float(np.median(step)))
    usual = {
        cameras: 0.0 if cameras[0] == cameras[1] else median(medians) for cameras, medians in gains.items()
    }
    apart = {(one, other): step - usual[one.camera, other.camera] for (one, other), step in steps.items()}
    if not apart:
        return set()
    shift = {pair: abs(float(np.median(step))) for pair, step in apart.items()}
    uneven = {pair: float(np.median(np.abs(step))) for pair, step in apart.items()}
    most_shift, most_uneven = (
        float(np.clip(USUALLY_LIT * np.percentile(list(sizes.values()), 10), *limits))
        for sizes, limits in ((shift, OTHERWISE_LIT), (uneven, UNEVEN))
    )
    return {pair for pair in apart if shift[pair] > most_shift or uneven[pair] > most_uneven}


def lit_apart(
    poses: Mapping[ViewId, Array], pairs: Pairs, brightness: Mapping[ViewId, Array], steady: Collection[str]
) -> bool:
    """Return whether views that stand beside each other by their poses differ in brightness.

    Args:
        poses: cam_from_world [4, 4] of the registered views.
        pairs: Those that match.
        brightness: Natural log of the luminance at each feature of each view [K], NaN where unknown.
        steady: Cameras whose exposure stays as it is from view to view.
    """
    steps = _steps_within(NEARBY, poses, pairs, brightness, steady)
    apart = sum(step > OTHERWISE_LIT[1] for step in steps)
    return apart >= FEWEST_APART and apart > FEW_LIT * len(steps)


def mostly_apart(
    poses: Mapping[ViewId, Array], pairs: Pairs, brightness: Mapping[ViewId, Array], exact: Collection[str]
) -> bool:
    """Tell if nearly all views that look from nearly the same side differ much in brightness.

    Args:
        poses: cam_from_world [4, 4] of the registered views.
        pairs: Those that match.
        brightness: Natural log of the luminance at each feature of each view [K], NaN where unknown.
        exact: Cameras whose brightness differs only where things do.
    """
    steps = _steps_within(BESIDE, poses, pairs, brightness, exact)
    apart = sum(step > OTHERWISE_LIT[1] for step in steps)
    return len(steps) >= MANY_BESIDE and apart > MOSTLY_LIT * len(steps) and median(steps) > DARKER


def warning(
    poses: Mapping[ViewId, Array], pairs: Pairs, brightness: Mapping[ViewId, Array], exact: Collection[str]
) -> str | None:
    """Warning about views that look from nearly the same side and differ in brightness; None if they
    agree.

    poses: cam_from_world [4, 4] of the views that are placed. exact: cameras whose brightness is known so
    well that it differs only where things do.
    """
    steps = _steps_within(BESIDE, poses, pairs, brightness, exact)
    apart = sum(step > OTHERWISE_LIT[1] for step in steps)
    if apart <= FEW_LIT * len(steps):
        return None
    return (
        f"{apart} of {len(steps)} pairs of views from nearly the same side differ in brightness by more than "
        f"{100 * OTHERWISE_LIT[1]:.0f} %: either the light changed, or sides that look alike are "
        "taken for one another and poses are wrong"
    )


def _steps_within(
    degrees: float,
    poses: Mapping[ViewId, Array],
    pairs: Pairs,
    brightness: Mapping[ViewId, Array],
    cameras: Collection[str],
) -> list[float]:
    """Median differences of brightness between views of these cameras that are turned by no more than
    that."""
    steps = []
    for (one, other), pair in pairs.items():
        if one in poses and other in poses and one.camera == other.camera and one.camera in cameras:
            turn = (poses[other] @ np.linalg.inv(poses[one]))[:3, :3]
            step = brightness[other][pair.index[:, 1]] - brightness[one][pair.index[:, 0]]
            if np.trace(turn) > 1 + 2 * np.cos(np.radians(degrees)) and np.isfinite(step).any():
                steps.append(abs(float(np.nanmedian(step))))
    return steps
