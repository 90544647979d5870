"""A calibrated session as training sees it: views, each with its lens, its sensor and its shots."""

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from imaging.arrays import Array, Array32, Integers, Mask
from imaging.files.colmap import SparsePoints, read_points, read_tracks
from imaging.sensor.cfa import Cfa
from imaging.session.calibration import CalibrationRecord, Response, StatedPart
from imaging.session.records import Band, ImageKind, ShotRecord
from imaging.session.view_id import ViewId
from recon.data.measured_depth import DepthMapFile, scaled
from recon.data.shot import Shot, bytes_of
from recon.data.world import SAME, WorldTransform
from recon.splat import SplatCamera

COLMAP = "calibration/colmap"
MOST_VALIDATION = 4
"""Views at most that a training may be ended by: each is rendered again and again."""


ONE_SPOT = 1e-3
"""Reach of cameras, over the depth of what they look at, that moves it by no more than about a pixel."""
MOST_TRACKED = 20_000
"""Maximum number of scene points whose observations in all views are kept in memory; the checks that use them
need far fewer.
"""


@dataclass(frozen=True)
class Sensor:
    """Response of a camera to radiance, before any shot's exposure.

    kind: raw (mosaic or camera RGB, linear), ldr (code values), hdr (linear Rec.709).
    camera_from_rec709: float64 [channels, 3]. falloff: float32 [H, W], vignetting times the camera's gain.
    white_balance: factors on red, green and blue light that a photograph was developed with. glare: share of
    the light that the lens scatters.
    """

    kind: ImageKind
    cfa: Cfa | None
    camera_from_rec709: Array
    falloff: Array32
    response: Response
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    glare: float = 0.0


@dataclass(frozen=True, eq=False)
class View:
    """One camera at one frame: its bracket, of each band, and where it stood, in scene coordinates
    (`recon.data.world`)."""

    camera: str
    frame: int
    lens: SplatCamera
    sensor: Sensor
    shots: tuple[Shot, ...]
    channels: int = 3
    """Channels of the scene's light: Rec.709's, or the bands of the session."""
    depth: DepthMapFile | None = None
    """Measured depth of the view."""
    orientation: int = 1
    """Orientation that EXIF states of its first file, 1 to 8; pixels are as stored."""

    @property
    def id(self) -> ViewId:
        """Identity of the view."""
        return ViewId(self.frame, self.camera)

    @property
    def name(self) -> str:
        """`frame/camera`."""
        return str(self.id)

    @property
    def held(self) -> bool:
        """True if its shots are in memory; otherwise each access reads a file."""
        return all(shot.planes.held for shot in self.shots)

    @property
    def transparent(self) -> bool:
        """True if its alpha is not all opaque."""
        return any(shot.planes.transparent for shot in self.shots)

    @property
    def valid(self) -> Mask:
        """Mask of the pixels with data in any of the shots, bool [H, W]: not behind a mask."""
        valid = self.shots[0].valid
        if not bytes_of(valid) and valid.flat[0]:  # all of it, as of most photographs
            return np.broadcast_to(np.bool_(True), valid.shape[:2])
        for shot in self.shots[1:]:
            valid = valid | shot.valid
        return np.asarray(valid if valid.ndim == 2 else valid.all(-1))

    @property
    def hidden(self) -> bool:
        """True if masks hide all of it, so that nothing can be measured by it."""
        return not self.valid.any()

    @property
    def alpha(self) -> Array32 | None:
        """Share of each pixel's light that comes from the scene, 0..1, float32 [H, W]; None: all of it.

        The rest is empty background. It is the mean alpha of the view's photographs.
        """
        alphas = [alpha for alpha in (shot.alpha for shot in self.shots) if alpha is not None]
        if len(alphas) < 2:
            return alphas[0] if alphas else None
        return np.asarray(np.mean(alphas, axis=0, dtype=np.float32))

    @cached_property
    def centre(self) -> Array:
        """The camera's centre in the scene, float64 [3]."""
        motion = self.lens.cam_from_world
        return np.asarray(-motion[:3, :3].T @ motion[:3, 3])


