"""A frame of `transforms.json`: its lens, its pose and its exposure.

Keys are those of nerfstudio, of Instant NGP, which has some more, and of Blender scenes. A key that changes
what a pixel means is read here, or `transforms_notes.py` refuses it or says that it is left out.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from capture.imports.layouts.given import OPENCV_FROM_OPENGL, lens_of, pose_seen
from capture.imports.layouts.nearest_lens import nearest_lens
from capture.pictures.read import read_picture
from imaging.arrays import Array
from imaging.errors import InputError
from imaging.files.nerfstudio import DISTORTION, FISHEYE, stated_centre, stated_focal, stated_terms
from imaging.optics.exposure import Exposure
from imaging.optics.lens import Lens, distort
from imaging.optics.pose import Pose

KNOWN_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
"""Camera models whose distortion is that of k1, k2, p1 and p2, or none."""
OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic")
"""Keys of Instant NGP that say that a picture was taken by another lens than those above."""
_OPENCV_FROM_MITSUBA = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Camera axes x left, y up, z forward become x right, y down, z forward."""

_LONGEST = 100.0
"""Bound on the times of a picture's pixels, in those between the two poses of its camera."""
_NEAREST: dict[tuple[object, ...], Lens | None] = {}
"""Lenses that were sought already, since all frames of a file mostly have one."""


