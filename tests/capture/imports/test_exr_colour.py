"""Imported EXR that say which light they are: what is not clear is told, and what is no light is refused."""

from pathlib import Path

import numpy as np
import OpenEXR

from capture.imports.photos import import_photos
from imaging.colour.spaces import PRIMARIES


def written(folder: Path, header: dict[str, object]) -> Path:
    """Two pictures with the same attributes."""
    folder.mkdir()
    for seed in (1, 2):
        light = np.random.default_rng(seed).random((24, 32, 3)).astype(np.float32)
        header_of_file = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
        OpenEXR.File(header_of_file, {"RGB": light}).write(str(folder / f"{seed}.exr"))
    return folder


def said(tmp_path: Path, header: dict[str, object]) -> str:
    result = import_photos(written(tmp_path / "photos", header), tmp_path / "S")
    return "\n".join((*result.guesses, *result.missing))


def test_what_contradicts_itself_is_told(tmp_path: Path) -> None:
    rec709 = tuple(part for point in PRIMARIES["rec709"] for part in point)
    guesses = said(tmp_path, {"colorInteropID": "lin_ap1_scene", "chromaticities": rec709})
    assert (
        "Of 2 of 2 photos the chromaticities contradict the colorInteropID lin_ap1_scene, which counts."
        in guesses
    )


def test_an_id_that_nobody_knows_is_told(tmp_path: Path) -> None:
    guesses = said(tmp_path, {"colorInteropID": "studio:its-own"})
    assert (
        "Of 2 of 2 photos the colorInteropID studio:its-own is not known to rig, so that the light counts"
        in guesses
    )


def test_of_one_that_is_known_nothing_is_said(tmp_path: Path) -> None:
    assert "colorInteropID" not in said(tmp_path, {"colorInteropID": "lin_ap1_scene"})
