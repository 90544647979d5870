"""Picture by Blender's Cycles of a PLY mesh that emits the radiance of its vertices, as EXR: `ASKED.json`."""

import json
import sys
from pathlib import Path

import bpy  # type: ignore[import-not-found]
from mathutils import Matrix  # type: ignore[import-not-found]

asked = json.loads(Path(sys.argv[1]).read_text())
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.ply_import(filepath=asked["file"], import_attributes=True, forward_axis="Y", up_axis="Z")
surface = bpy.context.object

glow = bpy.data.materials.new("glow")
glow.use_nodes = True
nodes, join = glow.node_tree.nodes, glow.node_tree.links.new
nodes.clear()
light, emission, out = (
    nodes.new(f"ShaderNode{kind}") for kind in ("CombineColor", "Emission", "OutputMaterial")
)
for channel in ("Red", "Green", "Blue"):
    one = nodes.new("ShaderNodeAttribute")
    one.attribute_name = f"radiance_{channel.lower()}"
    join(one.outputs["Fac"], light.inputs[channel])
join(light.outputs["Color"], emission.inputs["Color"])
join(emission.outputs["Emission"], out.inputs["Surface"])
surface.data.materials.clear()
surface.data.materials.append(glow)

camera = bpy.data.cameras.new("eye")
camera.lens, camera.sensor_width = asked["lens"], 36.0
camera.clip_start, camera.clip_end = 0.01, 1000.0
eye = bpy.data.objects.new("eye", camera)
eye.matrix_world = Matrix(asked["to_world"])
scene = bpy.context.scene
scene.collection.objects.link(eye)
scene.camera = eye
scene.render.engine = "CYCLES"
scene.cycles.samples, scene.cycles.max_bounces, scene.cycles.use_denoising = 4, 0, False
scene.render.resolution_x, scene.render.resolution_y = asked["size"]
scene.render.image_settings.file_format = "OPEN_EXR"
scene.render.image_settings.color_depth = "32"
scene.render.filepath = asked["out"]
bpy.ops.render.render(write_still=True)
