"""How far a scene is off what photographs hold that it was not trained on, by how bright it is there."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

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
"""Stops around a brightness: pixels as bright as that tell of it."""
FEWEST = 100
"""Pixels that tell anything."""
SHARE = 0.68
"""Of the pixels that are off by no more than what is told: one standard deviation, of normal errors."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of pixels of held-out photographs, [N]: log2 of the luminance of the render, and stops that it is above
    what the photographs hold, whose noise is in it. views: how many photographs' brackets these are."""

    brightness: npt.NDArray[np.float32]
    off: npt.NDArray[np.float32]
    views: int

    def at(self, luminance: float) -> float | None:
        """Stops that most pixels as bright as this are off by at most; None: too few are that bright."""
        if luminance <= 0:
            return None
        near = np.abs(self.off[np.abs(self.brightness - np.log2(luminance)) <= WITHIN])
        return float(np.quantile(near, SHARE)) if len(near) >= FEWEST else None


def residuals_of(scene: Scene) -> Residuals | None:
    """Of some of the held-out views; None where there is none, or its photographs are not there.

    None, too, of scenes that are no light of three channels: of bands, and of display values.
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
            known = trusted & view.seen & (ours > 0) & (theirs > 0)
            pairs.append((np.log2(ours[known]), np.log2(theirs[known])))
    except (RigError, KeyError):
        return None
    ours, theirs = (np.concatenate(side) for side in zip(*pairs, strict=True))
    step = -(-len(ours) // MOST_PIXELS) or 1
    return Residuals(ours[::step], (ours - theirs)[::step], len(dataset.views))
