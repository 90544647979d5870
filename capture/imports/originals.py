"""The photographs of a folder, as somebody left them: found, read to their end, put in order."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from capture.imports.sorting.derived import Derived, find_copies, find_derived
from capture.imports.sorting.exposure_list import NAME as EXPOSURE_LIST
from capture.imports.sorting.exposure_list import read_exposure_list
from capture.pictures.read import PictureFacts, kind_of, read_picture
from imaging.errors import InputError
from imaging.natural_order import natural
from imaging.optics.exposure import Exposure
from imaging.progress import Progress
from imaging.session.records import ImageKind

FOREIGN = (
    dict.fromkeys(
        (".heic", ".heif", ".hif"), "install pillow-heif to read HEIC, or convert it to JPEG or TIFF"
    )
    | {".avif": "convert AVIF to JPEG or TIFF"}
    | dict.fromkeys((".mp4", ".mov"), "a video is imported by itself: rig import VIDEO S")
)
"""Advice for pictures of unsupported kinds, by their suffix."""


@dataclass(frozen=True)
class Original:
    """File with the suffix of a photograph.

    picture is None and `error` a sentence where the file is not one; it still takes
    its place in the series, so that the brackets after it are not shifted by one.
    """

    path: Path
    kind: ImageKind
    picture: PictureFacts | None
    exposure: Exposure | None = None
    error: str | None = None
    developed: Path | None = None
    """The photograph that the camera made beside a RAW file."""
    shifted: tuple[Path, ...] = ()
    """The exposures of the pixel shift that begins with `path`."""
    turned: bool = False
    """True if the session has it turned by a quarter to the left; `picture` is then turned too."""


@dataclass(frozen=True)
class Survey:
    """Contents of a folder. originals: in order. notes: exclusions and assumptions, a sentence each.

    masks: by photograph, of those that lie in a folder of masks.
    """

    originals: tuple[Original, ...]
    notes: tuple[str, ...]
    masks: Mapping[Path, Path] = field(default_factory=dict)


def survey(
    folder: Path,
    progress: Progress,
    *,
    named: Mapping[Path, Exposure | None] | None = None,
    exposures: Path | None = None,
) -> Survey:
    """Read every photograph of a folder and its subfolders; hidden files and folders are passed over.

    Args:
        folder: Folder.
        progress: Callback for the current file, the files read, and all of them.
        named: Photographs of a layout, with the exposures that it states: these and no others are read, in
            this order.
        exposures: List of exposures for all photographs, in place of those in the folder.

    Returns:
        The photographs in order, readable or not, with notes, and the masks in folders of masks.

    Raises:
        InputError: The list of exposures cannot be read, or the layout names a file of an unread kind.
    """
    paths, others = _walked(folder)
    developed: dict[Path, Path] = {}
    derived = Derived()
    copies: list[Path] = []
    if named is None:
        derived = find_derived(folder, paths)
        gone = {path for group in derived.aside.values() for path in group}
        paths = [path for path in paths if path not in gone]
        copies = _copies(folder, others, paths, exposures)
        paths, developed = _without_developed([path for path in paths if path not in set(copies)])
    else:
        others, paths = [], list(named)
        _check_kinds(paths)
    notes: list[str] = []
    listed = {path: exposure for path, exposure in (named or {}).items() if exposure is not None}
    if exposures is None:
        listed |= _listed(folder, others, paths, notes)
    else:
        listed |= _given(folder, exposures, paths, notes)
    others = [path for path in others if exposures is None or path.resolve() != exposures.resolve()]
    if others:
        names = ", ".join(shown(path.relative_to(folder)) for path in others[:3])
        more = "" if len(others) <= 3 else " and others"
        note = f"{_files(len(others))} left aside as no picture that rig reads: {names}{more}."
        foreign = sorted({path.suffix.lower() for path in others} & FOREIGN.keys())
        notes.append(note.rstrip(".") + f"; {FOREIGN[foreign[0]]}." if foreign else note)
    notes += [*aside_notes(folder, derived.aside), *copies_note(folder, copies)]
    if developed:
        count = "1 file" if len(developed) == 1 else f"{len(developed)} files"
        notes.append(f"{count} kept beside RAW files of the same name, but not read.")
    originals: list[Original] = []
    for number, path in enumerate(paths):
        progress(f"reading {shown(path.name)}", number, len(paths))
        originals.append(replace(_read(path, listed.get(path)), developed=developed.get(path)))
    progress("read", len(paths), len(paths))
    notes += [*_unknown(originals, listed), *_profiles(originals), *_doubts(originals)]
    return Survey(tuple(originals), tuple(notes), derived.masks)


def aside_notes(folder: Path, aside: Mapping[Path, Sequence[Path]]) -> list[str]:
    """A sentence on derived pictures that are left aside, by the folder that they are in, if any are."""
    if not aside:
        return []
    count = _files(sum(len(group) for group in aside.values()))
    homes = ", ".join(shown(home.relative_to(folder)) for home in list(aside)[:4])
    return [f"{count} left aside as made of the photographs by another program: those of {homes}."]


def _copies(folder: Path, others: list[Path], paths: list[Path], exposures: Path | None) -> list[Path]:
    """The copies beside their photographs; a file that a list of exposures names is a photograph."""
    named: dict[Path, Exposure] = {}
    with suppress(InputError):  # said where the exposures are taken
        if exposures is None:
            named = _listed(folder, list(others), paths, [])
        else:
            named = _given(folder, exposures, paths, [])
    return [path for path in find_copies(paths) if path not in named]


def copies_note(folder: Path, copies: Sequence[Path]) -> list[str]:
    """A sentence on the copies of photographs that are left aside, if any are."""
    if not copies:
        return []
    kind = "a copy of another" if len(copies) == 1 else "copies of others"
    names = ", ".join(shown(path.relative_to(folder)) for path in copies[:3])
    return [f"{_files(len(copies))} left aside as {kind}: {names}{', ...' if len(copies) > 3 else ''}."]


def pictures_in(folder: Path) -> list[Path]:
    """The picture files of a folder and its subfolders, in natural order."""
    return _walked(folder)[0]


def shown(path: Path | str) -> str:
    """A path as text that can be printed and stored, whatever bytes its name is made of."""
    return os.fsencode(path).decode("utf-8", "backslashreplace")


def _files(count: int) -> str:
    return "1 file is" if count == 1 else f"{count} files are"


def _walked(folder: Path) -> tuple[list[Path], list[Path]]:
    """Pictures and other files, each in natural order; folders that are links are not followed."""
    pictures: list[Path] = []
    others: list[Path] = []
    for place, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        for name in files:
            path = Path(place) / name
            if not name.startswith(".") and path.is_file():
                (pictures if kind_of(path) else others).append(path)

    def order(path: Path) -> tuple[object, ...]:
        relative = path.relative_to(folder)
        return natural(relative.parent), natural(Path(relative.name)), str(relative)

    return sorted(pictures, key=order), sorted(others, key=order)


def _check_kinds(paths: list[Path]) -> None:
    """InputError for the first file that a layout names although rig reads none of its kind."""
    for path in paths:
        if kind_of(path) is None:
            fix = FOREIGN.get(path.suffix.lower(), "convert it to JPEG, PNG or TIFF")
            raise InputError(f"{shown(path)}, which the layout names, is no picture that rig reads: {fix}.")


def _without_developed(paths: list[Path]) -> tuple[list[Path], dict[Path, Path]]:
    """RAW+JPEG pairs are one exposure: the RAW counts; the photographs that are beside one, by it."""
    raws = {(path.parent, path.stem.casefold()): path for path in paths if kind_of(path) == "raw"}
    pairs = [(raws.get((p.parent, p.stem.casefold())), p) for p in paths if kind_of(p) == "ldr"]
    aside = {photo for raw, photo in pairs if raw is not None}
    return [path for path in paths if path not in aside], {raw: photo for raw, photo in pairs if raw}


def _unknown(originals: list[Original], listed: Mapping[Path, Exposure]) -> list[str]:
    """A sentence for ISO and f-number each, where some of the exposures lack it, or all of the files' own."""
    exposed = [original for original in originals if original.exposure is not None]
    notes = []
    for name, key, counts in (("ISO", "iso", "ISO 100"), ("f-number", "f_number", "f/1")):
        without = [original for original in exposed if getattr(original.exposure, key) is None]
        mixed = len(without) < len(exposed)
        if not without or not (mixed or any(original.path not in listed for original in without)):
            continue
        count = (
            f"1 photo has no {name}, which counts"
            if len(without) == 1
            else (f"{len(without)} photos have no {name}, which counts")
        )
        rest = "although others have one" if mixed else "and has to be the same in all"
        notes.append(f"{count} as {counts}, {rest}; --exposures FILE gives it.")
    return notes


