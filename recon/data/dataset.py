"""A calibrated session as training sees it: views, each with its lens, its sensor and its shots."""

import hashlib
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from imaging.cfa import Cfa
from imaging.colour import of_channels
from imaging.errors import ReconstructionError
from imaging.files import store
from imaging.files.colmap import SparsePoints, read_points, read_tracks
from imaging.lens import Lens
from imaging.progress import Progress, unreported
from imaging.session.bands import in_order
from imaging.session.calibration import CalibrationRecord, Response, ViewCalibration, read_calibration
from imaging.session.falloff import falloff
from imaging.session.records import Band, CameraRecord, ImageKind, ShotRecord
from imaging.session.session import SPLIT, Session, brackets
from imaging.session.view_id import ViewId
from recon.data.holdout import held_out, tested_views, used_shots
from recon.data.pixels import Shot, read_shot
from recon.data.world import SAME, WorldTransform
from recon.splat import SplatCamera

Float = npt.NDArray[np.float32]

COLMAP = "calibration/colmap"
MOST_VALIDATION = 4
"""Views at most that a training may be ended by: each is rendered again and again."""


@dataclass(frozen=True)
class Sensor:
    """What a camera does to radiance, before any shot's exposure.

    kind: raw (mosaic or camera RGB, linear), ldr (code values), hdr (linear Rec.709).
    camera_from_rec709: float64 [channels, 3]. falloff: float32 [H, W], vignetting times the camera's gain.
    white_balance: factors on red, green and blue light that a photograph was developed with. glare: share of
    the light that the lens scatters.
    """

    kind: ImageKind
    cfa: Cfa | None
    camera_from_rec709: npt.NDArray[np.float64]
    falloff: Float
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
    """Of the scene's light: Rec.709's, or the bands of the session."""

    @property
    def id(self) -> ViewId:
        """Which view it is."""
        return ViewId(self.frame, self.camera)

    @property
    def name(self) -> str:
        """`frame/camera`."""
        return str(self.id)

    @cached_property
    def seen(self) -> npt.NDArray[np.bool_]:
        """Where any of the shots tells anything, bool [H, W]: not behind a mask."""
        valid = np.logical_or.reduce([shot.valid for shot in self.shots])
        return np.asarray(valid if valid.ndim == 2 else valid.all(-1))

    @cached_property
    def alpha(self) -> Float | None:
        """How much of each pixel's light comes from the scene, 0..1, float32 [H, W]; None: all of it.

        Elsewhere is nothing: what alpha says of the photographs of the view, on the average.
        """
        told = [shot.alpha for shot in self.shots if shot.alpha is not None]
        if len(told) < 2:
            return told[0] if told else None
        return np.asarray(np.mean(told, axis=0, dtype=np.float32))

    @cached_property
    def centre(self) -> npt.NDArray[np.float64]:
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
    """Of calibration.json, and of split.json where there is one."""
    watched: frozenset[str] = frozenset()
    """Names of the validation views."""
    world: WorldTransform = SAME
    """Where the scene, with its views, lies in the world of the calibration."""
    bands: tuple[Band, ...] = ()
    """The channels of the scene's light, by wavelength; none: those of Rec.709."""

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

        Half of the held-out views, evenly spread, at least one and at most four, are for that alone.
        """
        count = max(1, min(MOST_VALIDATION, len(self.held_out) // 2))
        places = {(2 * turn + 1) * len(self.held_out) // (2 * count) for turn in range(count)}
        watched = (view.name for place, view in enumerate(self.held_out) if place in places)
        return replace(self, watched=frozenset(watched))

    @property
    def views(self) -> tuple[View, ...]:
        """Every view, in order of frame and camera."""
        return tuple(sorted(self.train + self.held_out, key=lambda view: view.id))

    def points(self) -> SparsePoints:
        """The points of the calibration, in the scene; InputError if they cannot be read."""
        points = read_points(self.session / COLMAP)
        return replace(points, xyz=self.world.from_world(points.xyz))

    def tracks(self) -> tuple[npt.NDArray[np.float64], dict[str, npt.NDArray[np.int64]]]:
        """The same points [P, 3], and which of them the image of each name saw, as `read_tracks` has them."""
        xyz, tracks = read_tracks(self.session / COLMAP)
        return self.world.from_world(xyz), tracks

    def trained_at(self, k: float) -> bool:
        """Whether an exposure scale is one that training saw, to a sixth of a stop."""
        return any(abs(math.log2(k / shot.k)) < 1 / 6 for view in self.train for shot in view.shots)

    @cached_property
    def extent(self) -> float:
        """1.1 times the largest distance of a training camera from their mean (3DGS); at least tiny."""
        centres = np.array([view.centre for view in self.train])
        return float(max(1.1 * np.linalg.norm(centres - centres.mean(0), axis=1).max(), 1e-6))


Examine = Callable[[Sequence[View], Mapping[str, tuple[int, int]]], None]
"""Given the first view of each camera, and how many views each has in all and to train on."""


def load(
    session: Path,
    *,
    max_width: int | None = None,
    progress: Progress = unreported,
    examine: Examine | None = None,
) -> Dataset:
    """Read every view that its own picture placed; images wider than `max_width` are scaled down.

    A session whose data set says what it tests on (split.json) holds out just that.
    Photographs and EXR are averaged over areas in linear light; mosaics of at least twice the width
    are demosaicked and averaged, narrower ones are kept as they are. examine: called when a view of each
    camera is read, before the others are; it may refuse. ReconstructionError when no
    view is registered; InputError for missing or damaged files.
    """
    opened = Session.open(session)
    calibration = read_calibration(session)
    split = opened.split()
    # What was not recognised is black, blurred or bare; such a picture would be taken at its word.
    placed = {view.id for view in calibration.views if not view.by_rig}
    shots = used_shots(opened, split)
    groups = {view: group for view, group in brackets(shots).items() if view in placed}
    if not groups:
        tried = len(calibration.unregistered)
        why = (
            f"`rig calibrate` found none for its {tried} images: take images that overlap by two thirds"
            if tried
            else "it was calibrated without: run `rig calibrate` in full, on two views or more of one scene"
        )
        raise ReconstructionError(f"{session} has no view with a pose, since {why}.")
    out = held_out(groups) if split is None else tested_views(session, groups, split)
    poses = {view.id: view.cam_from_world.matrix() for view in calibration.views}
    world = WorldTransform.of({view.image_name: poses[view] for view in groups}, session / COLMAP)
    return read_views(
        opened,
        calibration,
        calibration_sha256(session),
        groups,
        out,
        world,
        max_width=max_width,
        progress=progress,
        examine=examine,
    )


def calibration_sha256(session: Path) -> str:
    """Of calibration.json, and of split.json where there is one: what places and parts the views."""
    digest = hashlib.sha256((session / "calibration" / "calibration.json").read_bytes())
    if (session / SPLIT).exists():
        digest.update((session / SPLIT).read_bytes())
    return digest.hexdigest()


def read_views(
    session: Session,
    calibration: CalibrationRecord,
    calibration_sha256: str,
    groups: Mapping[ViewId, Sequence[ShotRecord]],
    out: Collection[ViewId],
    world: WorldTransform,
    *,
    max_width: int | None,
    progress: Progress,
    examine: Examine | None = None,
) -> Dataset:
    """The shots of each view as a data set, `out` of them held out; all have a pose.

    world: where the scene lies, whose views they are.
    """
    poses = {view.id: view for view in calibration.views}
    kinds = {session.camera(view.camera).kind for view in groups}
    views: list[View] = []
    falloffs: dict[tuple[str, int, int], Float] = {}
    first = {place.camera: place for place in sorted(groups, reverse=True)}
    order = [*first.values(), *sorted(set(groups) - set(first.values()))]
    for done, place in enumerate(order):
        progress("reading images", done, len(groups))
        view = _view(
            session,
            calibration,
            poses[place],
            session.camera(place.camera),
            groups[place],
            max_width,
            falloffs,
        )
        views.append(replace(view, lens=world.camera(view.lens)))
        if done + 1 == len(first) and examine is not None:
            examine(views, {camera: _counts(camera, groups, out) for camera in first})
    views.sort(key=lambda view: view.id)
    return Dataset(
        session=session.folder,
        kind=kinds.pop() if len(kinds) == 1 else "mixed",
        train=tuple(view for view in views if view.id not in out),
        held_out=tuple(view for view in views if view.id in out),
        calibration=calibration,
        calibration_sha256=calibration_sha256,
        world=world,
        bands=in_order(session.record.bands),
    )


def _counts(camera: str, groups: Collection[ViewId], out: Collection[ViewId]) -> tuple[int, int]:
    """Views of a camera, and those of them to train on."""
    own = [view for view in groups if view.camera == camera]
    return len(own), sum(view not in out for view in own)


def photographs_sha256(shots: Iterable[ShotRecord]) -> str:
    """Of the names and hashes of shots and their masks, in order of name."""
    lines = sorted(f"{shot.file} {shot.sha256} {shot.mask_sha256}\n" for shot in shots)
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def lens_of_pixels(lens: Lens, kind: ImageKind, width: int, height: int) -> Lens:
    """The lens of a file for what `read_shot` made of it, width x height pixels."""
    if kind == "raw":  # rows and columns that complete no tile, or no pair, are lost, which moves nothing
        whole = 2 * width > lens.width
        even = {"width": lens.width - lens.width % 2, "height": lens.height - lens.height % 2}
        lens = lens.model_copy(update={"width": width, "height": height} if whole else even)
    return lens.resized(width, height)


def _band(session: Session, shot: ShotRecord, cfa: Cfa | None) -> int | None:
    """The place of a shot's band among those of the session; None: it has none."""
    names = [band.name for band in in_order(session.record.bands)]
    if not names:
        return None
    if cfa is None or not cfa.mono:
        raise ReconstructionError(
            f"{session.file(shot)} is no RAW of a mono camera, and {session.folder} has the light of bands: "
            "train with mono cameras alone, or import the session without --bands."
        )
    if shot.band not in names:
        raise ReconstructionError(
            f"{session.file(shot)} names no band of {session.folder}, which has {', '.join(names)}: "
            "correct shots.jsonl."
        )
    return names.index(shot.band)


