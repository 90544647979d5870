"""Masks that come with photographs: pictures beside them, black where a photograph is to be ignored."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from capture.imports.originals import Original
from capture.imports.sorting.companions import asked, beside

SUFFIXES = (".png",)


def masks_beside(photos: Iterable[Path], root: Path, masks: Path) -> dict[Path, Path]:
    """The masks in a folder, by photograph, as `companions.beside` has them."""
    return beside(photos, root, masks, SUFFIXES)


def masks_asked(photos: list[Path], folder: Path, masks: Path) -> tuple[dict[Path, Path], str]:
    """The masks in the folder that somebody named, and a sentence of how many there are.

    Errors as `companions.asked`.
    """
    mask_of = asked(photos, folder, masks, SUFFIXES, "mask")
    return mask_of, masks_note(mask_of, len(photos))


def masks_note(masks: Mapping[Path, Path], photos: int) -> str:
    """Return how many photographs have a mask."""
    return f"{len(masks)} of {photos} photos have a mask; what is black in it is ignored."


def transparency_notes(originals: Sequence[Original], masks: Mapping[Path, Path]) -> list[str]:
    """A sentence on the photographs without a mask that are partly transparent, if any are."""
    glassy = [
        photo
        for photo in originals
        if photo.picture is not None and photo.picture.transparent > 0 and photo.path not in masks
    ]
    if not glassy:
        return []
    count = "1 photo is" if len(glassy) == 1 else f"{len(glassy)} photos are"
    return [
        f"{count} partly transparent: transparent areas stay empty in the scene, and count as black. To "
        "ignore them instead, give copies of the files by --masks FOLDER."
    ]
