"""Reading the views of a calibrated session, in memory or beside it on the disk."""

import hashlib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from imaging.arrays import Array32
from imaging.colour.spaces import of_channels
from imaging.compute.threads import in_turn
from imaging.errors import ReconstructionError
from imaging.files.photo import read_metadata
from imaging.optics.lens import Lens
from imaging.progress import Progress, unreported
from imaging.sensor.cfa import Cfa
from imaging.session.bands import in_order
from imaging.session.calibration import CalibrationRecord, ViewCalibration, read_calibration
from imaging.session.falloff import falloff
from imaging.session.records import CameraRecord, ImageKind, ShotRecord
from imaging.session.session import SPLIT, Session, brackets
from imaging.session.view_id import ViewId
from recon.data.dataset import COLMAP, Dataset, Sensor, View
from recon.data.decoded import FOLDER, read_stored, require_room
from recon.data.downsampling import Falloffs, narrower
from recon.data.holdout import held_out, tested_views, used_shots
from recon.data.measured_depth import DepthMapFile, scaled
from recon.data.pixels import ShotSource, read_shot
from recon.data.resident import too_large
from recon.data.stated_factors import overruled
from recon.data.world import WorldTransform
from recon.splat import SplatCamera

READERS = 4
"""Files at most that are read at once: each takes several times the memory of its picture."""

Examine = Callable[[Sequence[View], Mapping[str, tuple[int, int]]], bool]
"""Given the first view of each camera, and how many views each has in all and to train on: whether the shots
are to stay on the disk (`recon.data.decoded`). It may refuse."""


def load(
    session: Path,
    *,
    max_width: int | None = None,
    all_views: bool = False,
    progress: Progress = unreported,
    examine: Examine = too_large,
) -> Dataset:
    """Read every view that its own picture placed; wider images are scaled down.

    A session whose data set says what it tests on (split.json) holds out just that. Photographs and EXR are
    averaged over areas in linear light; mosaics of at least twice the width are demosaicked and averaged,
    narrower ones are kept as they are.

    Args:
        session: Folder of a calibrated session.
        max_width: Of the images, px; None: as they are.
        all_views: True to hold no view out, whatever the data set says.
        progress: Callback for the current step, the steps done, and all of them.
        examine: Called when a view of each camera is read, before the others are: True keeps the shots on the
            disk. It may refuse by an error of its own.

    Returns:
        The views to train on and those that are held out, in scene coordinates.

    Raises:
        ReconstructionError: No view is registered, or all were taken from one place; a view does not fit the
            others, as by shots of another size.
        InputError: Files are missing or damaged.
        StorageError: Shots are to be kept on a disk without room.
    """
    opened = Session.open(session)
    calibration = read_calibration(session)
    if calibration.turned:
        raise ReconstructionError(
            f"{session} was taken from one place, which shows no depth: take views from several places, or "
            "make a panorama of it with `rig merge --panorama`."
        )
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
    out: set[ViewId] = set()
    if not all_views:
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


def again(dataset: Dataset, max_width: int, progress: Progress) -> Dataset:
    """A data set at another width, of the same views and shots: made of these where they are in memory, else
    read anew from the session, and kept on the disk as those are.
    """
    if all(view.held for view in dataset.views):
        falloffs: Falloffs = {}
        train, held_out = (
            tuple(narrower(view, max_width, falloffs) for view in views)
            for views in (dataset.train, dataset.held_out)
        )
        return replace(dataset, train=train, held_out=held_out)
    loaded = load(
        dataset.session,
        max_width=max_width,
        all_views=not dataset.held_out,
        progress=progress,
        examine=lambda *_: True,
    )
    anew = {view.id: view for view in overruled(loaded, dataset.overruled).views}

    def narrow(view: View) -> View:
        files = {shot.file for shot in view.shots}
        whole = anew[view.id]
        return replace(whole, shots=tuple(shot for shot in whole.shots if shot.file in files))

    train, held_out = (tuple(map(narrow, views)) for views in (dataset.train, dataset.held_out))
    return replace(dataset, train=train, held_out=held_out).with_depths(dataset.depth_scale)


