"""A move from one photograph's place to another's, written as EXR with the median at middle grey.

python examples/camera_move.py SCENE OUT [FRAMES]
"""

import dataclasses
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

import rig

scene, out = rig.open_scene(sys.argv[1]), Path(sys.argv[2])
frames = int(sys.argv[3]) if len(sys.argv) > 3 else 48
out.mkdir(parents=True)
camera = scene.views[0].splat_camera
world_from_cam = [
    np.linalg.inv(view.splat_camera.cam_from_world) for view in (scene.views[0], scene.views[-1])
]
turn = Slerp([0, 1], Rotation.from_matrix([pose[:3, :3] for pose in world_from_cam]))
for frame, share in enumerate(np.linspace(0, 1, frames)):
    pose = np.eye(4)
    pose[:3, :3] = turn(share).as_matrix()
    pose[:3, 3] = (1 - share) * world_from_cam[0][:3, 3] + share * world_from_cam[1][:3, 3]
    light = scene.render(dataclasses.replace(camera, cam_from_world=np.linalg.inv(pose)))
    rig.write_exr(out / f"move.{frame:04d}.exr", light * scene.exposure)
