"""The camera as the rasteriser sees it: a pose and a lens."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from imaging.arrays import Array
from imaging.errors import InputError, ReconstructionError
from imaging.optics import lens as optics
from imaging.optics.lens import BROWN_TERMS, FISHEYE_TERMS, Lens
from imaging.optics.pose import Pose, world_from_opengl


@dataclass(frozen=True, eq=False)
class SplatCamera:
    """A view: world to camera motion, and a pinhole with Brown-Conrady distortion (OpenCV, COLMAP `OPENCV`).

    cam_from_world: float64 [4, 4], x right, y down, z forward. fx, fy, cx, cy in pixels, pixel centres
    at +0.5. k1, k2 radial, p1, p2 tangential. width, height in pixels.
    fisheye: k1 to k4 are the terms of an equidistant lens instead (COLMAP `OPENCV_FISHEYE`), p1, p2 unused.
    """

    cam_from_world: Array
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    fisheye: bool = False

    def __post_init__(self) -> None:
        """InputError for values that are not finite, and for no pixels or focal length."""
        for name in ("cam_from_world", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"SplatCamera.{name} is not finite")
        for name in ("fx", "fy", "width", "height"):
            if getattr(self, name) <= 0:
                raise InputError(f"SplatCamera.{name} must be positive, not {getattr(self, name)}")

    @classmethod
    def of(cls, lens: Lens, cam_from_world: Pose) -> "SplatCamera":
        """The camera of a calibrated lens at a pose.

        ReconstructionError for a fisheye whose image reaches farther from the axis than tangents do.
        """
        widest = math.degrees(optics.widest_angle(lens)) if lens.fisheye else 0.0
        if widest > math.degrees(optics.WIDEST):
            problem = f"sees {widest:.0f} degrees from its axis" if widest < math.inf else "folds over"
            raise ReconstructionError(
                f"A fisheye {problem} in the corners of its {lens.width}x{lens.height} image, and rig draws "
                f"at most {math.degrees(optics.WIDEST):.0f}: crop the photographs and calibrate them again."
            )
        return cls(
            cam_from_world.matrix(),
            fx=lens.fx,
            fy=lens.fy,
            cx=lens.cx,
            cy=lens.cy,
            width=lens.width,
            height=lens.height,
            k1=lens.k1,
            k2=lens.k2,
            p1=lens.p1,
            p2=lens.p2,
            k3=lens.k3,
            k4=lens.k4,
            fisheye=lens.fisheye,
        )

    @property
    def lens(self) -> tuple[float, ...]:
        """`fx fy cx cy k1 k2 p1 p2`, or of a fisheye `fx fy cx cy k1 k2 k3 k4`."""
        return tuple(getattr(self, name) for name in self._names)

    @property
    def K(self) -> Array:
        """Focal lengths and principal point, float64 [3, 3], px; pixel centres at +0.5."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @property
    def world_from_cam(self) -> Array:
        """Camera to world, float64 [4, 4], camera axes as those of `cam_from_world`."""
        return np.asarray(np.linalg.inv(self.cam_from_world))

    @property
    def world_from_opengl(self) -> Array:
        """Camera to world, float64 [4, 4], camera axes x right, y up, z back: nerfstudio's."""
        return world_from_opengl(self.cam_from_world)

    def with_lens(self, values: Sequence[float]) -> "SplatCamera":
        """The camera with other numbers of its `lens`."""
        changed: dict[str, Any] = dict(zip(self._names, values, strict=True))
        return replace(self, **changed)

    def resized(self, width: int) -> "SplatCamera":
        """The camera with a picture of another width, px, and the same shape to the nearest row."""
        height = max(1, round(self.height * width / self.width))
        across, down = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * across,
            cx=self.cx * across,
            fy=self.fy * down,
            cy=self.cy * down,
        )

    @property
    def _names(self) -> tuple[str, ...]:
        return FISHEYE_TERMS if self.fisheye else BROWN_TERMS

    @cached_property
    def monotone_radius2(self) -> float:
        """Square of the undistorted radius x/z where the radial distortion stops growing; inf if nowhere.

        Beyond it the polynomial folds the world back into the image (`imaging.optics.lens.fold`), so
        Gaussians there are not drawn. Of a fisheye never inf: tangents end at a right angle from the axis.
        """
        return optics.fold(self.lens[4:], fisheye=self.fisheye) ** 2

    def distort(self, points: Array) -> Array:
        """Undistorted tangents (x/z, y/z) [..., 2] to distorted ones [..., 2]."""
        return optics.distort(points, self.lens[4:], fisheye=self.fisheye)

    def tangent_bounds(self, margin: float) -> tuple[float, float, float, float]:
        """(u_min, u_max, v_min, v_max) of the undistorted field of view, widened by `margin` half widths.

        Infinite of a fisheye: its Jacobian is of the size of f / distance everywhere, and needs no clamp.
        """
        if self.fisheye:
            return -math.inf, math.inf, -math.inf, math.inf
        u_min, v_min, u_max, v_max = _field_of_view(self.width, self.height, self.lens)
        wide, tall = 0.5 * margin * (u_max - u_min), 0.5 * margin * (v_max - v_min)
        return u_min - wide, u_max + wide, v_min - tall, v_max + tall


@lru_cache(maxsize=1024)
def _field_of_view(width: int, height: int, lens: tuple[float, ...]) -> tuple[float, float, float, float]:
    """Least, then largest undistorted tangents (u, v) on the border of the image, of no fisheye.

    Kept by lens: a camera whose pose is refined is another one at every step, with the same field of view.
    """
    ends = np.linspace(0.0, 1.0, 17)
    near, far = np.zeros(17), np.ones(17)
    border = np.concatenate([(ends, near), (ends, far), (near, ends), (far, ends)], axis=1).T
    bent = (border * [width, height] - lens[2:4]) / lens[:2]
    tangents = optics.undistort(bent, lens[4:], fisheye=False)
    low, high = tangents.min(axis=0), tangents.max(axis=0)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])
