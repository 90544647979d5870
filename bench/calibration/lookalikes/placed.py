"""Calibrations that stop where views have their poses, for benches that compare rules of placing."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from calib import place_views
from calib.calibrate import calibrate
from calib.poses import first_model, resolution
from calib.poses.checks.contradictions import placed_views
from calib.poses.sfm import SceneModel
from imaging.errors import CalibrationError, PartialError
from imaging.session.calibration import POSE_HANGING, POSE_LOOSE
from imaging.session.view_id import ViewId

FURTHER = tuple(place_views.FURTHER.values())
"""Rungs of further features."""
Poses = dict[ViewId, Any]


@dataclass
class PlacedViews:
    """The poses that a calibration would write.

    Attributes:
        before: cam_from_world [4, 4] of the views of the first model of structure from motion.
        model: What the calibration goes on with; None where it is refused.
        refused: Why.
    """

    before: Poses | None = None
    model: SceneModel | None = None
    refused: str = ""

    @property
    def poses(self) -> Poses:
        """cam_from_world [4, 4] of the registered views."""
        return {} if self.model is None else {view: pose.matrix() for view, pose in self.model.poses.items()}

    def taken(self, *names: str) -> list[str]:
        """Those of these rungs that were taken."""
        rungs = () if self.model is None else self.model.rungs
        taken = {rung.name for rung in rungs if rung.taken}
        return [name for name in names if name in taken]

    @property
    def doubts(self) -> list[str]:
        """Rungs that make the poses doubtful."""
        return self.taken(*resolution.DOUBTS, POSE_HANGING, POSE_LOOSE)


class _Placed(Exception):
    """The views of a session have their poses."""


def place(session: Path, without: ExitStack | None = None) -> PlacedViews:
    """Calibrate a session up to its poses; features and matches stay in it for another run.

    Args:
        session: Its folder.
        without: Patches that leave a rule out, closed when the views are placed.
    """
    result = PlacedViews()
    with without or ExitStack() as stack:
        # Of that module, where a patch may stand in its place.
        resolve = getattr(first_model, "resolve_contradictions")  # noqa: B009

        def resolved(reconstruction: Any, *rest: Any, **more: Any) -> Any:
            if result.before is None:
                result.before = {view: pose for view, (_, pose) in placed_views(reconstruction).items()}
            return resolve(reconstruction, *rest, **more)

        def located(_: Any, __: Any, model: SceneModel, *___: Any) -> Any:
            result.model = model
            raise _Placed

        stack.enter_context(patch.object(first_model, "resolve_contradictions", resolved))
        stack.enter_context(patch.object(place_views, "located", located))
        try:
            calibrate(session)
        except _Placed:
            pass
        except (CalibrationError, PartialError) as error:
            result.refused = str(error)
    return result
