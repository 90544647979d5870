"""Pairs of views whose turns do not close loops with those of other pairs.

Turns along a cycle of true pairs add up to none (Zach, Klopschitz and Pollefeys, "Disambiguating Visual
Relations Using Loop Constraints", 2010); a false pair opens the loops that it is part of.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from calib.poses.checks.brightness_steps import Pairs
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.session.view_id import ViewId

CLOSED = 10.0
"""Degrees by which the turns of three pairs may miss a closed loop."""
TRIALS, MATCHES = 2000, 300
"""RANSAC trials of a turn, by five matches each, and the matches it is estimated from: where three in ten
agree, one trial in 400 has only such. The usual 100,000 trials of all matches take seconds a pair, and where
fewer agree the turn is off by more than `CLOSED` with either."""


def turns_of(reconstruction: Any, pairs: Pairs, max_error: float) -> dict[tuple[ViewId, ViewId], Array]:
    """Turns [3, 3] from the first view of each pair to its second, by its matches alone, of pairs that have
    one and whose cameras the model holds."""
    cameras = {
        ViewId.of_image(image.name).camera: image.camera_id for image in reconstruction.images.values()
    }
    options = pycolmap.RANSACOptions(max_error=max_error, random_seed=0, max_num_trials=TRIALS)
    turns: dict[tuple[ViewId, ViewId], Array] = {}
    for (one, other), pair in pairs.items():
        if one.camera not in cameras or other.camera not in cameras:
            continue
        lenses = [reconstruction.cameras[cameras[view.camera]] for view in (one, other)]
        some = slice(None, None, math.ceil(len(pair.one) / MATCHES))
        relative = pycolmap.estimate_relative_pose(
            lenses[0], pair.one[some], lenses[1], pair.other[some], options
        )
        if relative is not None:
            turns[one, other] = relative["cam2_from_cam1"].rotation.matrix()
    return turns


def open_pairs(turns: Mapping[tuple[ViewId, ViewId], Array], least: int) -> set[tuple[ViewId, ViewId]]:
    """Pairs with which fewer loops of three close than stay open, or fewer than `least`."""
    beside: dict[ViewId, dict[ViewId, Array]] = {}
    for (one, other), turn in turns.items():
        beside.setdefault(one, {})[other] = turn
        beside.setdefault(other, {})[one] = turn.T
    pairs = set()
    for one, other in turns:
        loops = [
            np.trace(beside[third][one] @ beside[other][third] @ beside[one][other])
            for third in beside[one].keys() & beside[other].keys()
        ]
        closed = sum(loop > 1 + 2 * np.cos(np.radians(CLOSED)) for loop in loops)
        if closed < max(len(loops) - closed, least):
            pairs.add((one, other))
    return pairs
