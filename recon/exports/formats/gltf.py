"""glTF with `KHR_gaussian_splatting`, as one binary file (.glb).

Colours are display-referred by the extension: sRGB codes, or, on request, linear light whose white is that of
a display at the exposure, not clipped. All numbers are float32. Programs that do not know the extension show
the Gaussians as coloured points. glTF has y up and metres.
https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos/KHR_gaussian_splatting
"""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from imaging.arrays import AnyArray
from imaging.files import store
from imaging.files.exr.writing import EXPOSURE_FACTOR
from recon.data.world import Vector
from recon.exports.job import Job, Written
from recon.exports.splats import Splats
from recon.exports.target_coordinates import Place

EXTENSION = "KHR_gaussian_splatting"
_FLOAT, _BYTE = 5126, 5121
_ARRAY_BUFFER = 34962
_POINTS = 0
_Y_FROM_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def write(job: Job) -> Written:
    """Write the file, as a writer of `rig export`."""
    splats = job.splats()
    store.write_bytes(job.out, packed_splats(splats, job.place, job.exposure_factor, job.scene.left_out))
    notes = (
        ()
        if job.place.metres
        else ("the unit of length, which glTF takes for metres, without a measurement",)
    )
    return Written([job.out], splats.in_single(), splats if splats.linear else None, notes)


@dataclass
class _Buffer:
    """The arrays of a file, one behind the other, and what glTF says of them."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, values: AnyArray, **facts: Any) -> int:
        """Append [N] or [N, C], float32 or normalised uint8; the number of its accessor."""
        kind = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[1 if values.ndim == 1 else values.shape[1]]
        raw = np.ascontiguousarray(values).tobytes()
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(raw), "target": _ARRAY_BUFFER}
        self.data += raw + b"\0" * (-len(raw) % 4)
        component = _FLOAT if values.dtype == np.float32 else _BYTE
        if component == _BYTE:
            facts["normalized"] = True
        accessor = {"bufferView": len(self.views), "componentType": component, "count": len(values)}
        self.views.append(view)
        self.accessors.append(accessor | {"type": kind} | facts)
        return len(self.accessors) - 1


def packed_splats(splats: Splats, place: Place, exposure_factor: float, offset: Vector) -> bytes:
    """The file of some Gaussians; offset: what it says to add to their coordinates."""
    buffer = _Buffer()
    means = splats.means.astype(np.float32)
    # Vertex colours of glTF are linear, whatever those of the splats are.
    points = np.column_stack([(splats.light * splats.factor).clip(0, 1), splats.opacities])
    attributes = {
        "POSITION": buffer.add(means, min=means.min(0).tolist(), max=means.max(0).tolist()),
        "COLOR_0": buffer.add(np.round(255 * points).astype(np.uint8)),
        f"{EXTENSION}:ROTATION": buffer.add(splats.quats[:, [1, 2, 3, 0]].astype(np.float32)),
        f"{EXTENSION}:SCALE": buffer.add(splats.scales.astype(np.float32)),
        f"{EXTENSION}:OPACITY": buffer.add(splats.opacities.astype(np.float32)),
    }
    first = 0
    for degree in range(splats.degree + 1):
        for number in range(2 * degree + 1):
            values = splats.harmonics[:, first + number].astype(np.float32)
            attributes[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{number}"] = buffer.add(values)
        first += 2 * degree + 1
    turn = _Y_FROM_Z @ place.turn if place.z_up else place.turn
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    space = "lin_rec709_display" if splats.linear else "srgb_rec709_display"
    kernel = {
        "kernel": "ellipse",
        "colorSpace": space,
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    primitive = {"attributes": attributes, "mode": _POINTS, "extensions": {EXTENSION: kernel}}
    document = {
        "asset": {"version": "2.0", "generator": "rig"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "splats", "mesh": 0, "matrix": matrix.T.ravel().tolist()}],
        "meshes": [{"primitives": [primitive], "extras": _facts(splats, place, exposure_factor, offset)}],
        "buffers": [{"byteLength": len(buffer.data)}],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(document, allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(buffer.data), b"BIN\0") + bytes(buffer.data)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _facts(splats: Splats, place: Place, exposure_factor: float, offset: Vector) -> dict[str, Any]:
    """Return what the numbers are."""
    return {
        EXPOSURE_FACTOR: exposure_factor,
        "rig:coordinates": place.note,
        "rig:lengthUnit": "m" if place.metres else "unknown",
        "rig:offset": list(offset),
    }
