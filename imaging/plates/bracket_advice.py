"""Advice from a merged bracket for the next capture."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from imaging.merge import alignment
from imaging.merge.linear_frame import LinearFrame
from imaging.merge.ratios import overlap, ratio

WRONG = 0.03
"""Disagreement, natural log, of overlapping exposures with their labels that is worth reporting."""


def warnings_of(
    frames: Sequence[LinearFrame],
    shares: Sequence[float],
    shift: float | None,
    *,
    check_labels: bool,
    assumed_curve: bool,
) -> tuple[str, ...]:
    """Return what a user should do otherwise next time.

    Args:
        frames: Exposures of the bracket, without the pixels behind masks.
        shares: Shares of the pixels, 0..1, that are clipped in every exposure, dark in every exposure, and
            ghosts.
        shift: Largest shift between two exposures, px; None if it cannot be measured.
        check_labels: True to compare the exposures with their labels, where no calibration gives their
            scales.
        assumed_curve: True if the response is a curve that is not measured: its error and that of the labels
            look the same.

    Returns:
        Advice, a clause each; empty if all is well.
    """
    clipped, dark, ghost = shares
    said = []
    if clipped > 0.5:
        said.append(f"{100 * clipped:.0f} % of it is saturated in every exposure: take shorter ones")
    if dark > 0.5:
        said.append(f"{100 * dark:.0f} % of it is black in every exposure: take longer ones")
    if shift is not None and shift > alignment.SHAKEN:
        said.append(f"the camera moved by {shift:.1f} px between exposures: fix it to a tripod")
    if ghost > 0.2:
        said.append(f"its exposures disagree over {100 * ghost:.0f} % of it: keep the scene still")
    wrong = _mislabelled(frames) if check_labels else None
    if wrong is not None and wrong > WRONG:
        by = f"{100 * np.expm1(wrong):.0f} %"
        said.append(
            f"its exposures do not fit the assumed sRGB curve (by up to {by}): run `rig calibrate` first, "
            "which measures it"
            if assumed_curve
            else f"its exposures are off their labels by {by}: run `rig calibrate` first"
        )
    return tuple(said)


def _mislabelled(frames: Sequence[LinearFrame]) -> float | None:
    """Largest disagreement of neighbouring exposures with their labels, natural log, or None without
    overlap.
    """
    ordered = sorted(frames, key=lambda frame: frame.k)
    departures = []
    for shorter, longer in pairwise(ordered):
        edge = ratio([overlap(longer, shorter)])
        if edge is not None:
            departures.append(abs(edge.log - float(np.log(longer.k / shorter.k))))
    return max(departures, default=None)
