"""Photographs copied into a session byte for byte, so that a killed import can be completed."""

import hashlib
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from capture.imports.given.depths import unit_of
from capture.imports.layouts.given import GivenDepth
from capture.imports.originals import Original, shown
from capture.imports.sorting.turned import mask_turned_back, turned_back
from capture.record.new_session import begin, is_vacant
from capture.record.shot_files import ShotId, depth_file, mask_file, save_developed, shifted_file, shot_file
from imaging.errors import InputError, StorageError
from imaging.files import store
from imaging.files.raw import read_raw
from imaging.files.tiff.dng import encode_dng
from imaging.merge.masks import read_mask
from imaging.merge.pixel_shift import COUNT, combined
from imaging.progress import Progress
from imaging.session.records import Band, CameraRecord, PlanRecord, SessionRecord, ShotRecord
from imaging.session.session import Session

ORIGIN = "import"


class ShiftError(InputError):
    """Exposures of a pixel shift that cannot be put together."""


@dataclass(frozen=True)
class Place:
    """Destination of an original: its shot, the plan of that, and the files that come with it."""

    original: Original
    shot_id: ShotId
    plan: str
    mask: Path | None = None
    band: str | None = None
    depth: GivenDepth | None = None
    video: Path | None = None
    """The video that the original is a frame of."""

    @property
    def source(self) -> str:
        """Origin in the record of the shot: a frame lies in a folder that each import names anew."""
        path = self.original.path
        return shown(path) if self.video is None else f"{shown(self.video)}: {shown(path.name)}"


def begin_or_continue(
    out: Path,
    cameras: tuple[CameraRecord, ...],
    plans: Sequence[PlanRecord],
    places: Sequence[Place],
    last: str,
    bands: tuple[Band, ...] = (),
) -> tuple[Session, bool]:
    """A new session, or the one that a killed import of the same photographs left; and whether it is new.

    Args:
        out: Folder of the session.
        cameras: Cameras of the import.
        plans: Plans of the import.
        places: Destination of every original.
        last: File, relative to the session, that the import writes last; without it there is more to do.
        bands: Filters of the cameras.

    Returns:
        The session, and True if it was begun here.

    Raises:
        InputError: The folder holds anything else, or all of this import.
        StorageError: The disk refuses.
    """
    if not is_vacant(out):
        session = Session.open(out) if (out / "session.json").exists() else None
        if session is None or not _is_part(session, cameras, plans, places, bands):
            raise InputError(f"{out} is not empty, and holds no part of this import: name a new folder.")
        if not _is_unfinished(session, places, last):
            whole = all(place.original.picture is not None for place in places)
            extent = "complete" if whole else "all that can be read"
            raise InputError(f"{out} holds this import already, {extent}: name a new folder to import again.")
        return session, False
    record = SessionRecord(
        name=out.resolve().name, created=datetime.now(UTC), origin=ORIGIN, cameras=cameras, bands=bands
    )
    return begin(out, record), True


def append_plans(session: Session, plans: Sequence[PlanRecord]) -> None:
    """Add the plans that are not there yet."""
    recorded = {plan.plan for plan in session.plans()}
    for plan in plans:
        if plan.plan not in recorded:
            session.append_plan(plan)


def _is_part(
    session: Session,
    cameras: tuple[CameraRecord, ...],
    plans: Sequence[PlanRecord],
    places: Sequence[Place],
    bands: tuple[Band, ...],
) -> bool:
    """Return whether all that the session holds belongs to this import."""
    sources = _sources(places)
    shots = {shot.identity: shot.source for shot in session.shots()}
    wanted = {plan.plan: (plan.bracket, plan.frames, plan.cameras) for plan in plans}
    there = {plan.plan: (plan.bracket, plan.frames, plan.cameras) for plan in session.plans()}
    return (
        session.record.origin == ORIGIN
        and session.record.cameras == cameras
        and session.record.bands == bands
        and there.items() <= wanted.items()
        and shots.items() <= sources.items()
    )


def _is_unfinished(session: Session, places: Sequence[Place], last: str) -> bool:
    """Return whether there is more to do of an import that the session is a part of."""
    return len(session.shots()) < len(_sources(places)) or not (session.folder / last).exists()


def _sources(places: Sequence[Place]) -> dict[Any, str]:
    """Return where each shot comes from, by its identity."""
    return {(p.plan, *p.shot_id): p.source for p in places if p.original.picture is not None}


