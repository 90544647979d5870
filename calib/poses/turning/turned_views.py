"""Views that one place explains: their turns, their lenses, and directions in place of points."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from calib.adjustment.bundle_adjustment import misses
from calib.data.features import Features, MatchedPair
from calib.poses.rigs.known_rig import camera_of
from calib.poses.turning.adjustment import Matches, adjust_turns
from calib.poses.turning.pair_turns import SHARE, turn_of, turning_lenses
from imaging.arrays import Array
from imaging.files.colmap import pycolmap
from imaging.optics.lens import Lens, rays
from imaging.session.calibration import TURNED
from imaging.session.records import Rung
from imaging.session.view_id import ViewId

MOST_MATCHES = 150
"""Matches of a pair in the adjustment."""
REASON = (
    "all views were taken from one place, as on a nodal head, to {:.2f} px in the median: they have turns "
    "and no depth, which is what `rig merge --panorama` needs; a scene to walk in needs views from several "
    "places"
)


@dataclass(frozen=True, eq=False)
class TurnedViews:
    """The pycolmap model, with points at distance 1 in the direction of what they are, and its rung."""

    reconstruction: Any
    rung: Rung


def turned_views(
    features: Mapping[ViewId, Features],
    pairs: Mapping[tuple[ViewId, ViewId], MatchedPair],
    lenses: Mapping[str, Lens],
    held: Collection[str],
    focal_known: Collection[str],
    max_error: float,
) -> TurnedViews | None:
    """Place views by turns alone; None if these do not explain the matches.

    Args:
        features: Of every view.
        pairs: Matches by pair of views.
        lenses: First guess of each camera's lens.
        held: Cameras whose lenses are known.
        focal_known: Cameras whose focal length is known roughly.
        max_error: Largest miss of a match, px.

    Returns:
        The views that hang together, or None.
    """
    started = turning_lenses(pairs, lenses, held, focal_known)
    if started is None:
        return None
    views, turns = _first_turns(pairs, started)
    number = {view: index for index, view in enumerate(views)}
    inside = {
        (number[one], number[other]): pair
        for (one, other), pair in pairs.items()
        if one in number and other in number
    }
    cameras = [view.camera for view in views]
    matches = _matches(inside, MOST_MATCHES)
    turned = adjust_turns(matches, turns, cameras, started, held)
    if float((turned.miss < max_error).mean()) < SHARE:
        return None
    model = _model(views, features, inside, turned.turns, turned.lenses, max_error)
    # A wider look than that of the adjustment, which saw some of the matches.
    typical = misses(model).typical
    return TurnedViews(model, Rung(name=TURNED, taken=True, reason=REASON.format(typical)))


def _first_turns(
    pairs: Mapping[tuple[ViewId, ViewId], MatchedPair], lenses: Mapping[str, Lens]
) -> tuple[list[ViewId], Array]:
    """The largest set of views that hang together, and their turns along the pairs with most matches."""
    links = []
    for (one, other), pair in pairs.items():
        turn = turn_of(pair, lenses[one.camera], lenses[other.camera])
        if turn.share >= 0.5:
            links.append((int(turn.fits.sum()), one, other, turn.rotation))
    links.sort(key=lambda link: (-link[0], link[1], link[2]))
    groups: dict[ViewId, dict[ViewId, Array]] = {}
    for _, one, other, rotation in links:
        mine = groups.setdefault(one, {one: np.eye(3)})
        theirs = groups.setdefault(other, {other: np.eye(3)})
        if mine is theirs:
            continue
        # World of `one` for all that hang on `other`.
        world = theirs[other].T @ rotation @ mine[one]
        for view, cam_from_theirs in theirs.items():
            mine[view] = cam_from_theirs @ world
            groups[view] = mine
    largest = max(groups.values(), key=len)
    views = sorted(largest)
    return views, np.stack([largest[view] for view in views])


def _matches(pairs: Mapping[tuple[int, int], MatchedPair], most: int) -> Matches:
    ends, places = [], []
    for (one, other), pair in pairs.items():
        step = -(-len(pair.one) // most)
        some = np.stack([pair.one[::step], pair.other[::step]], axis=1)
        places.append(some)
        ends.append(np.tile([one, other], (len(some), 1)))
    return Matches(np.concatenate(ends), np.concatenate(places))


def _model(
    views: list[ViewId],
    features: Mapping[ViewId, Features],
    pairs: Mapping[tuple[int, int], MatchedPair],
    turns: Array,
    lenses: Mapping[str, Lens],
    max_error: float,
) -> Any:
    """A pycolmap model of views at the origin and of tracks at distance 1."""
    model = pycolmap.Reconstruction()
    cameras = {name: index for index, name in enumerate(sorted({view.camera for view in views}), 1)}
    for name, index in cameras.items():
        camera = camera_of(lenses[name])
        camera.camera_id = index
        model.add_camera_with_trivial_rig(camera)
    directions = []
    for index, (view, turn) in enumerate(zip(views, turns, strict=True), 1):
        image = pycolmap.Image(name=view.image_name, camera_id=cameras[view.camera], image_id=index)
        points = features[view].points
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(place) for place in points])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(turn), np.zeros(3))
        model.add_image_with_trivial_frame(image, pose)
        directions.append(rays(lenses[view.camera], points) @ turn)
    first = np.concatenate([[0], np.cumsum([len(one) for one in directions])])
    every = np.concatenate(directions)
    ends = []
    for (one, other), pair in pairs.items():
        pair_ends = first[[one, other]] + pair.index.astype(np.int64)
        reach = max_error / lenses[views[one].camera].fx
        near = np.linalg.norm(every[pair_ends[:, 0]] - every[pair_ends[:, 1]], axis=1) < reach
        ends.append(pair_ends[near])
    joined = np.concatenate(ends)
    graph = coo_matrix((np.ones(len(joined)), (joined[:, 0], joined[:, 1])), shape=(len(every),) * 2)
    _, track = connected_components(graph, directed=False)
    order = np.argsort(track, kind="stable")
    bounds = np.flatnonzero(np.diff(track[order], prepend=-1, append=-1))
    owner = np.searchsorted(first, np.arange(len(every)), side="right") - 1
    for start, end in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        members = order[start:end]
        if len(members) < 2 or len(set(owner[members].tolist())) < len(members):
            continue  # alone, or two features of one view
        mean = every[members].sum(axis=0)
        elements = [
            pycolmap.TrackElement(int(owner[one]) + 1, int(one - first[owner[one]])) for one in members
        ]
        model.add_point3D(mean / np.linalg.norm(mean), pycolmap.Track(elements))
    return model
