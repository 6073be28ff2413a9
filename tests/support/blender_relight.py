"""Run by a Python that has bpy: the add-on from import to result. Arguments: its folder, JSON of scene, command, out.

Writes bounds of the captured and the relit mesh, which collections are hidden, mean linear colours of the relit one on
either side, and what Cycles renders of the relit mesh from +x beside the mean of the vertices there.
"""

import json
import os
import sys

import bpy
import numpy as np

sys.path.insert(0, sys.argv[1])
import relight_scene

job = json.loads(sys.argv[2])
os.environ["RELIGHT_COMMAND"] = job["command"]
bpy.ops.wm.read_factory_settings(use_empty=True)
before = len(bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize())
relight_scene.register()
relight_scene.unregister()
relight_scene.register()


def bounds(objects):
    points = np.vstack([[each.matrix_world @ v.co for v in each.data.vertices] for each in objects])
    return [points.min(axis=0).tolist(), points.max(axis=0).tolist()]


scene = bpy.context.scene
assert bpy.ops.import_scene.relight(filepath=job["scene"]) == {"FINISHED"}
captured = list(scene.collection.children[0].objects)
for name, kind, energy in (("bulb", "POINT", 100.0), ("sun", "SUN", 2.0)):
    lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, kind))
    lamp.data.energy = energy
    lamp.location, lamp.rotation_euler = (4.0, 0.0, 0.0), (0.0, np.pi / 2, 0.0)  # towards the sun is its +z: +x
    scene.collection.objects.link(lamp)
bpy.context.view_layer.update()
scene.relight.light = "LAMPS"
assert bpy.ops.scene.relight() == {"FINISHED"}
shown = list(scene.collection.children[1].objects)
meshes = [each for each in shown if each.type == "MESH"]
assert len([each for each in scene.objects if each.type == "LIGHT"]) == 2
found = {"captured": bounds(captured), "relit": bounds(meshes)}
found["hidden"] = [each.hide_render for each in scene.collection.children]
points, colors = [], []
for each in meshes:
    layer = each.data.color_attributes[0]
    values = np.empty(4 * len(layer.data), np.float32)
    layer.data.foreach_get("color", values)
    places = np.array([each.matrix_world @ v.co for v in each.data.vertices])
    if layer.domain == "CORNER":
        places = places[[loop.vertex_index for loop in each.data.loops]]
    points.append(places)
    colors.append(values.reshape(-1, 4)[:, :3])
points, colors = np.vstack(points), np.vstack(colors)
found["lit_side"], found["other_side"] = (float(colors[side * points[:, 0] > 0.5].mean()) for side in (1, -1))

camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
camera.data.type, camera.data.ortho_scale = "ORTHO", 0.4
camera.location, camera.rotation_euler = (3.0, 0.0, 0.0), (np.pi / 2, 0.0, np.pi / 2)
scene.collection.objects.link(camera)
for each in [each for each in scene.objects if each.type == "LIGHT"]:
    each.hide_render = True
scene.camera, render = camera, scene.render
render.engine, render.resolution_x, render.resolution_y = "CYCLES", 16, 16
scene.cycles.samples, scene.cycles.use_denoising = 16, False
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
render.filepath = job["out"] + ".exr"
bpy.ops.render.render(write_still=True)
pixels = np.array(bpy.data.images.load(render.filepath).pixels[:]).reshape(-1, 4)
found["rendered"] = pixels[:, :3].mean(axis=0).tolist()
near = (points[:, 0] > 0.0) & (np.abs(points[:, 1:]).max(axis=1) < 0.2)
found["expected"] = colors[near].mean(axis=0).tolist()

relight_scene.unregister()
assert not hasattr(bpy.types.Scene, "relight") and not hasattr(bpy.types, "RELIGHT_PT_scene")
assert len(bpy.types.TOPBAR_MT_file_import._dyn_ui_initialize()) == before
with open(job["out"], "w") as file:
    json.dump(found, file)
