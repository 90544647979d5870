"""Residuals of a scene against held-out photographs, by brightness."""

from dataclasses import dataclass

import numpy as np

from imaging.arrays import Array32
from imaging.errors import RigError
from imaging.progress import unreported
from imaging.session.paths import session_of
from imaging.session.session import Session
from recon.data.light import radiance_image
from recon.data.load import read_views
from recon.result.model import read_own_calibration
from recon.result.scene import Scene
from rig.view.pictures.look import LUMINANCE

MOST_VIEWS = 4
MOST_PIXELS = 400_000
WITHIN = 0.5
"""Range around a brightness, stops, of the pixels that count for it."""
FEWEST = 100
"""Fewest pixels for a residual."""
SHARE = 0.68
"""Share of the pixels within the stated residual: one standard deviation, of normal errors."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of pixels of held-out photographs, [N]: log2 of the luminance of the render, and stops that
    it is above that of the photographs, noise included. views: number of brackets.
    """

    brightness: Array32
    off: Array32
    views: int

    def at(self, luminance: float) -> float | None:
        """Residual in stops of pixels as bright as this: most are within it; None with too few pixels."""
        if luminance <= 0:
            return None
        near = np.abs(self.off[np.abs(self.brightness - np.log2(luminance)) <= WITHIN])
        return float(np.quantile(near, SHARE)) if len(near) >= FEWEST else None


def residuals_of(scene: Scene) -> Residuals | None:
    """Residuals of some of the held-out views; None without held-out views or their photographs.

    None also for scenes of bands, and of display values.
    """
    record, session = scene.record, session_of(scene.folder)
    held_out = [view for view in scene.views if view.use == "test"]
    held_out = held_out[:: -(-len(held_out) // MOST_VIEWS) or 1]
    if session is None or not held_out or record.bands or record.display is not None:
        return None
    try:
        opened = Session.open(session)
        shots = {shot.file: shot for shot in opened.shots("scene")}
        groups = {view.id: [shots[shot.file] for shot in view.shots] for view in held_out}
        calibration, width = read_own_calibration(scene.folder), record.settings.max_width
        sha256 = record.calibration_sha256
        dataset = read_views(
            opened,
            calibration,
            sha256,
            groups,
            set(groups),
            record.world,
            max_width=width,
            progress=unreported,
        )
        pairs = []
        for view in dataset.views:
            light, trusted = radiance_image(view)
            ours, theirs = scene.render(view.name) @ LUMINANCE, light @ LUMINANCE
            known = trusted & view.valid & (ours > 0) & (theirs > 0)
            pairs.append((np.log2(ours[known]), np.log2(theirs[known])))
    except (RigError, KeyError):
        return None
    ours, theirs = (np.concatenate(side) for side in zip(*pairs, strict=True))
    step = -(-len(ours) // MOST_PIXELS) or 1
    return Residuals(ours[::step], (ours - theirs)[::step], len(dataset.views))
