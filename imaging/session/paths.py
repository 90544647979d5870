"""Finding one's way in a session folder without loading a stage."""

import os
from pathlib import Path
from shlex import quote

from imaging.errors import InputError


def not_a_session(folder: Path) -> InputError:
    """Return what to say of a folder without session.json where a session was to be named."""
    from imaging.files.photo import is_photo  # which takes numpy, and the codecs of pictures
    from imaging.files.raw import is_raw

    files = (path for depth in ("*", "*/*") for path in folder.glob(depth))
    if any(is_photo(path) or is_raw(path) for path in files):
        return InputError(
            f"{folder} holds photographs and is no session yet: run `rig import {quote(str(folder))} S`, "
            "then `rig calibrate S`."
        )
    return InputError(f"{folder} has no session.json: name a session made by `rig capture` or `rig import`.")


def has_shots(session: Path) -> bool:
    """Return whether a session holds anything worth keeping: one whole shot or more."""
    shots = session / "shots.jsonl"
    return shots.is_file() and shots.stat().st_size > 0


def session_of(reconstruction: Path) -> Path | None:
    """The session that a reconstruction folder is in; None for one that was moved out of it.

    The path as it is named goes first: `reconstructions` may be a link to a larger disk.
    """
    for place in (Path(os.path.abspath(reconstruction)), reconstruction.resolve()):
        folder = place.parent.parent
        if (folder / "session.json").is_file():
            return folder.resolve()
    return None


SPLAT_FILES = (".ply", ".spz", ".usd", ".usda", ".usdc")
"""Ends of the names of files of Gaussians that stand where a scene does."""


def find_reconstruction(path: Path) -> Path:
    """Find a reconstruction folder, given itself or its session (then the newest); a file of splats is
    returned as it is.

    InputError for anything else.
    """
    if path.is_file() and path.suffix.lower() in SPLAT_FILES:
        return path
    if not path.is_dir():
        raise InputError(f"{path} is not a folder: name SESSION/reconstructions/NAME, or its session.")
    if (path / "model.json").is_file():
        return path
    finished = [model.parent for model in path.glob("reconstructions/[!.]*/model.json")]
    if not finished:
        if not (path / "session.json").is_file() and session_of(path) is None:
            raise not_a_session(path)
        raise InputError(f"{path} has no finished reconstruction: run `rig reconstruct` first.")
    return max(finished, key=lambda folder: ((folder / "model.json").stat().st_mtime_ns, folder.name))


def without_scene(path: Path) -> bool:
    """Return whether a path is a session's folder that holds no finished reconstruction yet."""
    finished = any(path.glob("reconstructions/[!.]*/model.json"))
    return (path / "session.json").is_file() and not finished


def scene_around(path: Path) -> Path | None:
    """The reconstruction that a path is, or is in; None if it is in none."""
    place = path.resolve()
    return next((one for one in (place, *place.parents) if (one / "model.json").is_file()), None)