def copy_all(session: Session, places: Sequence[Place], progress: Progress) -> tuple[list[str], list[str]]:
    """Copy what is not there yet, camera by camera.

    A sentence for each file that vanished meanwhile, and for each pixel shift in which something moved.
    """
    have = {shot.identity for shot in session.shots() if session.file(shot).is_file()}
    usable = [place for place in places if place.original.picture is not None]
    unread: list[str] = []
    moved: list[str] = []
    for number, place in enumerate(usable):
        progress(f"copying {shown(place.original.path.name)}", number, len(usable))
        if (place.plan, *place.shot_id) not in have:
            try:
                data = [path.read_bytes() for path in place.original.shifted or (place.original.path,)]
                beside = place.original.developed
                developed = None if beside is None else (beside.suffix, beside.read_bytes())
            except OSError as error:
                reason = (error.strerror or str(error)).lower()
                unread.append(f"{shown(place.original.path)} could not be read ({reason})")
                continue
            try:
                share = _copy(session, place, data, developed)
            except ShiftError as error:
                unread.append(f"{shown(place.original.path)} and the {COUNT - 1} after it: {error}")
                continue
            if share:
                moved.append(
                    f"Something moved between {shown(place.original.path)} and the {COUNT - 1} after it, in "
                    f"{share:.1%} of the picture: there the first of them is demosaicked alone."
                )
    progress("copied", len(usable), len(usable))
    return unread, moved


def _copy(session: Session, place: Place, read: list[bytes], developed: tuple[str, bytes] | None) -> float:
    """Files first, line second, as the recorder does; the share of the picture that moved.

    read: the file, or those of a pixel shift. InputError for a mask or a depth map that does not fit,
    ShiftError for exposures that do not fit each other.
    """
    original, shot_id = place.original, place.shot_id
    assert original.picture is not None
    data, suffix, moved = read[0], original.path.suffix.lower(), 0.0
    sources = original.shifted
    if original.shifted:
        (data, moved), suffix = _light(place), ".dng"
    elif original.turned:
        data, suffix, sources = turned_back(data, str(original.path)), ".png", (original.path,)
    file = shot_file(shot_id, suffix.lstrip("."))
    mask = mask_sha256 = None
    if place.mask is not None:
        lies = (original.picture.height, original.picture.width)
        read_mask(place.mask, *(reversed(lies) if original.turned else lies))
        mask = mask_file(shot_id, ".png" if original.turned else place.mask.suffix.lower())
        cover = mask_turned_back(place.mask) if original.turned else place.mask.read_bytes()
        mask_sha256 = hashlib.sha256(cover).hexdigest()
        store.write_bytes(session.folder / mask, cover)
    depth = depth_sha256 = depth_unit = None
    if place.depth is not None:
        depth_unit = unit_of(place.depth, original.picture.height, original.picture.width)
        depth = depth_file(shot_id, place.depth.path.suffix.lower())
        distances = place.depth.path.read_bytes()
        depth_sha256 = hashlib.sha256(distances).hexdigest()
        store.write_bytes(session.folder / depth, distances)
    beside, beside_sha256 = save_developed(session, shot_id, developed)
    files = [shifted_file(shot_id, n, path.suffix.lower()) for n, path in enumerate(sources, start=1)]
    for name, exposure in zip(files, read, strict=False):
        store.write_bytes(session.folder / name, exposure)
    store.write_bytes(session.folder / file, data)
    session.append_shot(
        ShotRecord(
            kind="scene",
            plan=place.plan,
            camera=shot_id.camera,
            frame=shot_id.frame,
            step=shot_id.step,
            file=file,
            sha256=hashlib.sha256(data).hexdigest(),
            developed=beside,
            developed_sha256=beside_sha256,
            shifted=tuple(files),
            shifted_sha256=tuple(hashlib.sha256(exposure).hexdigest() for exposure in read[: len(files)]),
            reported=original.exposure,
            width=original.picture.width,
            height=original.picture.height,
            captured_at=original.picture.metadata.captured_at,
            source=place.source,
            mask=mask,
            mask_sha256=mask_sha256,
            depth=depth,
            depth_sha256=depth_sha256,
            depth_unit=depth_unit,
            band=place.band,
        )
    )
    return moved


def _light(place: Place) -> tuple[bytes, float]:
    """The DNG file of what the exposures of a pixel shift saw together, and the share that moved."""
    try:
        light, moved = combined([read_raw(path) for path in place.original.shifted])
        return encode_dng(light), moved
    except (InputError, ValueError) as error:
        raise ShiftError(str(error)) from error


def take_back(out: Path) -> None:
    """Remove an import that failed: the folder was vacant before, and the originals are untouched."""
    with suppress(StorageError):  # the failure that led here is the one to report
        for entry in out.iterdir():
            store.discard(entry)