def _view(
    session: Session,
    calibration: CalibrationRecord,
    pose: ViewCalibration,
    record: CameraRecord,
    group: Sequence[ShotRecord],
    max_width: int | None,
    falloffs: dict[tuple[str, int, int], Float],
) -> View:
    """One view. falloffs: of cameras by name and size, held once for all their views."""
    camera = calibration.camera(record.name)
    if camera.lens is None:
        raise ReconstructionError(f"Camera {record.name} has no lens in calibration.json: calibrate again.")
    shots, cfa = [], None
    for shot in group:
        scale = calibration.exposure_scale.get(shot.file)
        if scale is None:
            scale = shot.exposure.scale if shot.exposure else 1.0
        path, sensors = session.file(shot), camera.sensors
        mask = None if shot.mask is None else store.inside(session.folder, shot.mask)
        read, cfa = read_shot(path, shot.file, record.kind, scale, camera.response, max_width, sensors, mask)
        shots.append(replace(read, band=_band(session, shot, cfa)))
    height, width = shots[0].pixels.shape[:2]
    if any(shot.pixels.shape != shots[0].pixels.shape for shot in shots):
        raise ReconstructionError(
            f"The shots of camera {record.name} at frame {pose.frame} differ in size: delete the odd one out."
        )
    lens = lens_of_pixels(camera.lens, record.kind, width, height)
    if (plane := (record.name, height, width)) not in falloffs:
        falloffs[plane] = falloff(camera, height, width)
    channels = shots[0].pixels.shape[2] if cfa is None else len(cfa.letters)
    return View(
        camera=record.name,
        frame=pose.frame,
        lens=SplatCamera.of(lens, pose.cam_from_world),
        sensor=Sensor(
            kind=record.kind,
            cfa=cfa,
            camera_from_rec709=of_channels(camera.camera_from_rec709, channels),
            falloff=falloffs[plane],
            response=camera.response,
            white_balance=pose.white_balance,
        ),
        shots=tuple(sorted(shots, key=lambda shot: (shot.band or 0, shot.k))),
        channels=len(session.record.bands) or 3,
    )
