"""Reading of the files of a COLMAP model: their integrity, and what pycolmap does not read of them.

pycolmap reads a file that is cut off for ever, or invents what is missing; so the files are walked
through first. Their layout: https://colmap.github.io/format.html.
"""

import struct
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from capture.imports.layouts.ply_points import read_ply_points
from imaging.compute.memory import check
from imaging.errors import InputError
from imaging.files.colmap import pycolmap

_POSE = 7 * 8
"""Bytes of a quaternion and a translation."""
_PER_BYTE = 4
"""Bytes of memory that pycolmap takes for each of a model's files."""


def read_model(place: Path) -> Any:
    """The pycolmap reconstruction of a model folder; InputError if it is damaged."""
    size = sum(path.stat().st_size for path in place.iterdir() if path.suffix in (".bin", ".txt"))
    check(f"{place} is a COLMAP model of {size / 1e6:.0f} MB", _PER_BYTE * size)
    _check_whole(place)
    names = _text_names(place)
    try:
        model = pycolmap.Reconstruction(str(place)) if _has_points(place) else _without_points(place)
        for number, image in model.images.items():
            image.name = names.get(number, image.name)
            image.name.encode()  # raises for a name that is no UTF-8
    except Exception as error:  # of many types, one for each way in which a file may be wrong
        raise InputError(f"{place} cannot be read as a COLMAP model: export it again.") from error
    return model


def _has_points(place: Path) -> bool:
    return any((place / f"points3D.{kind}").is_file() for kind in ("bin", "txt"))


def _without_points(place: Path) -> Any:
    """A model whose points are left out, or lie in points3D.ply alone, as 3DGS has them."""
    with TemporaryDirectory() as folder:
        aside = Path(folder)
        for name in ("cameras", "images", "rigs", "frames"):
            for path in (place / f"{name}.bin", place / f"{name}.txt"):
                if path.is_file():
                    (aside / path.name).symlink_to(path.resolve())
        if (place / "images.bin").is_file():
            (aside / "points3D.bin").write_bytes(bytes(8))
        else:
            (aside / "points3D.txt").write_text("")
            _drop_features(place / "images.txt", aside / "images.txt")
        model = pycolmap.Reconstruction(str(aside))
    if (place / "points3D.ply").is_file():
        for point in read_ply_points(place / "points3D.ply"):
            model.add_point3D(point, pycolmap.Track())
    return model


def _drop_features(source: Path, to: Path) -> None:
    """Copy images.txt without the features, which name points that are not there."""
    lines = [line for line in source.read_text().splitlines() if not line.startswith("#")]
    to.unlink()
    to.write_text("".join(f"{line}\n\n" for line in lines[::2]))


class _Walk:
    """A place in a file, moved on by what is read. IndexError, struct.error past the end."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def read(self, shape: str) -> Any:
        """The first of the little-endian values of a struct format."""
        fields = struct.Struct("<" + shape)
        value = fields.unpack_from(self.data, self.at)[0]
        self.at += fields.size
        return value

    def skip(self, count: int) -> None:
        """Pass over bytes that are there."""
        self.at += count
        if self.at > len(self.data):
            raise IndexError


def _check_whole(place: Path) -> None:
    """InputError that names the first binary file of a model that is cut off, or too long."""
    for name, record in _RECORDS.items():
        path = place / name
        if not path.is_file():
            continue
        try:
            walk = _Walk(path.read_bytes())
            for _ in range(walk.read("Q")):
                record(walk)
            whole = walk.at == len(walk.data)
        except OSError as error:
            raise InputError(f"{path} cannot be read: correct its permissions.") from error
        except (IndexError, ValueError, RuntimeError, TypeError, struct.error):
            whole = False
        if not whole:
            raise InputError(f"{path} is damaged or cut off: copy it again.")


def _text_names(place: Path) -> dict[int, str]:
    """Names of the images of images.txt by their number, of which pycolmap keeps the first word alone.

    Empty without the file, or where images.bin is read in its place. InputError for a rotation of zeros,
    which pycolmap takes for none.
    """
    path = place / "images.txt"
    if (place / "images.bin").is_file() or not path.is_file():
        return {}
    names = {}
    try:
        lines = iter(path.read_text(encoding="utf-8").split("\n"))
        for line in lines:
            if not line.strip() or line.startswith("#"):
                continue
            fields = line.split(maxsplit=9)
            if not any(float(value) for value in fields[1:5]):
                raise InputError(f"{path} has an image with a rotation of zeros: export it again.")
            names[int(fields[0])] = fields[9].strip()
            next(lines, None)  # its features
    except OSError as error:
        raise InputError(f"{path} cannot be read: correct its permissions.") from error
    except (ValueError, IndexError) as error:
        raise InputError(f"{path} is damaged or cut off: copy it again.") from error
    return names


def _camera(walk: _Walk) -> None:
    walk.skip(4)
    model = pycolmap.CameraModelId(walk.read("i"))
    walk.skip(16 + 8 * len(pycolmap.Camera.create_from_model_id(1, model, 1.0, 1, 1).params))


def _image(walk: _Walk) -> None:
    walk.skip(4)
    _pose(walk)
    walk.skip(4)
    end = walk.data.index(b"\0", walk.at)
    walk.data[walk.at : end].decode()  # pycolmap reads a name that is no UTF-8, and cannot hand it over
    walk.at = end + 1
    walk.skip(24 * walk.read("Q"))


def _pose(walk: _Walk) -> None:
    """Pass over a pose; ValueError for a rotation of zeros, which pycolmap takes for none."""
    quaternion = [walk.read("d") for _ in range(4)]
    if not any(quaternion):
        raise ValueError
    walk.skip(3 * 8)


def _point(walk: _Walk) -> None:
    walk.skip(8 + 24 + 3 + 8)
    walk.skip(8 * walk.read("Q"))


def _rig(walk: _Walk) -> None:
    walk.skip(4)
    sensors = walk.read("I")
    if sensors:
        walk.skip(8)
    for _ in range(1, sensors):
        walk.skip(8)
        if walk.read("B"):
            walk.skip(_POSE)


def _frame(walk: _Walk) -> None:
    walk.skip(8)
    _pose(walk)
    walk.skip(16 * walk.read("I"))


_RECORDS: dict[str, Callable[[_Walk], None]] = {
    "cameras.bin": _camera,
    "images.bin": _image,
    "points3D.bin": _point,
    "rigs.bin": _rig,
    "frames.bin": _frame,
}
