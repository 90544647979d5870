"""Files of a session that get the names back that its records give them."""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from capture.record.shot_files import ShotId, shot_file
from imaging.errors import InputError
from imaging.files import store
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def lost_companions(
    session: Session, shots: Sequence[ShotRecord]
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """List the photographs beside RAW files that are not in their places.

    Args:
        session: Session.
        shots: Records whose RAW files are in their places.

    Returns:
        Their names by SHA-256, and the SHA-256 of what is in their places; not of an import, whose originals
        are elsewhere.
    """
    wanted: dict[str, list[str]] = {}
    altered: dict[str, str] = {}
    for shot in shots:
        place, digest = shot.developed, shot.developed_sha256
        if place is None or digest is None or not is_named_for(shot):
            continue
        if place != shot.file.removesuffix(Path(shot.file).suffix) + Path(place).suffix:
            continue
        path = session.folder / place
        with suppress(InputError):  # one that cannot be read stays where it is
            if path.is_file():
                if session.record.origin == "import" or (present := store.sha256(path)) == digest:
                    continue
                altered[place] = present
            wanted.setdefault(digest, []).append(place)
    return wanted, altered


def rename_back(
    session: Path, wanted: Mapping[str, Sequence[str]], strays: Sequence[str], altered: dict[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Rename files to what the records of their contents call them, where nothing else is in the place.

    Args:
        session: Session folder.
        wanted: Names of the files that are not in their places, by their SHA-256: several where files are
            equal.
        strays: Files without a record; those that cannot be read are passed over.
        altered: SHA-256 of the files in the places of others.

    Returns:
        The new name of each renamed file, and a sentence for each that could not be renamed.
    """
    digests: dict[str, str] = {}
    for file in strays if wanted else ():
        if (session / file).is_file() and not (session / file).is_symlink():
            with suppress(InputError):
                digests[file] = store.sha256(session / file)
    # Of equal files the first get the names whose places are empty.
    places = {
        digest: iter(sorted(names, key=lambda name: os.path.lexists(session / name)))
        for digest, names in wanted.items()
    }
    names: dict[str, str] = {}
    for file, digest in (digests | altered).items():
        place = next(places.get(digest, iter(())), None)
        if place is not None:
            names[file] = place
    refused: dict[str, str] = {}
    # A place is free as well if its own file is renamed.
    while taken := [
        file for file, place in names.items() if place not in names and os.path.lexists(session / place)
    ]:
        for file in taken:
            place = names.pop(file)
            refused[file] = f"{file} is {place}: move away what has that name, and rename it back."
    # Two steps, for files that swap names; should this be killed in between, the next repair goes on.
    between = {place: free_name(session / f"{place}.back") for place in names.values()}
    for file, place in names.items():
        store.make_folder(between[place].parent)
        store.rename(session / file, between[place])
    for place, path in between.items():
        store.rename(path, session / place)
    return names, refused


def free_name(path: Path) -> Path:
    """The path, or one with a number, at which there is nothing."""
    new, number = path, 1
    while os.path.lexists(new):
        new = path.with_name(f"{path.stem}.{number}{path.suffix}")
        number += 1
    return new


def is_named_for(shot: ShotRecord) -> bool:
    """Return whether the file of a record is named as its shot."""
    shot_id = ShotId(shot.camera, shot.frame, shot.step)
    return shot.file == shot_file(shot_id, Path(shot.file).suffix.lstrip("."))
