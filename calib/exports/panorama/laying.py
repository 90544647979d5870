"""Views of one place, merged and laid into the map of all directions one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calib.exports.panorama.gathering import Gathering, Map, SeenView, sampling
from imaging.arrays import Array
from imaging.choices import Space
from imaging.errors import InputError
from imaging.merge.picture import CLIPPED, DARK, HIDDEN, NOTHING
from imaging.plates.merged_view import view_light
from imaging.progress import Progress
from imaging.session.calibration import CalibrationRecord, ViewCalibration
from imaging.session.records import ShotRecord
from imaging.session.session import Session

_BY_CHANCE = 0.2
"""Share of the pixels of a view that may be measured, each for itself, without a texel that is."""


@dataclass
class Laid:
    """Views in a map. uncoloured: cameras whose colour is not known. measured: largest share of a view's
    pixels that are, each for itself.
    """

    gathering: Gathering
    warnings: list[str] = field(default_factory=list)
    uncoloured: dict[str, None] = field(default_factory=dict)
    measured: float = 0.0


def laid_views(
    session: Session,
    calibration: CalibrationRecord,
    chosen: Sequence[tuple[ViewCalibration, list[ShotRecord]]],
    axes: Array,
    rows: int,
    space: Space,
    on_progress: Progress,
) -> Laid:
    """Merge every view and lay it into a map of these axes."""
    laid = Laid(Gathering(rows))
    for done, (view, shots) in enumerate(chosen):
        on_progress("merging", done, len(chosen))
        merged = view_light(session, view.id, shots, calibration, space)
        laid.warnings += [f"{view.id}: {warning}" for warning in merged.warnings]
        if not merged.picture.known_colour:
            laid.uncoloured[view.camera] = None
        unmeasured = merged.picture.mask & (CLIPPED | DARK | NOTHING | HIDDEN)
        laid.measured = max(laid.measured, float((unmeasured == 0).mean()))
        lens = calibration.camera(view.camera).lens
        assert lens is not None  # of every camera with a view
        turn = view.cam_from_world.matrix()[:3, :3] @ axes.T
        samples, shrunk = sampling(lens, rows)
        rotated = SeenView(merged.picture, lens, turn, shrunk)
        laid.gathering.add(rotated, samples, noise=merged.picture.sigma is not None)
    on_progress("merging", len(chosen), len(chosen))
    return laid


def require_measured(session: Path, gathered: Map, measured: float, rows: int) -> None:
    """InputError for a map without any light that is measured; measured: share of the pixels of a view."""
    if not gathered.mask.all():
        return
    if measured > _BY_CHANCE:
        raise InputError(
            f"{session}: --width {2 * rows} is too coarse for these views, none of which fills a texel with "
            "light that is measured: give more columns."
        )
    raise InputError(
        f"{session}: no exposure of any view measures light, all is saturated or black: take shorter or "
        "longer exposures."
    )
