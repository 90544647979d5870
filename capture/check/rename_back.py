"""Files of a session that get the names back that its records give them."""

import os
from collections.abc import Sequence
from pathlib import Path

from capture.record.shot_files import ShotId, shot_file
from imaging.files import store
from imaging.session.records import ShotRecord
from imaging.session.session import Session


def lost_companions(session: Session, shots: Sequence[ShotRecord]) -> tuple[dict[str, str], dict[str, str]]:
    """List the photographs beside RAW files that are not in their places.

    Args:
        session: Session.
        shots: Records whose RAW files are in their places.

    Returns:
        The name of each by its SHA-256, and the SHA-256 of what is in their places; not of an import, whose
        originals are elsewhere.
    """
    wanted: dict[str, str] = {}
    altered: dict[str, str] = {}
    for shot in shots:
        place, digest = shot.developed, shot.developed_sha256
        if place is None or digest is None or not is_named_for(shot):
            continue
        if place != shot.file.removesuffix(Path(shot.file).suffix) + Path(place).suffix:
            continue
        path = session.folder / place
        if not path.is_file():
            wanted[digest] = place
        elif session.record.origin != "import" and (present := store.sha256(path)) != digest:
            wanted[digest], altered[place] = place, present
    return wanted, altered


def rename_back(
    session: Path, wanted: dict[str, str], strays: Sequence[str], altered: dict[str, str]
) -> tuple[dict[str, str], dict[str, str]]:
    """Rename files to what the records of their contents call them, where nothing else is in the place.

    Args:
        session: Session folder.
        wanted: Names of the files that are not in their places, by their SHA-256.
        strays: Files without a record.
        altered: SHA-256 of the files in the places of others.

    Returns:
        The new name of each renamed file, and a sentence for each that could not be renamed.
    """
    wanted = dict(wanted)
    digests: dict[str, str] = {}
    for file in strays if wanted else ():
        if (session / file).is_file() and not (session / file).is_symlink():
            digests[file] = store.sha256(session / file)
    names: dict[str, str] = {}
    for file, digest in (digests | altered).items():
        if digest in wanted:
            names[file] = wanted.pop(digest)
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
