"""Held-out views: one in eight, or those that a data set's split tests on."""

import math
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

from imaging.errors import InputError, ReconstructionError
from imaging.session.records import ShotRecord, SplitRecord
from imaging.session.session import SPLIT, Session
from imaging.session.view_id import ViewId

EVERY = 8
"""One view in eight is held out."""
FEWEST_FOR_HOLDOUT = 4
"""Below this many views none is held out: what is left could not be trained on."""


def held_out(views: Iterable[ViewId], every: int = EVERY) -> set[ViewId]:
    """Return which of the views are held out: one in `every`, spread over the rig.

    The views are cut, in order of frame and camera, into as many equal runs as views are held out.
    Of each run the one is taken whose camera was taken least often so far, of these the one nearest
    the middle of the run: so the frames are covered evenly and the cameras take turns, where plain
    counting by eight would take the same camera of a rig of four every time.
    """
    ordered = sorted(views)
    if len(ordered) < FEWEST_FOR_HOLDOUT:
        return set()
    count = math.ceil(len(ordered) / every)
    bounds = [round(index * len(ordered) / count) for index in range(count + 1)]
    chosen: list[ViewId] = []
    for start, end in pairwise(bounds):
        taken = [view.camera for view in chosen]
        middle = (start + end - 1) / 2
        best = min(range(start, end), key=lambda i: (taken.count(ordered[i].camera), abs(i - middle), i))
        chosen.append(ordered[best])
    return set(chosen)


def used_shots(session: Session, split: SplitRecord | None) -> list[ShotRecord]:
    """The shots that training or testing looks at."""
    shots = session.shots("scene")
    files = None if split is None else {*split.train, *split.test}
    return shots if files is None else [shot for shot in shots if shot.file in files]


def tested_views(session: Path, groups: dict[ViewId, list[ShotRecord]], split: SplitRecord) -> set[ViewId]:
    """The views whose shots are for testing; what is left has to suffice for training."""
    train, test = (
        {view for view, group in groups.items() if any(shot.file in files for shot in group)}
        for files in (set(split.train), set(split.test))
    )
    if both := sorted(train & test):
        raise InputError(f"{session / SPLIT} trains and tests on view {both[0]}: leave it in one.")
    if not train:
        raise ReconstructionError(
            f"{session / SPLIT} leaves no view with a pose to train on: correct or delete it."
        )
    return test
