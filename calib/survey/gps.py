"""A scene placed by where its photographs say that they were taken."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.data.views import View
from calib.poses.sfm import SceneModel, centres, transformed
from calib.survey.points import ENU, east_north_up
from calib.survey.similarity import Similarity, consensus, is_line, standard_errors
from imaging.errors import InputError
from imaging.files.photo import read_metadata
from imaging.sensor.mosaic import GpsPosition
from imaging.session.coordinates import CoordinateSystem
from imaging.session.records import Rung
from imaging.session.session import Session
from imaging.session.view_id import ViewId

NAME = "gps"
FEWEST = 6
SURE_SCALE, SURE_TURN = 0.1, 10.0
"""Standard errors, relative and degrees, beyond which positions are too inaccurate to place a scene by."""
_LEAST = 1e-3
"""m: receivers do not do better."""


@dataclass(frozen=True, eq=False)
class GpsFit:
    """A model in east, north and up of an origin; errors: of scale, turn and place."""

    similarity: Similarity
    origin: tuple[float, float, float]
    rms: float
    errors: tuple[float | None, float, float]
    used: int
    left_out: int

    @property
    def sure(self) -> bool:
        """True if it is accurate enough to place a scene by."""
        scale, turn, _ = self.errors
        return (scale is None or scale <= SURE_SCALE) and turn <= SURE_TURN


def positions_of(session: Session, views: Sequence[View]) -> dict[ViewId, GpsPosition]:
    """Return where the photographs say that they were taken, with a height; those that say it."""
    positions = {}
    for view in views:
        try:
            position = read_metadata(session.file(view.shots[0])).position
        except InputError:
            continue
        if position is not None and position.altitude is not None:
            positions[view.id] = position
    return positions


def fit_gps(model: SceneModel, positions: Mapping[ViewId, GpsPosition]) -> GpsFit | str:
    """Fit the model to its positions, or return the reason why they do not determine it."""
    views = [view for view in sorted(positions) if view in model.poses]
    places = np.array([(p.latitude, p.longitude, p.altitude) for p in (positions[view] for view in views)])
    different = len(np.unique(places, axis=0)) if len(views) else 0
    if different < FEWEST:
        return f"photographs with a pose have {different} positions with height, and {FEWEST} are needed"
    latitude, longitude, height = np.median(places, axis=0).tolist()
    origin = round(latitude, 5), round(longitude, 5), float(round(height))
    there = east_north_up(places, origin)
    here = centres([model.poses[view] for view in views])
    stated = [positions[view].error for view in views]
    noise = np.full(len(views), _LEAST)
    similarity, fits, scatter = consensus(here, there, noise, rigid=model.metric)
    if fits.sum() < max(FEWEST, (len(views) + 1) // 2):
        return f"the positions of {len(views)} photographs do not agree with their poses"
    if is_line(there[fits], scatter) or is_line(here[fits], scatter / float(similarity.scale)):
        return "the photographs were taken along a line, about which the scene could turn"
    misses = similarity(here[fits]) - there[fits]
    scale, turn, place = standard_errors(there[fits], misses, np.hypot(noise[fits], scatter))
    rms = float(np.sqrt((misses**2).sum(1).mean()))
    # Receivers err alike for minutes: the mean of many positions is no better than one of them.
    known = [error for error in stated if error is not None]
    place = max(place, rms, float(np.median(known)) if known else 0.0)
    return GpsFit(
        similarity,
        origin,
        rms,
        (None if model.metric else scale, turn, place),
        int(fits.sum()),
        int((~fits).sum()),
    )


def place_by_gps(model: SceneModel, fit: GpsFit | str) -> tuple[SceneModel, CoordinateSystem | None, Rung]:
    """The model in east, north and up, or unchanged where positions are too inaccurate; the rung gives the
    reason.
    """
    if isinstance(fit, str):
        return model, None, Rung(name=NAME, taken=False, reason=fit)
    scale, turn, place = fit.errors
    if not fit.sure:
        size = "" if scale is None else f"the scale to {100 * scale:.2g} % and "
        reason = (
            f"the positions of {fit.used} photographs determine {size}the rotation to {turn:.2g} degrees "
            f"only: they scatter by {fit.rms:.2g} m"
        )
        return model, None, Rung(name=NAME, taken=False, reason=reason)
    coordinates = CoordinateSystem(
        source="gps", system=ENU, origin=fit.origin, rms=fit.rms, scale_error=scale,
        rotation_error=turn, position_error=place, used=fit.used, left_out=fit.left_out,
    )  # fmt: skip
    of = "rotation and place" if model.metric else "scale, rotation and place"
    reason = f"the positions of {fit.used} photographs determine {of}; they scatter by {fit.rms:.2g} m (rms)"
    return transformed(model, fit.similarity.sim3d), coordinates, Rung(name=NAME, taken=True, reason=reason)
