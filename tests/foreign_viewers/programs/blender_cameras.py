"""Pixels at which Blender's cameras see points, of a USD or Alembic file: `ASKED.json ANSWER.json`."""

import json
import sys
from pathlib import Path

import bpy  # type: ignore[import-not-found]
from bpy_extras.object_utils import world_to_camera_view  # type: ignore[import-not-found]
from mathutils import Vector  # type: ignore[import-not-found]

asked = json.loads(Path(sys.argv[1]).read_text())
bpy.ops.wm.read_factory_settings(use_empty=True)
if asked["file"].endswith(".abc"):
    bpy.ops.wm.alembic_import(filepath=asked["file"], as_background_job=False)
else:
    bpy.ops.wm.usd_import(filepath=asked["file"])
scene = bpy.context.scene
scene.render.resolution_x, scene.render.resolution_y = width, height = asked["size"]
cameras = [thing for thing in bpy.data.objects if thing.type == "CAMERA"]
if asked["file"].endswith(".abc"):
    for thing in cameras:  # as docs/export.md says; Blender would fit the film to the longer side
        thing.data.sensor_fit = "HORIZONTAL"
answer = {
    thing.name: {"lens": thing.data.lens, "sensor": thing.data.sensor_width, "frames": {}}
    for thing in cameras
}
for frame in asked["frames"]:
    scene.frame_set(frame)
    for thing in cameras:
        places = [world_to_camera_view(scene, thing, Vector(point)) for point in asked["points"]]
        answer[thing.name]["frames"][frame] = [(width * at.x, height * (1 - at.y)) for at in places]
Path(sys.argv[2]).write_text(json.dumps(answer))
