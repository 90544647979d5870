"""Decoded shots on the disk, for data sets that exceed the memory: each access reads them anew.

A file of `SESSION/decoded/` has one shot as a training of some width sees it, bit for bit: 8 or 16 bits a
sample where a table of that many numbers holds every one of them, as it does for the codes of cameras, else
float32; masks have a bit a sample. Its name is a hash of all that its pixels depend on, so what is there is
right or not found. Damaged or missing files are decoded anew, also in the midst of a training. The folder
may be deleted at any time.

Files are read, not mapped: a map of 500 views takes the address space that `ulimit -v` limits, and what was
read of a file stays in the system's cache just as well.
"""

import hashlib
import json
import os
import shutil
import zipfile
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import AnyArray, Array32, Mask
from imaging.compute import memory
from imaging.errors import InputError, StorageError
from imaging.files import store
from imaging.merge.linear_frame import Noise, SensorSignalNoise, code_noise
from imaging.sensor.cfa import Cfa
from recon.data.dataset import View
from recon.data.pixels import ShotSource
from recon.data.shot import Planes, Shot, bytes_of

FOLDER = "decoded"
"""Folder in a session."""
_FORMAT = 1
_TRIED = 10_000
"""Number of samples tested before all of them: most pictures that are no codes end there."""
_MASKS = ("saturated", "dark", "valid")
_DAMAGE = (OSError, ValueError, KeyError, TypeError, AttributeError, EOFError, zipfile.BadZipFile, zlib.error)


def key_of(source: ShotSource) -> str:
    """A hash of all that the pixels depend on; InputError where a file is missing."""
    try:
        files = [os.stat(file) for file in (source.path, source.mask) if file is not None]
    except OSError as error:
        raise InputError(
            f"{error.filename} cannot be read ({(error.strerror or '').lower()}): restore it."
        ) from error
    inputs: list[Any] = [_FORMAT, [(file.st_size, file.st_mtime_ns) for file in files], source.kind]
    inputs += [source.max_width, source.response.model_dump(mode="json")]
    inputs += [[sensor.model_dump(mode="json") for sensor in source.sensors]]
    return hashlib.sha256(json.dumps(inputs).encode()).hexdigest()[:32]


@dataclass(frozen=True, eq=False)
class StoredPlanes:
    """Planes in a file. uniform: masks that say everywhere the same; source: what it was made of."""

    path: Path
    shape: tuple[int, ...]
    transparent: bool
    uniform: dict[str, bool]
    source: ShotSource

    @property
    def held(self) -> bool:
        """Always False."""
        return False

    @property
    def pixels(self) -> Array32:
        """Read at each look, as all of them."""
        plane: Array32 = self._read("pixels", lambda file: _decoded(file, "pixels"))
        return plane

    @property
    def alpha(self) -> Array32 | None:
        """Alpha, or None."""
        return self._read("alpha", lambda file: _decoded(file, "alpha")) if self.transparent else None

    @property
    def saturated(self) -> Mask:
        """Mask of pixels that are lower bounds."""
        return self._mask("saturated")

    @property
    def dark(self) -> Mask:
        """Mask of pixels that are upper bounds."""
        return self._mask("dark")

    @property
    def valid(self) -> Mask:
        """Mask of pixels with data."""
        return self._mask("valid")

    def _mask(self, name: str) -> Mask:
        if name in self.uniform:
            return np.broadcast_to(np.bool_(self.uniform[name]), self.shape)
        count = int(np.prod(self.shape))

        def unpacked(file: Any) -> Mask:
            return np.unpackbits(file[name], count=count).view(bool).reshape(self.shape)

        plane: Mask = self._read(name, unpacked)
        return plane

    def _read(self, name: str, read: Callable[[Any], Any]) -> Any:
        try:
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                plane = read(file)
            if plane.shape[:2] != self.shape[:2]:
                raise ValueError(f"{name} has another shape")
            return plane
        except _DAMAGE:
            return getattr(_written(self.path, self.source)[0], name)


def read_stored(folder: Path, source: ShotSource, k: float) -> tuple[Shot, Cfa | None]:
    """The shot of a file, kept in `folder` and not in memory, and the CFA of its mosaic if it is one.

    folder: SESSION/decoded. Decoded only where it is not there yet. StorageError where the disk refuses.
    """
    place = _place(folder, source.max_width) / source.name
    path = place / f"{key_of(source)}.npz"
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            facts = json.loads(bytes(file["facts"]))
        return _shot(path, source, k, facts)
    except _DAMAGE:
        _, facts = _written(path, source)
    for old in place.glob("*.npz"):  # of another calibration, or another state of the file
        if old != path:
            store.discard(old)
    return _shot(path, source, k, facts)


