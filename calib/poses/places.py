"""A model brought to where its photographs say that they were taken, if they agree about it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from calib.adjustment.jacobian import is_reference
from calib.adjustment.place_priors import StatedPlace
from imaging.files.colmap import pycolmap
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

NAME = "pose_stated"
FEWEST = 6
AGREE = 4.0
"""Standard deviations by which a place may miss."""
WIDE = 3.0
"""Least spread of the places in two directions, in such deviations: less leaves their rotation open."""
_TILT, _HEADING = np.radians(10.0), np.radians(60.0)
"""Largest median residuals of attitudes; beyond, they are rejected."""


def align_to_places(
    reconstruction: Any, stated: Mapping[ViewId, StatedPlace]
) -> tuple[dict[int, StatedPlace], Rung | None]:
    """Move, turn and scale a model to the stated places, in place.

    Args:
        reconstruction: the pycolmap model.
        stated: by view.

    Returns:
        What counts, by COLMAP's number of the image: nothing where the places do not agree with the poses.
        The rung says why; None where nothing is stated.
    """
    located = {}
    for index in sorted(reconstruction.reg_image_ids()):
        image = reconstruction.image(index)
        view = ViewId.of_image(image.name)
        if view in stated and is_reference(reconstruction, image):
            located[index] = stated[view]
    if not located:
        return {}, None
    there = np.array([place.centre for place in located.values()])
    spread = np.array([place.spread for place in located.values()])
    if len(np.unique(there.round(2), axis=0)) < FEWEST:
        return {}, _refused(f"fewer than {FEWEST} photographs have different places")
    wide = np.linalg.svd(there - there.mean(0), compute_uv=False)[1] / np.sqrt(len(there))
    if wide < WIDE * float(np.median(spread[:, :2])):
        return {}, _refused("the places lie too near to each other, or to a line, for their accuracy")
    here = np.array([reconstruction.image(index).projection_center() for index in located])
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = AGREE * float(np.median(np.linalg.norm(spread, axis=1))), 0
    agreed = pycolmap.estimate_sim3d_robust(here, there, options)
    if agreed is None:
        return {}, _refused("the places do not agree with the poses")
    transform = agreed["tgt_from_src"]
    moved = np.array([transform * one for one in here])
    near = (np.abs(moved - there) <= AGREE * spread).all(1)
    if near.sum() < max(FEWEST, (len(near) + 1) // 2):
        return {}, _refused(f"the places of {int((~near).sum())} photographs do not agree with their poses")
    reconstruction.transform(transform)
    agreeing = {index: place for (index, place), good in zip(located.items(), near, strict=True) if good}
    turned, words = _with_turns(reconstruction, agreeing)
    reason = f"places of {len(agreeing)} photographs count in the adjustment by their accuracy{words}"
    return turned, Rung(name=NAME, taken=True, reason=reason)


def _refused(reason: str) -> Rung:
    return Rung(name=NAME, taken=False, reason=reason)


def _with_turns(reconstruction: Any, places: Mapping[int, StatedPlace]) -> tuple[dict[int, StatedPlace], str]:
    """The places with their attitudes where these agree with the poses in the median, and words for it."""
    tilts, headings = [], []
    for index, place in places.items():
        if place.turn is None:
            continue
        turn = reconstruction.image(index).cam_from_world().rotation.matrix()
        apart = cv2.Rodrigues(place.turn.T @ turn)[0].ravel()
        tilts.append(float(np.hypot(apart[0], apart[1])))
        headings.append(abs(float(apart[2])))
    if not tilts:
        return dict(places), ""
    if np.median(tilts) > _TILT or np.median(headings) > _HEADING:
        words = f"; attitudes do not, which miss the poses by {np.degrees(np.median(tilts)):.0f} degrees"
        return {index: replace(place, turn=None) for index, place in places.items()}, words
    return dict(places), ", and so do the attitudes of the camera's gimbal"
