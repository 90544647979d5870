"""Choice of the terms of a lens: those that make held-out scene points project better, and no others.

A lens with more terms than the views can separate fits its own errors and bends the poses.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from calib.adjustment.bundle_adjustment import Free, adjust, lens_of, misses
from calib.adjustment.fisheye import may_be_fisheye
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.optics import lens as optics
from imaging.progress import Progress
from imaging.session.records import ONE_OF_SEVERAL, Rung

FISHEYE = "lens_fisheye"
OBLONG, OBLONG_GAIN = 0.01, 0.25
"""Relative difference of two focal lengths beyond which they have to save that much loss, since pixels are
square: those of buildings, telephones and a chair differ by 0.17 % at most. Near the noise a difference of
4.4 % saved 0.007, and was none; pixels of an anamorphic video, 7 % higher than wide, save 2.2.
"""
_NEEDS_FOCAL = ("lens_principal_point", "lens_tangential", "lens_fisheye_far")
"""Terms that are not tried where the scene does not determine the focal length."""
FEWEST_VIEWS = 4
HELD_OUT = 3
"""Stride of the scene points that are held out."""
MATERIAL = 0.025
"""Saving of loss that a further term needs to be taken by one standard error; less has to be
`ONE_OF_SEVERAL`. An observation with the typical residual loses 0.7. Terms that lenses lack gain 0.021 at
most on the scenes of bench/recon/parts/ladder_scenes.py, where most of those that they have gain 0.08 and
more; few views show even that by a standard error only. A fisheye is no further term but another model.
"""
MOST_POINTS = 2000
"""Scene points that are enough to judge by: those seen in most views."""


def climb(
    reconstruction: Any,
    free: Free,
    scale: float,
    threads: int,
    progress: Progress,
    why_fixed: str = "a board gave the lenses",
    uncut: Any | None = None,
) -> tuple[Free, tuple[Rung, ...]]:
    """Try each term of the lenses on top of those already taken. Changes nothing.

    Args:
        reconstruction: pycolmap's, adjusted.
        free: Terms to begin with, and what is fixed.
        scale: Typical miss of an observation, px.
        threads: Number of threads of the solver.
        progress: Callback for the current step, the steps done, and all of them.
        why_fixed: Reason without trials where every lens is fixed.
        uncut: Model before anything was dropped from it, where the lenses may be fisheyes: only corners that
            radial terms drop distinguish those; other outliers are in it, too. None: no fisheye is tried.

    Returns:
        The terms with those that were taken, and a rung for each trial.
    """
    if free.fixed.issuperset(reconstruction.cameras):
        return free, (Rung(name="lens_terms", taken=False, reason=why_fixed),)
    if reconstruction.num_reg_images() < FEWEST_VIEWS:
        reason = f"fewer than {FEWEST_VIEWS} views cannot judge more than focal length and one radial term"
        return free, (Rung(name="lens_terms", taken=False, reason=reason),)
    sample = _judges(reconstruction)
    if free.model != "RADIAL_FISHEYE":
        free = replace(free, radial=False)
    trials = _trials(free, fisheye=uncut is not None)
    rungs = []
    if any(one.held for one in free.focal.values()):
        # A middle aside looks like a tilt there, as a longer lens looks like more height.
        trials = [trial for trial in trials if trial[0] not in _NEEDS_FOCAL]
        reason = (
            "a scene that does not determine the focal length does not determine the principal point either"
        )
        rungs.append(Rung(name="lens_principal_point", taken=False, reason=reason))
    below, _ = _held_out(sample, free, scale, threads)
    for done, (name, more, what) in enumerate(trials):
        progress("judging the lens", done, len(trials))
        higher = replace(free, **more)
        if name == FISHEYE:
            sample, scale = _judges(uncut), misses(uncut).typical
            below, _ = _held_out(sample, free, scale, threads)
        above, observations = _held_out(sample, higher, scale, threads)
        gain, error = mean_gain(below - above, observations)
        large = gain >= MATERIAL or name == FISHEYE
        rung = Rung.judged(
            name,
            gain,
            error,
            "Cauchy loss per held-out observation, over views",
            f"{what}, common to all images of a camera",
            errors=1.0 if large else ONE_OF_SEVERAL,
        )
        if rung.taken and (why := _unlikely(sample, higher, scale, threads, gain)) is not None:
            rung = rung.model_copy(update={"taken": False, "reason": f"{what}{why}"})
        rungs.append(rung)
        if rung.taken:
            free, below = higher, above
    progress("judging the lens", len(trials), len(trials))
    return free, tuple(rungs)


def sees_wide(reconstruction: Any) -> bool:
    """Return whether a fisheye is worth a trial: it differs from radial terms far from the axis only.

    An adjustment with radial terms drops those points, so the uncut model is judged.
    """
    return any(may_be_fisheye(lens_of(camera)) for camera in reconstruction.cameras.values())


def _trials(free: Free, *, fisheye: bool) -> list[tuple[str, dict[str, Any], str]]:
    """Terms to try on top of those to begin with, in order: names of rungs, changes of `Free`, and words."""
    middle = ("lens_principal_point", {"principal_point": True}, "a principal point off the middle")
    if free.model == "RADIAL_FISHEYE":
        what = "two more terms of the fisheye and two focal lengths"
        return [middle, ("lens_fisheye_far", {"model": "OPENCV_FISHEYE"}, what)]
    trials: list[tuple[str, dict[str, Any], str]] = [
        ("lens_radial_1", {"radial": True}, "a radial term"),
        middle,
        ("lens_radial_2", {"radial": True, "model": "RADIAL"}, "a second radial term"),
        ("lens_tangential", {"radial": True, "model": "OPENCV"}, "tangential terms and two focal lengths"),
    ]
    if fisheye:
        changed = {"radial": True, "model": "RADIAL_FISHEYE"}
        trials.append((FISHEYE, changed, "a fisheye of two terms instead"))
    return trials


def _unlikely(sample: Any, free: Free, scale: float, threads: int, gain: float) -> str | None:
    """The reason against terms that fit the points and make a lens that is hardly one; None without any."""
    if _folds(sample, free, scale, threads):
        return " would fold a lens over within its image, where few points are seen"
    if gain < OBLONG_GAIN and _oblong(sample, free, scale, threads):
        return f", which would be more than {100 * OBLONG:g} % apart: pixels are square"
    return None


def _folds(sample: Any, free: Free, scale: float, threads: int) -> bool:
    """Return whether the terms of a fisheye turn back towards the axis before the corner of an image."""
    fitted = pycolmap.Reconstruction(sample)
    adjust(fitted, free, scale, threads)
    lenses = [lens_of(camera) for camera in fitted.cameras.values()]
    return any(lens.fisheye and math.isinf(optics.widest_angle(lens)) for lens in lenses)


def _oblong(sample: Any, free: Free, scale: float, threads: int) -> bool:
    """Return whether a lens with these terms has focal lengths that are `OBLONG` apart."""
    if free.model not in ("OPENCV", "OPENCV_FISHEYE"):
        return False
    fitted = pycolmap.Reconstruction(sample)
    adjust(fitted, free, scale, threads)
    lenses = [lens_of(camera) for camera in fitted.cameras.values()]
    return any(abs(lens.fy / lens.fx - 1) > OBLONG for lens in lenses)


def _judges(reconstruction: Any) -> Any:
    """A copy with only the points that are seen in most views."""
    sample = pycolmap.Reconstruction(reconstruction)
    lengths = {key: point.track.length() for key, point in sample.points3D.items()}
    for key in sorted(lengths, key=lambda key: (-lengths[key], key))[MOST_POINTS:]:
        sample.delete_point3D(key)
    return sample


def mean_gain(gains: Array, observations: Array) -> tuple[float, float]:
    """Return the mean gain of an observation, and its standard error over views.

    A view with two held-out observations says no more than these two do.

    Args:
        gains: Of each view, in total over its held-out observations [N].
        observations: Their number [N].
    """
    if not observations.any():
        return 0.0, 0.0
    mean = gains.sum() / observations.sum()
    scatter = np.sum((gains - mean * observations) ** 2) * len(gains) / (len(gains) - 1)
    return float(mean), float(np.sqrt(scatter) / observations.sum())


def _held_out(sample: Any, free: Free, scale: float, threads: int) -> tuple[Array, Array]:
    """Loss of each view on all held-out points it sees, after adjusting to the others, and their number."""
    keys = sorted(sample.points3D)
    training, testing = pycolmap.Reconstruction(sample), pycolmap.Reconstruction(sample)
    for order, key in enumerate(keys):
        (training if order % HELD_OUT == 0 else testing).delete_point3D(key)
    adjust(training, free, scale, threads)
    for index, camera in training.cameras.items():
        testing.cameras[index].model = camera.model
        testing.cameras[index].params = camera.params
    for index, rig in training.rigs.items():
        for sensor in rig.non_ref_sensors:
            testing.rigs[index].set_sensor_from_rig(sensor, rig.sensor_from_rig(sensor))
    for index, frame in training.frames.items():
        if frame.has_pose():
            testing.frames[index].rig_from_world = frame.rig_from_world
    adjust(testing, free, scale, threads, points_only=True)
    residuals = misses(testing)
    loss = np.log1p(np.minimum(residuals.error / scale, 1e3) ** 2)
    views = np.array(sorted(sample.reg_image_ids()))
    place = np.searchsorted(views, residuals.image)
    total, count = (np.bincount(place, weights, len(views)) for weights in (loss, np.ones(len(place))))
    return total.astype(np.float64), count.astype(np.float64)
