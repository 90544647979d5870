"""The calibration in the formats of other programs, written beside calibration.json.

* `transforms.json` (nerfstudio, Instant NGP) names the pictures in previews/ (sRGB, 8 bits, of one exposure),
  and the lenses are those of that size; `sparse_pc.ply` holds the scene points in the same world, for
  trainers that start from them.
* `opencv/<camera>.yaml` (cv2.FileStorage): pixel centres at whole numbers, so `c` is half a pixel less. A
  lens of the `distortion_model` fisheye is for cv2.fisheye.
* `camchain-<rig>.yaml` (Kalibr): each camera from the one before it; pixel centres as OpenCV's.

A COLMAP model has a folder of its own, colmap/.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imaging.files.nerfstudio import Picture, transforms
from imaging.files.opencv_lens import HALF, write_opencv_lens
from imaging.optics.lens import Lens
from imaging.session.calibration import CalibrationRecord, CameraCalibration
from imaging.session.records import CameraRecord

_POINTS = "sparse_pc.ply"
"""File name of the points, as ns-process-data has it."""
_COLOURS = ("red", "green", "blue")


def write_exports(
    folder: Path,
    record: CalibrationRecord,
    cameras: Sequence[CameraRecord],
    pictures: Mapping[str, Lens],
    model: Any = None,
) -> None:
    """Write every export that the calibration allows into `folder`.

    Args:
        folder: Existing folder, without an `opencv` folder in it.
        record: Calibration.
        cameras: Cameras of the session, whose `rig` says what is mounted together.
        pictures: Lens of each camera at the size of its previews, by name.
        model: COLMAP model, whose points go with transforms.json; None: no points are written.

    Raises:
        OSError, StorageError: The disk refuses.
    """
    known = [camera for camera in record.cameras if camera.lens is not None]
    if record.views:
        transforms = _transforms(record, pictures)
        if model is not None and model.points3D:
            (folder / _POINTS).write_bytes(_ply(model, record.coordinate_note))
            transforms = {"ply_file_path": _POINTS, **transforms}
        text = json.dumps(transforms, indent=1, allow_nan=False)
        (folder / "transforms.json").write_text(f"{text}\n", encoding="utf-8")
    if known:
        (folder / "opencv").mkdir()
    for camera in known:
        assert camera.lens is not None
        mounted_at = None if camera.cam_from_rig is None else camera.cam_from_rig.matrix()
        write_opencv_lens(folder / "opencv" / f"{camera.name}.yaml", camera.lens, mounted_at)
    mounted = {camera.name: camera.rig for camera in cameras if camera.rig is not None}
    for rig in dict.fromkeys(mounted.values()):
        chain = [c for c in known if mounted.get(c.name) == rig and c.cam_from_rig is not None]
        if len(chain) > 1:
            name = re.sub(r"[^A-Za-z0-9_.-]", "_", rig)
            (folder / f"camchain-{name}.yaml").write_text(_camchain(chain), encoding="utf-8")


def _transforms(record: CalibrationRecord, pictures: Mapping[str, Lens]) -> dict[str, Any]:
    shown = [
        Picture(f"previews/{view.id.image_name}", pictures[view.camera], view.cam_from_world.matrix())
        for view in record.views
    ]
    return transforms(shown, _coordinates(record))


def _coordinates(record: CalibrationRecord) -> dict[str, Any]:
    """Return what the poses are in."""
    known = record.coordinates
    if known is None:
        return {"unit": record.unit, "system": "own"}
    placed = known.model_dump(mode="json", include={"system", "offset", "origin"})
    return {"unit": record.unit, **placed}


def _ply(model: Any, note: str) -> bytes:
    """The points of a COLMAP model with their colours as binary PLY; note: what coordinates they are in."""
    points = [model.points3D[number] for number in sorted(model.points3D)]
    table = np.empty(len(points), [*((axis, "<f4") for axis in "xyz"), *((c, "u1") for c in _COLOURS)])
    for column, axis in enumerate("xyz"):
        table[axis] = [point.xyz[column] for point in points]
    for column, colour in enumerate(_COLOURS):
        table[colour] = [point.color[column] for point in points]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment coordinates: {note}",
        f"element vertex {len(points)}",
        *(f"property float {axis}" for axis in "xyz"),
        *(f"property uchar {colour}" for colour in _COLOURS),
        "end_header",
    ]
    return "\n".join([*header, ""]).encode() + table.tobytes()


def _camchain(chain: Sequence[CameraCalibration]) -> str:
    """YAML as Kalibr writes it: https://github.com/ethz-asl/kalibr/wiki/yaml-formats."""
    lines = []
    before = None
    for number, camera in enumerate(chain):
        lens, pose = camera.lens, camera.cam_from_rig
        assert lens is not None
        assert pose is not None
        here = pose.matrix()
        lines += [f"cam{number}:", f"  # {camera.name}, serial number {camera.serial}"]
        if before is not None:
            lines.append("  T_cn_cnm1:")
            lines += [f"  - {_listed(row)}" for row in (here @ np.linalg.inv(before)).tolist()]
        lines += [
            "  camera_model: pinhole",
            f"  distortion_coeffs: {_listed(lens.terms[4:])}",
            f"  distortion_model: {'equidistant' if lens.fisheye else 'radtan'}",
            f"  intrinsics: {_listed([lens.fx, lens.fy, lens.cx - HALF, lens.cy - HALF])}",
            f"  resolution: {[lens.width, lens.height]}",
            f"  rostopic: /{camera.name}/image_raw",
        ]
        before = here
    return "\n".join(lines) + "\n"


def _listed(numbers: Sequence[float]) -> str:
    """A list as YAML 1.1 reads it: a number with an exponent needs a point, or it is a string."""
    return "[" + ", ".join(re.sub(r"^(-?\d+)e", r"\1.0e", repr(float(one))) for one in numbers) + "]"
