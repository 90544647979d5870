"""Plans and shots of imported photographs."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from capture.bracket.deviation import deviates
from capture.imports.copying import ORIGIN, Place
from capture.imports.given.depths import Depths
from capture.imports.originals import Original
from capture.imports.sorting.frame_numbering import Numbered
from capture.record.shot_files import ShotId
from imaging.optics.exposure import Exposure
from imaging.session.records import PlanRecord


def plans_of(entry: Numbered, band_of: Mapping[Path, str]) -> list[PlanRecord]:
    """One plan for each length of bracket; through filters all brackets go in one order."""
    plans = []
    for size in sorted({len(bracket) for bracket in entry.brackets.values()}):
        mine = {frame: bracket for frame, bracket in entry.brackets.items() if len(bracket) == size}
        first = next(iter(mine.values()))
        plans.append(
            PlanRecord(
                plan=f"{ORIGIN}-{entry.camera.name}-{size}",
                kind="scene",
                created=datetime.now(UTC),
                bracket=tuple(_agreed([bracket[step] for bracket in mine.values()]) for step in range(size)),
                frames=tuple(mine),
                cameras=(entry.camera.name,),
                reason=entry.why,
                bands=tuple(band_of[original.path] for original in first) if band_of else (),
            )
        )
    return plans


def places_of(
    entry: Numbered,
    plans: Sequence[PlanRecord],
    masks: Mapping[Path, Path],
    depths: Depths,
    band_of: Mapping[Path, str],
) -> list[Place]:
    """Place each photograph of a camera as a shot of its plan.

    Args:
        entry: Brackets of a camera.
        plans: Its plans.
        masks: Mask of a photograph.
        depths: Depth map of a photograph.
        band_of: Band of a photograph that was taken through a filter.

    Returns:
        Shots in the order of frames and steps.
    """
    plan_of = {frame: plan.plan for plan in plans for frame in plan.frames}
    return [
        Place(
            original,
            ShotId(entry.camera.name, frame, step),
            plan_of[frame],
            masks.get(original.path),
            band_of.get(original.path),
            depths.get(original.path),
        )
        for frame, bracket in entry.brackets.items()
        for step, original in enumerate(bracket)
    ]


def _agreed(originals: Sequence[Original]) -> Exposure | None:
    """The exposure that all of them have; None where they differ or one is unknown."""
    readable = [original.exposure for original in originals if original.picture is not None]
    first = readable[0] if readable else None
    same = first is not None and all(other is not None and not deviates(other, first) for other in readable)
    return first if same else None
