"""Which frame each bracket is: as a layout tells it, or in order."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from capture.grouping import Bracket, Series
from capture.layouts.given import Given, GivenPhoto
from capture.originals import Original

Numbered = list[tuple[int, Bracket]]
"""Brackets of one camera, each with its frame."""


def frames_of_layout(series: Series, given: Given, first: int) -> tuple[Numbered, str] | None:
    """The brackets that a layout makes of a camera's photographs, and why; None if it tells nothing.

    Photographs of one frame, where the layout numbers frames; else photographs in a row that have one
    pose and differ in exposure; else each for itself, since each has a pose of its own. first: the
    frame that the first bracket gets which the layout does not number.
    """
    told = {photo.path: photo for photo in given.photos}
    mine = [(original, told.get(original.path)) for original in series.originals]
    numbered: dict[int, Bracket] = {}
    for original, photo in mine:
        if photo is not None and photo.frame is not None:
            numbered.setdefault(photo.frame, []).append(original)
    rest = [original for original, photo in mine if photo is None or photo.frame is None]
    if not numbered and not any(photo.cam_from_world for _, photo in mine if photo is not None):
        return None
    for frame, bracket in enumerate(_by_pose(rest, told), start=max([first, *(n + 1 for n in numbered)])):
        numbered[frame] = bracket
    brackets = sorted(numbered.items())
    name, source = series.camera.name, given.teller
    sizes = {len(bracket) for _, bracket in brackets}
    if sizes == {1}:
        return brackets, (
            f"{name}: each of {len(brackets)} photos is a frame of its own, as {source} has them; "
            "--bracket N groups every N photos."
        )
    return brackets, (
        f"{name}: {len(brackets)} frames of {min(sizes)} to {max(sizes)} exposures, as {source} has them; "
        "--bracket N groups every N photos."
        if len(sizes) > 1
        else f"{name}: {len(brackets)} frames of {max(sizes)} exposures, as {source} has them; "
        "--bracket N groups every N photos."
    )


def _by_pose(originals: list[Original], told: Mapping[Path, GivenPhoto]) -> list[Bracket]:
    brackets: list[Bracket] = []
    for original in originals:
        if brackets and _same_place(brackets[-1], original, told):
            brackets[-1].append(original)
        else:
            brackets.append([original])
    return brackets


def _same_place(bracket: Bracket, original: Original, told: Mapping[Path, GivenPhoto]) -> bool:
    """Whether a photograph has the pose of a bracket and an exposure that is not in it yet."""
    before, after = (told.get(one.path) for one in (bracket[0], original))
    if before is None or after is None or before.cam_from_world is None or after.cam_from_world is None:
        return False
    exposures = [one.exposure for one in (*bracket, original)]
    if any(exposure is None for exposure in exposures) or exposures[-1] in exposures[:-1]:
        return False
    one, other = before.cam_from_world.matrix(), after.cam_from_world.matrix()
    return bool(np.abs(one - other).max() <= 1e-9 * max(1.0, float(np.abs(one).max())))
