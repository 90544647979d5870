"""Calibration on a page: cameras, scene points, and their residuals."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from imaging.arrays import Array, Array32, Bytes
from imaging.files.colmap import read_model
from imaging.optics.lens import Lens
from imaging.optics.pose import as_held, upwards
from imaging.session.calibration import CalibrationRecord
from imaging.session.view_id import ViewId
from rig.report.charts.residuals import read_residuals
from rig.view.pictures.photographs import Photographs
from rig.view.serving.start_view import Start, overview, start_at

MOST_POINTS = 100_000
WORST = 12
"""Views whose residuals are listed."""


@dataclass(frozen=True, eq=False)
class RigModel:
    """Rig in page coordinates: the origin amid the cameras, the scene's points about 1 away.

    poses: cam_from_world [4, 4] by view; lenses: by view; both are those of upright pictures. points: float32
    [P, 3], with colours uint8 [P, 3]; residuals: root mean square by view, px.
    """

    record: CalibrationRecord
    poses: dict[ViewId, Array]
    lenses: dict[ViewId, Lens]
    points: Array32
    colours: Bytes
    residuals: dict[ViewId, float]

    @classmethod
    def of(cls, photographs: Photographs) -> "RigModel | None":
        """Read the folder of a session with photographs; None without any pose."""
        record = photographs.calibration
        if record is None:
            return None
        of_cameras = {camera.name: camera.lens for camera in record.cameras if camera.lens is not None}
        poses, lenses = {}, {}
        for view in record.views:
            if view.camera in of_cameras:
                orientation = photographs.orientation(view.id)
                poses[view.id] = as_held(view.cam_from_world.matrix(), orientation)
                lenses[view.id] = of_cameras[view.camera].as_held(orientation)
        if not poses:
            return None
        colmap = photographs.session.folder / "calibration" / "colmap"
        points, colours = (
            _points(colmap) if colmap.is_dir() else (np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
        )
        centres = np.array([-pose[:3, :3].T @ pose[:3, 3] for pose in poses.values()])
        origin = np.median(centres, axis=0)
        far = np.linalg.norm((points if len(points) else centres) - origin, axis=1)
        unit = float(np.median(far)) or 1.0
        for pose in poses.values():
            pose[:3, 3] = (pose[:3, :3] @ origin + pose[:3, 3]) / unit
        placed = ((points - origin) / unit).astype(np.float32)
        return cls(record, poses, lenses, placed, colours, read_residuals(colmap).views)

    def start(self, view: ViewId | None = None) -> Start:
        """Return the place of a view; None: a place that overlooks all cameras, behind and above them."""
        if view is not None:
            return start_at(self.poses[view], upwards(list(self.poses.values())), self.lenses[view])
        return overview(list(self.poses.values()))

    def words(self) -> str:
        """Markdown: how many views have a pose, what is doubted, and which views agree least."""
        record = self.record
        lines = [f"{len(self.poses)} views with a pose, {record.points} scene points"]
        if record.reprojection_px is not None:
            lines.append(f"reprojection error **{record.reprojection_px:.3g} px** in the mean")
        if record.unregistered:
            lines.append("without a pose: " + ", ".join(map(str, record.unregistered)))
        lines += [f"**doubt**: {doubt}" for doubt in record.doubts]
        text = "  \n".join(lines)
        worst = sorted(self.residuals.items(), key=lambda item: -item[1])[:WORST]
        if worst:
            rows = "".join(f"| {view} | {rms:.3g} |\n" for view, rms in worst)
            text += f"\n\n| view | residual, px |\n|---|---|\n{rows}"
        return text


def _points(colmap: Path) -> tuple[Array, Bytes]:
    model = read_model(colmap)
    points = list(model.points3D.values())
    points = points[:: max(1, -(-len(points) // MOST_POINTS))]
    xyz = np.array([point.xyz for point in points], np.float64).reshape(-1, 3)
    return xyz, np.array([point.color for point in points], np.uint8).reshape(-1, 3)
