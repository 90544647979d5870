"""Path-traced sets beside the real ones: their poses are known, and things shine as real ones do."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from imaging.arrays import Array
from tests.foreign import subjects, truth
from tests.foreign.folder import Body, photograph

METAL = "metal and glass"
TIMES = ((1 / 125, 1 / 30, 1 / 8, 1 / 2, 2.0),)


def metal_and_glass(folder: Path) -> tuple[list[Path], Array]:
    """Photograph objects of metal and glass from all around; what is there stays.

    Args:
        folder: Gets JPEGs of five exposures of each of 28 views, 400 px wide.

    Returns:
        The photographs, and cam_from_world [28, 4, 4].
    """
    scene = subjects.objects()
    if not (folder / "made.json").exists():
        photograph(folder / "photos", scene.light(), Body(seed=4, well=20_000.0), TIMES, developed=True)
        (folder / "made.json").write_text(json.dumps({"views": len(scene.poses)}))
    return sorted((folder / "photos").glob("*.jpg")), scene.poses


def fuse(photographs: list[Path], folder: Path) -> None:
    """Write a picture of each bracket, as a program without brackets is given them.

    All exposures are fused (Mertens, Kautz and Van Reeth 2007) into `folder`/VIEW.png.
    """
    for view, first in enumerate(range(0, len(photographs), len(TIMES[0]))):
        bracket = [cv2.imread(str(path)) for path in photographs[first : first + len(TIMES[0])]]
        fused = cv2.createMergeMertens().process([one for one in bracket if one is not None])
        cv2.imwrite(str(folder / f"{view:04d}.png"), np.clip(255 * fused, 0, 255).round().astype(np.uint8))


def judged(poses: dict[int, Array], true: Array) -> dict[str, Any]:
    """Count the views [4, 4] that stand wrongly: by more than 2 degrees or 2 % of the rig."""
    errors = truth.errors(poses, true)
    right = [turn for view, turn in errors.turn.items() if view not in errors.wrong]
    return {"wrong": len(errors.wrong), "turn_median": float(np.median(right)) if right else None}
