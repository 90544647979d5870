"""Photographs of pixel shift: every four of a camera are one."""

from collections.abc import Sequence
from dataclasses import replace

from capture.bracket.deviation import deviates
from capture.imports.originals import Original, shown
from capture.imports.sorting.grouping import PhotoSeries
from imaging.errors import InputError
from imaging.merge.pixel_shift import COUNT


def put_together(series: Sequence[PhotoSeries]) -> tuple[list[PhotoSeries], list[str]]:
    """Each camera with one photograph for every four in their order, and a sentence of what was assumed.

    InputError where the photographs of a camera are no RAW files, no multiple of four or, within four, of
    different exposures.
    """
    joined, count = [], 0
    for one in series:
        photos = one.originals
        if len(photos) % COUNT:
            raise InputError(
                f"camera {one.camera.name} has {len(photos)} photographs, no multiple of {COUNT}: "
                "add what is missing, or leave --pixel-shift out."
            )
        groups = [photos[start : start + COUNT] for start in range(0, len(photos), COUNT)]
        joined.append(PhotoSeries(one.camera, tuple(_together(group) for group in groups)))
        count += len(groups)
    return joined, [f"Every {COUNT} photographs are a pixel shift, {count} in all; as given."]


def _together(group: Sequence[Original]) -> Original:
    first = group[0]
    lost = next((original for original in group if original.picture is None), None)
    if lost is not None:
        return replace(lost, path=first.path)
    for other in group:
        name = f"{shown(other.path)} cannot be part of a pixel shift"
        if other.kind != "raw":
            raise InputError(f"{name}: it is not a RAW file; import such photographs without --pixel-shift.")
        same = first.exposure == other.exposure or (
            first.exposure is not None
            and other.exposure is not None
            and not deviates(other.exposure, first.exposure)
        )
        if not same:
            raise InputError(
                f"{name} with {shown(first.path)}, whose exposure is another: "
                f"sort the photographs into groups of {COUNT}, or leave --pixel-shift out."
            )
    return replace(first, shifted=tuple(original.path for original in group))
