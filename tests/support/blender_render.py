"""Run by a Python that has bpy: renders live.glb by the Blender add-on. Arguments: the add-on's folder, one JSON of
glb, camera (position, world_from_camera rows, fov_deg), width, height, and shots: list of angle, exposure, file.

Files are .npy, (H, W, 4) float32: linear, what Cycles gives, rows from the top.
"""

import json
import sys

import bpy
import numpy as np

sys.path.insert(0, sys.argv[1])
import relight_light

job = json.loads(sys.argv[2])
bpy.ops.wm.read_factory_settings(use_empty=True)
relight_light.register()
relight_light.load(job["glb"])
scene = bpy.context.scene
camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
scene.camera = camera
camera.data.angle, camera.data.clip_start = np.radians(job["camera"]["fov_deg"]), 0.001
camera.data.sensor_fit = "HORIZONTAL"
camera.matrix_world = np.array(job["camera"]["world_from_camera"]).T.tolist()
render = scene.render
render.engine, render.film_transparent = "CYCLES", True
render.resolution_x, render.resolution_y, render.resolution_percentage = job["width"], job["height"], 100
scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 16, False, 0
scene.cycles.filter_width, scene.cycles.use_adaptive_sampling = 0.01, False
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
for angle, exposure, file in job["shots"]:
    scene[relight_light.ANGLE], scene[relight_light.EXPOSURE] = angle, exposure
    scene.update_tag()
    render.filepath = file + ".exr"
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(file + ".exr")
    pixels = np.empty(job["width"] * job["height"] * 4, np.float32)
    image.pixels.foreach_get(pixels)
    np.save(file, pixels.reshape(job["height"], job["width"], 4)[::-1])