def calibration_sha256(session: Path) -> str:
    """Hash of calibration.json, and of split.json if it exists: the poses and the split of the views."""
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
    examine: Examine = too_large,
) -> Dataset:
    """The shots of each view as a data set; all views have a pose.

    Args:
        session: Session of the shots.
        calibration: Poses, lenses, responses and exposure scales, of all views in `groups`.
        calibration_sha256: Hash that the data set states as that of its calibration.
        groups: Shots of each view.
        out: Views that are held out; the others are trained on.
        world: Place of the scene, whose views they are, in the world.
        max_width: Of the images, px; None: as they are.
        progress: Callback for the current step, the steps done, and all of them.
        examine: Called when a view of each camera is read, before the others are, as of `load`.

    Returns:
        The views to train on and those that are held out, in scene coordinates.

    Raises:
        ReconstructionError: A camera has no lens, the shots of a view differ in size, or one is of no band
            where the session has the light of bands.
        InputError: Files are missing or damaged.
        StorageError: Shots are to be kept on a disk without room.
    """
    poses = {view.id: view for view in calibration.views}
    kinds = {session.camera(view.camera).kind for view in groups}
    falloffs: dict[tuple[str, int, int], Array32] = {}

    def read(place: ViewId, stored: Path | None) -> View:
        camera = session.camera(place.camera)
        view = _view(session, calibration, poses[place], camera, groups[place], max_width, falloffs, stored)
        return scaled(replace(view, lens=world.camera(view.lens)), 1 / world.unit)

    first = {place.camera: place for place in sorted(groups, reverse=True)}
    rest = sorted(set(groups) - set(first.values()))
    views: list[View] = []
    for done, place in enumerate(first.values()):
        progress("reading images", done, len(groups))
        views.append(read(place, None))
    counts = {camera: _counts(camera, groups, out) for camera in first}
    folder = session.folder / FOLDER if examine(views, counts) else None
    if folder is not None:
        views = [read(place, folder) for place in first.values()]
        require_room(folder, max_width, ((view, counts[view.camera][0]) for view in views))
    # To the disk one after another: there, memory is what is short.
    others = in_turn(len(rest), lambda turn: read(rest[turn], folder), READERS if folder is None else 1)
    for done, view in enumerate(others, len(first) + 1):
        progress("reading images", done, len(groups))
        views.append(view)
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
        records=tuple(shot for group in groups.values() for shot in group),
    )


def _counts(camera: str, groups: Collection[ViewId], out: Collection[ViewId]) -> tuple[int, int]:
    """Views of a camera, and those of them to train on."""
    camera_views = [view for view in groups if view.camera == camera]
    return len(camera_views), sum(view not in out for view in camera_views)


def lens_of_pixels(lens: Lens, kind: ImageKind, width: int, height: int) -> Lens:
    """The lens of a file for what `read_shot` made of it, width x height pixels."""
    if kind == "raw":  # rows and columns that complete no tile, or no pair, are lost, which moves nothing
        whole = 2 * width > lens.width
        even = {"width": lens.width - lens.width % 2, "height": lens.height - lens.height % 2}
        lens = lens.model_copy(update={"width": width, "height": height} if whole else even)
    return lens.resized(width, height)


def _band(session: Session, shot: ShotRecord, cfa: Cfa | None) -> int | None:
    """Index of a shot's band among those of the session, or None."""
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
    falloffs: dict[tuple[str, int, int], Array32],
    stored: Path | None,
) -> View:
    """One view. falloffs: of cameras by name and size, held once for all their views; stored: where its
    shots are kept, None in memory."""
    camera = calibration.camera(record.name)
    if camera.lens is None:
        raise ReconstructionError(f"Camera {record.name} has no lens in calibration.json: calibrate again.")
    shots, cfa = [], None
    for shot in group:
        scale = calibration.exposure_scale.get(shot.file)
        if scale is None:
            scale = shot.exposure.scale if shot.exposure else 1.0
        source = ShotSource(
            session.file(shot), shot.file, record.kind, camera.response, max_width, camera.sensors,
            session.mask(shot),
        )  # fmt: skip
        read, cfa = read_shot(source, scale) if stored is None else read_stored(stored, source, scale)
        shots.append(replace(read, band=_band(session, shot, cfa)))
    height, width = shots[0].shape[:2]
    if any(shot.shape != shots[0].shape for shot in shots):
        raise ReconstructionError(
            f"The shots of camera {record.name} at frame {pose.frame} differ in size: delete the odd one out."
        )
    lens = lens_of_pixels(camera.lens, record.kind, width, height)
    if (plane := (record.name, height, width)) not in falloffs:
        falloffs.setdefault(plane, falloff(camera, height, width))
    channels = shots[0].shape[2] if cfa is None else len(cfa.letters)
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
        depth=_depth(session, group),
        orientation=read_metadata(session.file(group[0])).orientation,
    )


def _depth(session: Session, group: Sequence[ShotRecord]) -> DepthMapFile | None:
    """The depth map of the first shot that has one, in units of the world."""
    for shot in group:
        path = session.depth(shot)
        if path is not None:
            return DepthMapFile(path, shot.depth_unit or 1.0)
    return None
