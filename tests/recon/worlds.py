"""Sessions in worlds of other units and origins."""

import json
from pathlib import Path

import numpy as np

from imaging.files.colmap import pycolmap
from imaging.optics.pose import Pose

UTM = (4.5e5, 5.41e6, 300.0)
ECEF = (4.1e6, 8.5e5, 4.8e6)


def put(session: Path, scale: float, shift: tuple[float, float, float]) -> None:
    """The calibration as it is in a world of another unit and origin; the files that say so are changed."""
    path = session / "calibration" / "calibration.json"
    record = json.loads(path.read_text())
    for view in record["views"]:
        motion = Pose(**view["cam_from_world"]).matrix()
        view["cam_from_world"]["translation"] = list(scale * motion[:3, 3] - motion[:3, :3] @ shift)
        if view.get("error"):
            view["error"]["translation"] *= scale
    path.write_text(json.dumps(record))
    folder = session / "calibration" / "colmap"
    model = pycolmap.Reconstruction(str(folder))
    model.transform(pycolmap.Sim3d(scale, pycolmap.Rotation3d(), np.array(shift)))
    model.write(str(folder))
