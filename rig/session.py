"""A session in Python: the one on the disk, its views in memory, and what a notebook shows of it."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from imaging.arguments import checked
from imaging.arrays import Array, Array32
from imaging.choices import Space
from imaging.errors import InputError, RigError
from imaging.notebook import gallery
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose, world_from_opengl
from imaging.session import session as sessions
from imaging.session.calibration import CalibrationRecord
from imaging.session.records import ShotRecord
from imaging.session.session import brackets
from imaging.session.view_id import ViewId

SHEET_MOST = 12
"""Pictures on the contact sheet of a notebook, evenly chosen."""
SHEET_SECONDS = 4.0
"""RAW files of many megapixels take a second each; the sheet ends with the first beyond this."""


class Session(sessions.Session):
    """A session on disk: `Session.open("S")`. It can be given where a path to its folder can.

    It holds no state but its identity: every read sees what is there now.
    """

    @property
    def views(self) -> tuple["SessionView", ...]:
        """Its views, in order of frame and camera, with the calibration that it has now.

        InputError if that is damaged, or older than the shots.
        """
        calibration = self.calibration
        shots = brackets(self.shots("scene"))
        return tuple(SessionView(self, view, tuple(bracket), calibration) for view, bracket in shots.items())

    @property
    def calibration(self) -> CalibrationRecord | None:
        """Calibration, None without one; InputError if it is damaged, or older than the shots."""
        from calib.exports.merge_session import current_calibration

        return current_calibration(self.folder)

    @property
    def exposure(self) -> float:
        """Factor on the light of views that shows the session as middle grey, as in plates and renders."""
        from imaging.plates.middle_grey import exposure_factor

        return exposure_factor(self, self.calibration)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what the session holds, and a shot of some of its views."""
        from capture.pictures.read import examine

        views = list(brackets(self.shots("scene")).items())
        chosen = views[:: -(-len(views) // SHEET_MOST) or 1]
        pictures, began = [], time.monotonic()
        for view, shots in chosen:
            shot = shots[len(shots) // 2]
            try:
                thumbnail = examine(self.file(shot)).thumbnail
            except (RigError, OSError):
                continue  # `rig check` names what cannot be read
            exposure = shot.reported or shot.requested
            pictures.append((f"{view}, {exposure}" if exposure else str(view), thumbnail))
            if time.monotonic() - began > SHEET_SECONDS:
                break
        return gallery(self.summary(), pictures)


@dataclass(frozen=True, eq=False)
class SessionView:
    """A camera at a frame: its bracket, where it stood, and the light that it measured.

    shots: of its bracket. calibration: that of the session; None: exposures are those of labels.
    """

    session: sessions.Session = field(repr=False)
    id: ViewId
    shots: Sequence[ShotRecord] = field(repr=False)
    calibration: CalibrationRecord | None = field(repr=False)

    @property
    def name(self) -> str:
        """`frame/camera`, as scenes have it."""
        return str(self.id)

    @property
    def lens(self) -> Lens:
        """Lens of the pictures, with its distortion; InputError where it is not calibrated."""
        lens = None if self.calibration is None else self.calibration.camera(self.id.camera).lens
        if lens is None:
            raise self._without("lens")
        return lens

    @property
    def K(self) -> Array:
        """Focal lengths and principal point, float64 [3, 3], px, pixel centres at +0.5. Errors as `lens`."""
        return self.lens.matrix

    @property
    def pose(self) -> Pose:
        """Pose in the world of the calibration; InputError where it has none."""
        for view in () if self.calibration is None else self.calibration.views:
            if view.id == self.id:
                return view.cam_from_world
        raise self._without("pose")

    @property
    def cam_from_world(self) -> Array:
        """World to camera, float64 [4, 4], x right, y down, z ahead; InputError as `pose`."""
        return self.pose.matrix()

    @property
    def world_from_cam(self) -> Array:
        """Camera to world, float64 [4, 4], the same axes; InputError as `pose`."""
        return np.asarray(np.linalg.inv(self.cam_from_world))

    @property
    def world_from_opengl(self) -> Array:
        """Camera to world, float64 [4, 4], camera axes x right, y up, z back; InputError as `pose`."""
        return world_from_opengl(self.cam_from_world)

    @checked
    def light(self, space: Space = "rec709") -> tuple[Array32, Array32 | None, npt.NDArray[np.intp]]:
        """Merge the bracket: its light, the standard deviation of that, and a mask.

        Args:
            space: Primaries.

        Returns:
            Linear light, float32 [H, W, 3], in the one unit of the session, which `Scene.render` has too, NaN
            where there is no number; of a camera behind several filters a channel each, in order of the
            shots. Its standard deviation of the same shape, infinite where a bound has a say; None if it is
            not known. Bits of `imaging.merge.picture.BITS`, int [H, W], 0 where all is measured.

        Raises:
            InputError: A file is missing or damaged, exposures are unknown, or the colour of the camera is in
                another space than Rec.709.
        """
        from calib.exports.merge_session import of_one_band
        from imaging.plates.merged_view import view_light

        parts = [
            view_light(self.session, self.id, shots, self.calibration, space).picture
            for shots in of_one_band(self.shots).values()
        ]
        if len(parts) == 1:
            return parts[0].light, parts[0].sigma, parts[0].mask
        light, mask = (np.stack([part.light[..., 0] for part in parts], -1), parts[0].mask)
        for part in parts[1:]:
            mask = mask | part.mask
        sigmas = [part.sigma[..., 0] for part in parts if part.sigma is not None]
        return light, np.stack(sigmas, -1) if len(sigmas) == len(parts) else None, mask

    def _without(self, what: str) -> InputError:
        return InputError(f"{self.name} of {self.session.folder} has no {what}: run `rig calibrate` first.")
