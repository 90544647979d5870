"""Masks that come with photographs: pictures beside them, black where a photograph is to be ignored."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from capture.imports.originals import shown
from imaging.errors import InputError


def masks_beside(photos: Iterable[Path], root: Path, masks: Path) -> dict[Path, Path]:
    """The masks in a folder, by photograph: that of a/b.jpg is a/b.jpg.png, as COLMAP has it,
    or a/b.png.
    """
    mask_of = {}
    for photo in photos:
        if photo.is_relative_to(root):
            mask = masks / photo.relative_to(root)
            there = [
                path
                for path in (mask.with_name(f"{mask.name}.png"), mask.with_suffix(".png"))
                if path.is_file()
            ]
            if there:
                mask_of[photo] = there[0]
    return mask_of


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
    mask_of = masks_beside(photos, folder, masks)
    if not mask_of:
        example = shown(photos[0].relative_to(folder).with_suffix(".png")) if photos else "a photo's name"
        raise InputError(f"{masks} holds no mask of any photo: name them as the photos, such as {example}.")
    return mask_of, told_masks(mask_of, len(photos))


def told_masks(masks: Mapping[Path, Path], photos: int) -> str:
    """How many photographs have a mask."""
    return f"{len(masks)} of {photos} photos have a mask; what is black in it is ignored."
