"""A model whose rigs are tied together, adjusted, as far as that does not show that they are not rigid."""

from dataclasses import dataclass, replace
from typing import Any

from calib.adjustment.bundle_adjustment import Free, adjust, drop_outliers, misses
from calib.adjustment.lens_ladder import sees_wide
from calib.poses.pose_inputs import PoseInputs
from calib.poses.rigs.known_rig import tie_rigs
from calib.poses.rigs.non_overlapping import Joined
from imaging.files.colmap import pycolmap
from imaging.progress import Progress
from imaging.session.records import Rung

ROUNDS = 4
"""Rounds of adjusting and cutting outliers."""
LOOSE = 1.5
"""Tied cameras may miss by this much more than free ones; beyond, they are not rigidly mounted."""


@dataclass(frozen=True, eq=False)
class TiedModel:
    """A model with its rigs tied, adjusted. uncut: as it was before, where its lenses may be fisheyes."""

    reconstruction: Any
    free: Free
    typical: float
    rung: Rung
    uncut: Any | None


def tied_model(
    inputs: PoseInputs,
    database: Any,
    joined: Joined,
    free: Free,
    max_error: float,
    metric: bool,
) -> TiedModel:
    """Tie rigs together, as far as that does not show that the cameras moved against each other.

    Args:
        inputs: Inputs of the poses.
        database: pycolmap's, of the model.
        joined: Models that are one; its reconstruction is changed in place.
        free: Free terms of the lenses, what is fixed, and priors.
        max_error: Largest miss of a match, px, from which the cuts of outliers follow.
        metric: True if the model is in metres.

    Returns:
        The adjusted model, tied or not; where cameras that motion joined are not rigid, the untied model,
        not adjusted, with the `typical` of the tied one.
    """
    threads, progress, reconstruction = inputs.threads, inputs.progress, joined.reconstruction
    known, free = inputs.known, free.within(reconstruction)
    if joined.cameras and not metric:
        # A board states in metres where cameras are mounted, which is of no use to a model of another unit.
        known, free = replace(known, cam_from_rig={}), replace(free, placed=frozenset())
    untied = misses(reconstruction).typical
    loose = pycolmap.Reconstruction(reconstruction)
    uncut = pycolmap.Reconstruction(reconstruction) if sees_wide(reconstruction) else None
    rung = tie_rigs(database, reconstruction, inputs.rigs, known)
    typical = polish(reconstruction, free, max_error, threads, progress)
    if rung.taken and typical > LOOSE * max(untied, 0.1):
        reconstruction = loose
        reason = (
            f"the cameras moved relative to each other: as a rigid rig, points miss by {typical:.2f} px "
            f"instead of {untied:.2f} px"
        )
        rung = Rung(name="rig_constraint", taken=False, reason=reason)
        free = replace(free, placed=frozenset())
        if not joined.cameras:
            typical = polish(reconstruction, free, max_error, threads, progress)
    return TiedModel(reconstruction, free, typical, rung, uncut)


def polish(reconstruction: Any, free: Free, max_error: float, threads: int, progress: Progress) -> float:
    """Adjust robustly and drop what misses, a few times.

    The scale of the loss follows the data: sub-pixel corners deserve more than a fixed pixel.

    Args:
        reconstruction: pycolmap's, changed in place.
        free: Free terms of the lenses, what is fixed, and priors.
        max_error: Largest miss of a match, px: an eighth of it is the typical miss at first, and observations
            that miss by less than 0.15 of it are kept.
        threads: Number of threads of the solver.
        progress: Callback for the current step, the steps done, and all of them.

    Returns:
        The typical miss, px.
    """
    typical = 0.125 * max_error
    for turn in range(ROUNDS):
        progress("adjusting", turn, ROUNDS)
        adjust(reconstruction, free, typical, threads, rough=turn < ROUNDS - 1)
        typical = drop_outliers(reconstruction, least=0.15 * max_error)
    progress("adjusting", ROUNDS, ROUNDS)
    return typical
