"""Files that come with photographs, in a folder of their own and named as they are: masks, depth maps."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from capture.imports.originals import shown
from imaging.errors import InputError


def beside(photos: Iterable[Path], root: Path, folder: Path, suffixes: Sequence[str]) -> dict[Path, Path]:
    """The files in a folder, by photograph: that of a/b.jpg is a/b.jpg.png, as COLMAP has it, or a/b.png.

    Args:
        photos: Photographs; those outside `root` have no such file.
        root: Folder of the photographs.
        folder: Folder with the same subfolders that holds the files.
        suffixes: Suffixes that they may have, with the dot, of which the first that is there counts.

    Returns:
        The file of each photograph that has one.
    """
    companions = {}
    for photo in photos:
        if photo.is_relative_to(root):
            mirrored = folder / photo.relative_to(root)
            names = (
                name
                for suffix in suffixes
                for name in (mirrored.with_name(f"{mirrored.name}{suffix}"), mirrored.with_suffix(suffix))
            )
            there = [name for name in names if name.is_file()]
            if there:
                companions[photo] = there[0]
    return companions


def asked(
    photos: list[Path], root: Path, folder: Path, suffixes: Sequence[str], what: str
) -> dict[Path, Path]:
    """Find the files that come with photographs in a folder that the user named.

    Args:
        photos: Photographs.
        root: Folder of the photographs.
        folder: Folder that holds the files, as in `beside`.
        suffixes: Suffixes that they may have, with the dot, of which the first that is there counts.
        what: Name of such files in messages, singular.

    Returns:
        The file of each photograph that has one, of one at least.

    Raises:
        InputError: The folder is missing, holds no such file, or lies among the photographs.
    """
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder: name the one that holds the {what}s.")
    place = folder.resolve()
    if place.is_relative_to(root.resolve()) and any(
        photo.resolve().is_relative_to(place) for photo in photos
    ):
        if place == root.resolve():
            raise InputError(
                f"{folder} is the folder of photographs itself: copy the {what}s to a folder outside of it "
                "and name that one."
            )
        raise InputError(f"{folder} is inside the folder of photographs {root}: move it out of there.")
    companions = beside(photos, root, folder, suffixes)
    if not companions:
        first = photos[0].relative_to(root).with_suffix(suffixes[0]) if photos else None
        example = "a photo's name" if first is None else shown(first)
        raise InputError(
            f"{folder} holds no {what} of any photo: name them as the photos, such as {example}."
        )
    return companions
