"""Files of Nuke beside a hand-over: a .chan of each camera, and a script that reads plates through STMaps.

A .chan has a line a frame: its number, x y z, turns about x, y, z in degrees, applied in the order z, x, y
(Nuke's ZXY), and the angle from bottom to top, degrees. Axes are those of the USD stage.
"""

import re
from collections.abc import Sequence, Set
from itertools import groupby
from math import atan, degrees

from scipy.spatial.transform import Rotation

from recon.exports.target_coordinates import Place, in_stage
from recon.result.model import SceneView
from recon.result.scene import Scene

SCRIPT = "handover.nk"
_NOT_IN_NAMES = re.compile("[^A-Za-z0-9_]")
"""Characters that names of nodes cannot have, but names of cameras, such as canon-powershot-a10."""


def chan_files(scene: Scene, place: Place) -> dict[str, str]:
    """The text of CAMERA.chan by the name of the camera, of the cameras as USD has them."""
    views = sorted(scene.views, key=lambda view: (view.camera, view.frame))
    return {
        name: "".join(f"{_line(view, scene, place)}\n" for view in camera_views)
        for name, camera_views in groupby(views, key=lambda view: view.camera)
    }


def _line(view: SceneView, scene: Scene, place: Place) -> str:
    motion = in_stage(view, scene, place)
    # Turns about fixed axes, z first, are one about moving axes, y first.
    y, x, z = Rotation.from_matrix(motion[:3, :3]).as_euler("YXZ", degrees=True)
    angle = 2 * degrees(atan(view.lens.height / (2 * view.lens.fy)))
    return " ".join([str(view.frame), *(f"{part:.9g}" for part in (*motion[:3, 3], x, y, z, angle))])


def script(scene: Scene, cameras: Sequence[str]) -> str:
    """A script of Nuke beside which the folders of the hand-over lie; cameras: those with plates.

    Plates as shot go through the STMap that takes the lens out, renders through the one that puts it in.
    """
    every = [view.frame for view in scene.views]
    lines = [
        "Root {",
        " inputs 0",
        f" first_frame {min(every)}",
        f" last_frame {max(every)}",
        "}",
    ]
    for column, name in enumerate(cameras):
        frames = {view.frame for view in scene.views if view.camera == name}
        for row, (kind, picture, stmap) in enumerate(
            (("plate", "plates_as_shot", "undistort"), ("render", "renders", "redistort"))
        ):
            across, down = 300 * column, 400 * row
            # The last of the two is the first input, the picture.
            lens, node = f"lenses/{name}.{stmap}.exr", _NOT_IN_NAMES.sub("_", name)
            lines += _read(f"{stmap}_{node}", lens, {1}, (across + 110, down), raw=True)
            lines += _read(f"{kind}_{node}", f"{picture}/{name}.####.exr", frames, (across, down))
            lines += [
                "STMap {",
                " inputs 2",
                " channels rgba",
                " uv rgb",
                f" name {stmap}ed_{node}",
                f" xpos {across}",
                f" ypos {down + 150}",
                "}",
            ]
    return "\n".join(lines) + "\n"


def _read(name: str, file: str, frames: Set[int], place: tuple[int, int], *, raw: bool = False) -> list[str]:
    """Lines of a node; frames: those that there are, between which a comp is black rather than an error."""
    first, last = min(frames), max(frames)
    return [
        "Read {",
        " inputs 0",
        f' file "\\[file dirname \\[value root.name]]/{file}"',
        f" first {first}",
        f" last {last}",
        *([" on_error black"] if len(frames) <= last - first else []),
        *([" raw true"] if raw else []),
        f" name {name}",
        f" xpos {place[0]}",
        f" ypos {place[1]}",
        "}",
    ]