def _profiles(originals: list[Original]) -> list[str]:
    names = [
        photo.picture.profile for photo in originals if photo.picture is not None and photo.picture.profile
    ]
    return [
        f"{names.count(name)} of {len(originals)} photos are in {name}, as their files say; "
        "rig reads them converted to sRGB."
        for name in dict.fromkeys(names)
    ]


def _doubts(originals: list[Original]) -> list[str]:
    doubts = [photo.picture.doubt for photo in originals if photo.picture is not None and photo.picture.doubt]
    return [
        f"Of {doubts.count(doubt)} of {len(originals)} photos the {doubt}" for doubt in dict.fromkeys(doubts)
    ]


def _listed(folder: Path, others: list[Path], paths: list[Path], notes: list[str]) -> dict[Path, Exposure]:
    """Exposures of the photographs from the lists among `others`, which are taken out of it."""
    exposures: dict[Path, Exposure] = {}
    photos = set(paths)
    for path in [path for path in others if path.name.casefold() == EXPOSURE_LIST]:
        source = shown(path.relative_to(folder))
        try:
            named = {path.parent / name: exposure for name, exposure in read_exposure_list(path).items()}
            if photos.isdisjoint(named):
                raise InputError(f"{source} names none of the photos: correct the names in it.")
        except InputError as error:
            notes.append(f"An exposure list is left aside: {str(error).rstrip('.')}.")
            continue
        others.remove(path)
        mine = {photo: exposure for photo, exposure in named.items() if photo in photos}
        exposures |= mine
        notes.append(
            f"The exposures of {len(mine)} of {len(paths)} photos are those of {source}, not of their EXIF; "
            "--exposures FILE gives others."
        )
    return exposures


