"""Masks that come with photographs: pictures beside them, black where a photograph is to be ignored."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from capture.findings import Problem, ProblemKind
from capture.originals import shown
from capture.saving import Slot
from imaging import store
from imaging.errors import InputError
from imaging.mask import read_mask
from imaging.records import ShotRecord
from imaging.session import Session


def masks_beside(photos: Iterable[Path], root: Path, masks: Path) -> dict[Path, Path]:
    """The masks in a folder, by photograph: that of a/b.jpg is a/b.jpg.png, as COLMAP has it,
    or a/b.png.
    """
    found = {}
    for photo in photos:
        if photo.is_relative_to(root):
            own = masks / photo.relative_to(root)
            there = [
                path for path in (own.with_name(f"{own.name}.png"), own.with_suffix(".png")) if path.is_file()
            ]
            if there:
                found[photo] = there[0]
    return found


def masks_asked(photos: list[Path], folder: Path, masks: Path) -> tuple[dict[Path, Path], str]:
    """The masks in the folder that somebody named, and a sentence of how many there are.

    InputError where there are none, or where the masks lie among the photographs.
    """
    if not masks.is_dir():
        raise InputError(f"{masks} is not a folder: name the one that holds the masks.")
    if masks.resolve().is_relative_to(folder.resolve()) and any(
        photo.is_relative_to(masks) for photo in photos
    ):
        raise InputError(f"{masks} lies among the photographs of {folder}: move it beside that folder.")
    found = masks_beside(photos, folder, masks)
    if not found:
        example = shown(photos[0].relative_to(folder).with_suffix(".png")) if photos else "a photo's name"
        raise InputError(f"{masks} holds no mask of any photo: name them as the photos, such as {example}.")
    return found, told_masks(found, len(photos))


def mask_file(slot: Slot, suffix: str) -> str:
    """Where the mask of a shot lies, relative to the session."""
    return f"masks/{slot.frame:04d}/{slot.camera}_{slot.step}{suffix}"


def mask_problems(session: Session, shots: Sequence[ShotRecord], again: str) -> Iterator[Problem]:
    """Masks that are absent, damaged or not those that were recorded; again: how to get them anew."""
    for shot in shots:
        if shot.mask is None:
            continue
        name = f"{shot.mask}, the mask of {shot.file},"
        try:
            path = session.mask(shot)
            assert path is not None
            if not path.is_file():
                kind: ProblemKind = "absent"
                message = f"{name} is not there: restore it from a copy, or {again}."
            elif shot.mask_sha256 is None:
                read_mask(path, shot.height, shot.width)
                continue
            elif store.sha256(path) != shot.mask_sha256:
                kind = "altered"
                message = (
                    f"{name} is not the file that was recorded (its SHA-256 differs): restore it from a "
                    f"copy, or {again}."
                )
            else:
                continue
        except InputError as error:
            kind, message = "torn", str(error)
        yield Problem(
            kind=kind, file=shot.mask, camera=shot.camera, frame=shot.frame, step=shot.step, message=message
        )


def told_masks(masks: Mapping[Path, Path], photos: int) -> str:
    """How many photographs have a mask."""
    return f"{len(masks)} of {photos} photos have a mask; what is black in it is ignored."