@dataclass(frozen=True, eq=False)
class Dataset:
    """All that training may look at: the training views; and the held-out ones, which nothing is fitted to.

    kind: of all cameras; mixed: they differ. A training that held-out views may end looks at some of them,
    its validation views; what an evaluation reports is of the others, its test views.
    """

    session: Path
    kind: ImageKind | Literal["mixed"]
    train: tuple[View, ...]
    held_out: tuple[View, ...]
    calibration: CalibrationRecord
    calibration_sha256: str
    """Hash of calibration.json, and of split.json if it exists."""
    watched: frozenset[str] = frozenset()
    """Names of the validation views."""
    world: WorldTransform = SAME
    """Transform from the scene, with its views, to the world of the calibration."""
    bands: tuple[Band, ...] = ()
    """Channels of the scene's light, by wavelength; empty: those of Rec.709."""
    depth_scale: float | None = 1.0
    """Factor of its depth maps, as they were loaded; None: they are left out."""
    overruled: tuple[StatedPart, ...] = ()
    """Parts of the photographs' light in which scene points overrule what the files state as constant."""
    records: tuple[ShotRecord, ...] = ()
    """Records of the shots that were read, those of views or exposures that are not in use too."""

    @property
    def validation(self) -> tuple[View, ...]:
        """The held-out views that may end the training; none unless it is to be ended by any."""
        return tuple(view for view in self.held_out if view.name in self.watched)

    @property
    def test(self) -> tuple[View, ...]:
        """The held-out views that nothing was chosen by; none where the only one is for validation."""
        return tuple(view for view in self.held_out if view.name not in self.watched)

    @property
    def reported(self) -> tuple[View, ...]:
        """The held-out views that an evaluation is of: the test views, else those for validation."""
        return self.test or self.validation

    def with_validation(self) -> "Dataset":
        """The same for a training that is ended by how good held-out views are.

        Half of the held-out views that masks do not hide, evenly spread, at least one and at most four, are
        for that alone.
        """
        shown = [view for view in self.held_out if not view.hidden]
        count = max(1, min(MOST_VALIDATION, len(shown) // 2))
        places = {(2 * turn + 1) * len(shown) // (2 * count) for turn in range(count)}
        watched = [view for place, view in enumerate(shown) if place in places]
        if watched == shown:  # hidden views alone would leave nothing to report
            watched = list(self.held_out) if shown else []
        return replace(self, watched=frozenset(view.name for view in watched))

    @property
    def views(self) -> tuple[View, ...]:
        """Every view, in order of frame and camera."""
        return tuple(sorted(self.train + self.held_out, key=lambda view: view.id))

    @property
    def photographs_sha256(self) -> str:
        """Hash of the shots of all views, with their masks, as they were read."""
        return photographs_sha256(self._shots())

    @property
    def depths_sha256(self) -> str:
        """Hash of the depth maps of all views and of their units, in use or not; empty without any."""
        lines = [f"{shot.file} {shot.depth_sha256} {shot.depth_unit}" for shot in self._shots() if shot.depth]
        return _sha256(lines) if lines else ""

    def _shots(self) -> Iterable[ShotRecord]:
        """Records of the shots of all views."""
        files = {shot.file for view in self.views for shot in view.shots}
        return (shot for shot in self.records if shot.file in files)

    def with_depths(self, scale: float | None) -> "Dataset":
        """Multiply the depth maps of all views by a scale; None drops them."""
        train, held_out = (
            tuple(scaled(view, scale) for view in views) for views in (self.train, self.held_out)
        )
        return replace(self, train=train, held_out=held_out, depth_scale=scale)

    def points(self) -> SparsePoints:
        """The points of the calibration, in the scene; InputError if they cannot be read."""
        points = read_points(self.session / COLMAP)
        return replace(points, xyz=self.world.from_world(points.xyz))

    def tracks(self, most: int | None = None) -> tuple[Array, dict[str, Integers]]:
        """Points [P, 3], and which of them the image of each name saw, as `read_tracks` has them.

        most: of the points, those that most images saw; None: all.
        """
        xyz, tracks = read_tracks(self.session / COLMAP)
        if most is not None and len(xyz) > most:
            times = np.zeros(len(xyz), np.int64)
            for points_of in tracks.values():
                times[points_of] += 1
            chosen = np.sort(np.argsort(-times, kind="stable")[:most])
            place = np.full(len(xyz), -1)
            place[chosen] = np.arange(most)
            tracks = {name: (numbers := place[points_of])[numbers >= 0] for name, points_of in tracks.items()}
            xyz = xyz[chosen]
        return self.world.from_world(xyz), tracks

    def trained_at(self, k: float) -> bool:
        """Return whether an exposure scale is one that training saw, to a sixth of a stop."""
        return any(abs(math.log2(k / shot.k)) < 1 / 6 for view in self.train for shot in view.shots)

    @cached_property
    def extent(self) -> float:
        """1.1 times the largest distance of a training camera from their mean (3DGS); 1, the depth of what
        they look at, of a single view or views at one spot, whose Gaussians have to move, too.
        """
        centres = np.array([view.centre for view in self.train])
        reach = float(1.1 * np.linalg.norm(centres - centres.mean(0), axis=1).max())
        return reach if reach > ONE_SPOT else 1.0


def photographs_sha256(shots: Iterable[ShotRecord]) -> str:
    """Hash of the names and hashes of shots and their masks, in order of name."""
    return _sha256(f"{shot.file} {shot.sha256} {shot.mask_sha256}" for shot in shots)


def _sha256(lines: Iterable[str]) -> str:
    return hashlib.sha256("".join(f"{line}\n" for line in sorted(lines)).encode()).hexdigest()
