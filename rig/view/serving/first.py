"""The first picture of a scene: one that it drew when it was evaluated, shown while the scene is opened.

To open a scene takes torch and its Gaussians, some seconds in all; a page with a picture takes none of it.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imaging.arrays import Array32
from imaging.errors import RigError
from imaging.files.exr.reading import read_exr
from imaging.optics.lens import Lens
from imaging.optics.pose import Pose, as_held, picture_as_held, upwards
from recon.result.first_look import shot_at
from rig.view.pictures.look import Look, first_look
from rig.view.serving.start_view import Start, start_at


@dataclass(frozen=True, eq=False)
class FirstPicture:
    """light: linear Rec.709 [H, W, 3], upright; exposure: factor that shows its scene's median as middle
    grey; view: name of the view that it is of, `frame/camera`; start: where that stands; look: how it is
    shown.
    """

    light: Array32
    exposure: float
    view: str
    start: Start
    look: Look

    @classmethod
    def of(cls, folder: Path) -> "FirstPicture | None":
        """Read the picture of a reconstruction's folder; None without one.

        model.json is read as far as that needs: what is wrong with it is said by who opens the scene.
        """
        try:
            model = json.loads((folder / "model.json").read_bytes())
            views = model["views"]
            for view in views:
                path = folder / "renders" / f"{view['frame']:04d}_{view['camera']}.exr"
                if path.is_file():
                    light = picture_as_held(read_exr(path).rgb(), view.get("orientation", 1))
                    name = f"{view['frame']:04d}/{view['camera']}"
                    exposure = float(model["exposure"])
                    shots = [[(one["file"], float(one["k"])) for one in view["shots"]] for view in views]
                    look = first_look(exposure, shot_at(shots))
                    return cls(light, exposure, name, _start(model, view), look)
        except (OSError, ValueError, KeyError, TypeError, RigError):
            pass
        return None


def _start(model: dict[str, Any], view: dict[str, Any]) -> Start:
    """A view of the model in the coordinates of its scene."""
    poses = [
        as_held(Pose.model_validate(one["cam_from_world"]).matrix(), one.get("orientation", 1))
        for one in model["views"]
    ]
    motion = Pose.model_validate(view["cam_from_world"]).matrix()
    world = model["world"]
    motion[:3, 3] = (motion[:3, :3] @ np.asarray(world["origin"]) + motion[:3, 3]) / world["unit"]
    lens = Lens.model_validate(view["lens"]).as_held(view.get("orientation", 1))
    return start_at(motion, upwards(poses), lens)