def _given(folder: Path, source: Path, paths: list[Path], notes: list[str]) -> dict[Path, Exposure]:
    """Exposures from the list that was asked for, by a photograph's path in the folder, else by its name."""
    listed = read_exposure_list(source)
    exposures: dict[Path, Exposure] = {}
    for name, exposure in listed.items():
        relative = Path(name)
        exact = [path for path in paths if path == folder / relative]
        same = exact or [path for path in paths if path.name == relative.name]
        if len(same) > 1:
            raise InputError(
                f"{source} names {shown(name)}, which is the name of {len(same)} photos: "
                f"write its path from {folder}."
            )
        exposures |= dict.fromkeys(same, exposure)
    if not exposures:
        raise InputError(f"{source} names none of the photos in {folder}: correct the names in it.")
    notes.append(f"The exposures of {len(exposures)} of {len(paths)} photos are those of {shown(source)}.")
    return exposures


def _read(path: Path, listed: Exposure | None) -> Original:
    kind = kind_of(path)
    assert kind is not None
    try:
        picture = read_picture(path)
    except InputError as error:
        reason = str(error).rstrip(".")
        named = path.name in reason
        return Original(path, kind, None, error=shown(reason if named else f"{path}: {reason}"))
    return Original(path, kind, picture, exposure=listed or picture.metadata.exposure)