def require_room(folder: Path, max_width: int | None, samples: Iterable[tuple[View, int]]) -> None:
    """StorageError unless the disk has room for all views of that width; samples: one, and how many alike."""
    need = 0
    for view, count in samples:
        files = [shot.planes.path for shot in view.shots if isinstance(shot.planes, StoredPlanes)]
        need += count * sum(file.stat().st_size for file in files)
    room = shutil.disk_usage(folder).free
    room += sum(file.stat().st_size for file in _place(folder, max_width).rglob("*.npz"))
    if need > room:
        raise StorageError(
            f"{folder} takes {memory.text(need)} for images that memory does not hold, where "
            f"{memory.text(room)} are free: free some of the disk, or give a smaller --set width=."
        )


def _place(folder: Path, max_width: int | None) -> Path:
    return folder / (f"{max_width} px" if max_width else "whole")


def _shot(path: Path, source: ShotSource, k: float, facts: dict[str, Any]) -> tuple[Shot, Cfa | None]:
    """The shot that a file holds, by its `facts`."""
    noise: Noise | None = code_noise(source.response) if source.kind == "ldr" else None
    if facts["noise"] is not None:
        slope, floor, shares = facts["noise"]
        noise = SensorSignalNoise(slope, floor, None if shares is None else tuple(shares))
    planes = StoredPlanes(path, tuple(facts["shape"]), facts["transparent"], facts["uniform"], source)
    cfa = None if facts["cfa"] is None else Cfa.of(facts["cfa"])
    return Shot(source.name, k, planes, noise, facts["ceiling"]), cfa


def _written(path: Path, source: ShotSource) -> tuple[Planes, dict[str, Any]]:
    """Decode a shot into a file; its planes, and the facts in the file."""
    if key_of(source) != path.stem:
        raise InputError(f"{source.path} was changed while it was in use: run again.")
    shot, cfa = source.decoded(1.0)
    planes, noise = shot.planes, shot.noise
    arrays = _encoded("pixels", planes.pixels)
    if planes.alpha is not None:
        arrays |= _encoded("alpha", planes.alpha)
    uniform = {}
    for name in _MASKS:
        mask = getattr(planes, name)
        if bytes_of(mask):
            arrays[name] = np.packbits(mask)
        else:
            uniform[name] = bool(mask.flat[0])
    facts = {
        "shape": planes.shape,
        "transparent": planes.transparent,
        "uniform": uniform,
        "ceiling": shot.ceiling,
        "cfa": None if cfa is None else str(cfa),
        "noise": [noise.slope, noise.floor, noise.shares] if isinstance(noise, SensorSignalNoise) else None,
    }
    arrays["facts"] = np.frombuffer(json.dumps(facts).encode(), np.uint8)
    unique = path.with_name(f"{path.stem}.{os.getpid()}")  # several processes may come to the same shot
    try:
        with store.replacing(unique) as part, part.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        unique.replace(path)
    except OSError as error:
        raise store.refused(path, error) from error
    return planes, facts


@np.errstate(all="ignore")
def _encoded(name: str, values: Array32) -> dict[str, AnyArray]:
    """Codes of the fewest bits with their table of values, else the values themselves."""
    low, high = values.min(), values.max()
    for kind in (np.uint8, np.uint16):
        last = np.iinfo(kind).max
        scale = last / (high - low) if high > low else np.float32(0)
        if not np.isfinite([low, high, scale]).all():
            break
        for part in (values.reshape(-1)[:: max(values.size // _TRIED, 1)], values):
            codes = np.rint((part - low) * scale).clip(0, last).astype(kind)
            table = np.zeros(last + 1, np.float32)
            table[codes] = part
            # By their bits: a negative zero is one.
            if not np.array_equal(table[codes].view(np.uint32), np.ascontiguousarray(part).view(np.uint32)):
                break
        else:
            return {name: codes, f"{name} table": table}
    return {name: values}


def _decoded(file: Any, name: str) -> Array32:
    """The values that `_encoded` was given."""
    stored = file[name]
    return np.asarray(stored if stored.dtype == np.float32 else file[f"{name} table"][stored], np.float32)