@dataclass(frozen=True)
class PosedFrame:
    """One element of `frames`, with the top of its file, and words to name it by."""

    values: dict[str, Any]
    top: dict[str, Any]
    where: str
    use: Literal["train", "test"] | None = None
    """Its use by `test_frames`, as ScanNet++ has them beside `frames`; None without them."""

    def number(self, key: str) -> float | None:
        """Number of the frame, else of the top; None if neither has it; InputError if it is not a number."""
        value = self.said(key)
        if key in DISTORTION and self.said("distortion_params") is not None:
            value = self._numbers("distortion_params", (len(DISTORTION),))[DISTORTION.index(key)]
        return None if value is None else self._finite(value, key)

    def said(self, key: str) -> Any:
        """Value of a key in the frame, else at the top of the file; None without it."""
        return self.values.get(key, self.top.get(key))

    def _finite(self, value: Any, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise InputError(f"{self.where} has a {key} that is not a finite number: correct it.")
        return float(value)

    def _numbers(self, key: str, counts: tuple[int, ...]) -> list[float]:
        """A list of finite numbers, empty without the key; InputError for anything else."""
        listed = self.said(key)
        if listed is None:
            return []
        if not isinstance(listed, list) or len(listed) not in counts:
            wanted = " or ".join(map(str, counts))
            raise InputError(f"{self.where} has a {key} that is not a list of {wanted} numbers: correct it.")
        return [self._finite(value, key) for value in listed]

    @property
    def file_path(self) -> str:
        """The `file_path`; InputError if it is empty."""
        path = self.values.get("file_path")
        if not isinstance(path, str) or not path:
            raise InputError(f"{self.where} has no file_path: correct it or take the frame out.")
        return path

    def cam_from_world(self) -> Pose:
        """Pose of the middle of the picture; InputError if it is no rigid motion.

        That of `transform_matrix`. Of a camera that moved while its picture was read, as Instant NGP has it
        (`transform_matrix_start`, `transform_matrix_end`, `rolling_shutter`), that of the middle pixel.
        """
        start, end = self._ends()
        if end is None:
            return pose_seen(start, self.where)
        return pose_seen(_between(start, end, self._times()[1]), self.where)

    def moved(self) -> tuple[float, float]:
        """Largest distance of a pixel's pose from that of the middle, in units of the poses and degrees."""
        start, end = self._ends()
        if end is None:
            return 0.0, 0.0
        first, middle, last = self._times()
        share = max(last - middle, middle - first)
        turn = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).magnitude()
        return share * float(np.linalg.norm(end[:3, 3] - start[:3, 3])), share * math.degrees(turn)

    def rolls(self) -> bool:
        """Return whether rows were read one after another."""
        return any(self._shutter()[1:3])

    def _shutter(self) -> list[float]:
        """A, B, C and D of `rolling_shutter`: a pixel is seen at the time A + B u + C v + D m.

        u and v are 0 to 1 across and down the picture, m is 0 to 1 while the shutter is open; at the time 0
        the camera is at its start, at 1 at its end.
        """
        listed = self._numbers("rolling_shutter", (3, 4))
        if any(abs(value) > _LONGEST for value in listed):
            raise InputError(f"{self.where} has an invalid rolling_shutter: correct or remove it.")
        return [*listed, 0.0, 0.0, 0.0, 0.0][:4]

    def _times(self) -> tuple[float, float, float]:
        """Time of the first, the middle and the last pixel that is seen."""
        at, *rates = self._shutter()
        middle, half = at + sum(rates) / 2, sum(map(abs, rates)) / 2
        return middle - half, middle, middle + half

    def _ends(self) -> tuple[Array, Array | None]:
        """The camera's place [4, 4] in the world, OpenCV's axes, at the time 0, and at 1 where it moved."""
        moving = self.values.get("transform_matrix_start") is not None
        start = self._pose("transform_matrix_start" if moving else "transform_matrix")
        if self.values.get("transform_matrix_end") is None:
            return start, None
        return start, self._pose("transform_matrix_end")

    def _pose(self, key: str) -> Array:
        try:
            matrix = np.array(self.values.get(key), np.float64)
        except (ValueError, TypeError, OverflowError):
            matrix = np.zeros(0)
        if matrix.shape == (3, 4):
            matrix = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
        if matrix.shape != (4, 4):
            raise InputError(f"{self.where} has no {key} of 4x4 numbers: correct it.")
        mitsuba = self.top.get("from_mitsuba", "normal_mts_args" in self.top)
        world_from_cam: Array = matrix @ (_OPENCV_FROM_MITSUBA if mitsuba else OPENCV_FROM_OPENGL)
        pose_seen(world_from_cam, self.where)
        return world_from_cam

    def _camera_model(self) -> Any:
        """`camera_model`, or what `is_fisheye` says in its place, as Instant NGP writes it."""
        model, fisheye = self.said("camera_model"), self.said("is_fisheye")
        if fisheye not in (None, True, False) or (fisheye and model not in (None, FISHEYE)):
            raise InputError(
                f"{self.where} has is_fisheye {fisheye!r:.40} and camera_model {model!r:.40}: take one out."
            )
        return FISHEYE if fisheye else "OPENCV" if model is None else model

    def lens(self, photo: Path) -> Lens | None:
        """Lens of the frame; None if rig has no such model. `photo` gives the size if no key does."""
        model = self._camera_model()
        fisheye = model == FISHEYE
        other = any(self.said(key) is not None and self.said(key) is not False for key in OTHER_LENSES)
        if other or (not fisheye and model not in KNOWN_MODELS):
            return None
        terms, others = stated_terms(self.number, fisheye=fisheye)
        if others and (fisheye or not set(others) <= {"k3", "k4"}):
            return None
        width, height = self.number("w"), self.number("h")
        if width is None or height is None:
            picture = read_picture(photo)
            width, height = picture.width, picture.height
        if not (0 < width < 1e6 and 0 < height < 1e6):
            raise InputError(f"{self.where} has a size of {width:g}x{height:g} pixels: correct w and h.")
        levels = [PosedFrame(level, {}, self.where).number for level in (self.values, self.top)]
        focal = stated_focal(levels, width, height, self.where, fisheye=fisheye)
        if focal is None:
            keys = "fl_x" if fisheye else "fl_x or camera_angle_x"
            raise InputError(f"{self.where} has no focal length: write {keys}.")
        (fx, fy), (cx, cy) = focal, stated_centre(self.number, width, height)
        if others:
            return self._nearest((int(width), int(height)), (fx, fy, cx, cy), terms)
        return lens_of(
            FISHEYE if fisheye else "OPENCV" if any(terms.values()) else "PINHOLE",
            (int(width), int(height)),
            {"fx": fx, "fy": fy, "cx": cx, "cy": cy, **terms},
            self.where,
        )

    def _nearest(
        self, size: tuple[int, int], centred: tuple[float, float, float, float], terms: dict[str, float]
    ) -> Lens | None:
        """The lens of `rig` nearest to one with the radial terms k3 and k4 as well."""
        k3, k4 = self.number("k3") or 0.0, self.number("k4") or 0.0
        focal, middle = np.array(centred[:2]), np.array(centred[2:])

        def image_of(tangents: Array) -> Array:
            square = (tangents**2).sum(-1, keepdims=True)
            bent = distort(tangents, list(terms.values()), fisheye=False)
            return np.asarray((bent + tangents * square**3 * (k3 + square * k4)) * focal + middle)

        key = (size, centred, *terms.values(), k3, k4)
        if key not in _NEAREST:
            _NEAREST[key] = nearest_lens(image_of, size, centred, self.where)[0]
        return _NEAREST[key]

    def exposure(self) -> Exposure | None:
        """Return what `exposure_time`, in seconds, says; no other key has an agreed meaning."""
        time = self.number("exposure_time")
        if time is not None and not 0 < time < 1e6:
            raise InputError(f"{self.where} has an exposure_time of {time:g} s: correct it.")
        return None if time is None else Exposure(time=time)


def _is_finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond floats
        return False


def _between(start: Array, end: Array, time: float) -> Array:
    """The motion [4, 4] that is `time` of the way from one to the other, the shortest turn taken."""
    motion = np.eye(4)
    turn = Rotation.from_matrix(start[:3, :3].T @ end[:3, :3]).as_rotvec()
    motion[:3, :3] = start[:3, :3] @ Rotation.from_rotvec(time * turn).as_matrix()
    motion[:3, 3] = start[:3, 3] + time * (end[:3, 3] - start[:3, 3])
    return motion
