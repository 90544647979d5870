"""Frame of each bracket: from the layout, or by the clocks of the cameras."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.imports.layouts.given import Given, GivenPhoto
from capture.imports.originals import Original
from capture.imports.request import Together
from capture.imports.sorting.band_list import split_by_band
from capture.imports.sorting.clock_matching import listed, match_frames
from capture.imports.sorting.grouping import Bracket, PhotoSeries, split_into_brackets
from imaging.session.records import Band, CameraRecord

_OWN_FRAME = "is a frame of its own"
"""Reason given for a camera without brackets."""


@dataclass(frozen=True)
class Numbered:
    """The brackets of one camera by frame, rising; and why they are as they are."""

    camera: CameraRecord
    brackets: dict[int, Bracket]
    why: str


def frames_in_time(
    series: Sequence[PhotoSeries],
    count: int | None,
    together: Together | None,
    band_of: Mapping[Path, str] | None = None,
    bands: Sequence[Band] = (),
    *,
    ordered: bool = False,
) -> tuple[list[Numbered], list[str]]:
    """Brackets of `count` photographs, or as guessed; those of one instant share a frame.

    Cameras that were fired together become a rig.

    Args:
        series: Photographs of each camera.
        count: Photographs in each bracket; None: guessed.
        together: Criterion that joins brackets of several cameras into a frame; None: guessed.
        band_of: Name of the filter that each photograph was taken through; None: without filters.
        bands: Filters that `band_of` names.
        ordered: True if the cameras are declared to have shot together, as in `match_frames`.

    Returns:
        The brackets of each camera by frame, and a sentence for each guess.

    Raises:
        InputError: A camera has unequal numbers of frames through its filters.
    """
    split = [
        split_by_band(sequence, count, band_of, bands) if band_of else split_into_brackets(sequence, count)
        for sequence in series
    ]
    matched = match_frames(
        [sequence.camera for sequence in series],
        [brackets for brackets, _ in split],
        together,
        ordered=ordered,
    )
    numbered = [
        Numbered(
            sequence.camera if rig is None else sequence.camera.model_copy(update={"rig": f"rig{rig}"}),
            dict(zip(frames, brackets, strict=True)),
            why,
        )
        for sequence, (brackets, why), frames, rig in zip(
            series, split, matched.frames, matched.rigs, strict=True
        )
    ]
    return numbered, [*_summed(numbered), *matched.why]


def _summed(numbered: Sequence[Numbered]) -> list[str]:
    """The reasons of all cameras; those whose photographs are each a frame for one reason in one sentence."""
    reason_of = {
        entry.camera.name: entry.why.partition(_OWN_FRAME)[2] for entry in numbered if _OWN_FRAME in entry.why
    }
    reasons = set(reason_of.values()) - {"."}  # which a single photograph has
    if len(reason_of) < 2 or len(reasons) > 1:
        return [entry.why for entry in numbered]
    reason = reasons.pop() if reasons else "."
    return [
        *(entry.why for entry in numbered if entry.camera.name not in reason_of),
        f"{listed(list(reason_of))}: each photo {_OWN_FRAME}{reason}",
    ]


def frames_of_layout(
    series: Sequence[PhotoSeries], given: Given, count: int | None, together: Together | None
) -> tuple[list[Numbered], list[str]]:
    """Brackets and frames of a layout, if it defines them and `count` does not contradict.

    Photographs of one frame, where the layout numbers frames; else photographs in a row that have one pose
    and differ in exposure; else each for itself, since each has a pose of its own.

    Args:
        series: Photographs of each camera, all of them named by the layout.
        given: Layout.
        count: Photographs in each bracket; None: as the layout has them.
        together: Criterion that joins brackets of several cameras into a frame, in place of the layout; None:
            as the layout has them, or guessed if it has neither poses nor frames.

    Returns:
        The brackets of each camera by frame, and a sentence for each guess.
    """
    if together is not None or not any(
        photo.cam_from_world or photo.frame is not None for photo in given.photos
    ):
        return frames_in_time(series, count, together)
    photo_of = {photo.path: photo for photo in given.photos}
    numbered: list[Numbered] = []
    # Frames that the layout does not number come after all others: nothing says that two cameras were there
    # at one moment.
    known = () if count is not None else tuple(p.frame for p in given.photos if p.frame is not None)
    start = 1 + max(known, default=-1)
    for sequence in series:
        brackets: dict[int, Bracket] = {}
        if count is not None:
            others, why = split_into_brackets(sequence, count)
        else:
            brackets = _numbered_by_layout(sequence, photo_of)
            rest = [photo for photo in sequence.originals if photo_of[photo.path].frame is None]
            others, why = _by_pose(rest, photo_of), ""
        brackets |= dict(enumerate(others, start=start))
        start += len(others)
        rig = given.rigs.get(photo_of[sequence.originals[0].path].camera)
        camera = sequence.camera if rig is None else sequence.camera.model_copy(update={"rig": rig[0]})
        numbered.append(Numbered(camera, brackets, why or _reason(camera.name, brackets, given.teller)))
    return numbered, _summed(numbered)


def _numbered_by_layout(series: PhotoSeries, photo_of: Mapping[Path, GivenPhoto]) -> dict[int, Bracket]:
    brackets: dict[int, Bracket] = {}
    for original in series.originals:
        frame = photo_of[original.path].frame
        if frame is not None:
            brackets.setdefault(frame, []).append(original)
    return dict(sorted(brackets.items()))


def _reason(name: str, brackets: Mapping[int, Bracket], source: str) -> str:
    sizes = sorted({len(bracket) for bracket in brackets.values()})
    how = " or ".join(str(size) for size in sizes)
    what = (
        f"each of {len(brackets)} photos is a frame of its own"
        if sizes == [1]
        else f"{len(brackets)} frames of {how} exposures"
    )
    return f"{name}: {what}, as {source} has them; --bracket N groups every N photos."


def _by_pose(originals: Sequence[Original], photo_of: Mapping[Path, GivenPhoto]) -> list[Bracket]:
    brackets: list[Bracket] = []
    for original in originals:
        if brackets and _same_place(brackets[-1], original, photo_of):
            brackets[-1].append(original)
        else:
            brackets.append([original])
    return brackets


def _same_place(bracket: Bracket, original: Original, photo_of: Mapping[Path, GivenPhoto]) -> bool:
    """Return whether a photograph has the pose of a bracket and an exposure that is not in it yet."""
    before, after = photo_of[bracket[0].path].cam_from_world, photo_of[original.path].cam_from_world
    exposures = [photo.exposure for photo in (*bracket, original)]
    if before is None or after is None or None in exposures or exposures[-1] in exposures[:-1]:
        return False
    here, other = before.matrix(), after.matrix()
    return bool(np.abs(here - other).max() <= 1e-9 * max(1.0, float(np.abs(here).max())))
