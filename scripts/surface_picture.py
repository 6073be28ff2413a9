"""Draw a splat, the mesh that splat2mesh made of it, and the normals of that mesh, side by side.

python scripts/surface_picture.py OUT.jpg SCENE SPLAT
"""

import sys

import imageio.v3 as iio
import numpy as np

from draw import BEHIND, FINER, HEIGHT, QUALITY, WIDTH, picture
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene


def main(out, folder, splat):
    """Write the picture."""
    scene = Scene.load(folder)
    turn, camera = np.array(scene.scene_from_splat)[:3, :3], scene.preview_camera
    eye, target, up = (turn.T @ np.array(camera[key]) for key in ("eye", "target", "up"))
    view = View.look_at(eye, target, up, camera["fov_deg"], FINER * WIDTH, FINER * HEIGHT)
    rays = view.ray_directions()
    rays = np.concatenate([np.broadcast_to(view.center, rays.shape), rays], axis=-1)
    hits = RayCaster(scene.vertices @ turn, scene.faces).first_hits(rays)
    corners = scene.faces[np.maximum(hits.faces, 0)]
    weights = np.stack([1 - hits.uv.sum(axis=-1), hits.uv[..., 0], hits.uv[..., 1]], axis=-1)[..., None]
    pictures = [picture(splat, view)]
    for values in (scene.colors_srgb / 255.0, scene.normals / 2 + 0.5):
        shown = (values[corners] * weights).sum(axis=-2)
        shown[hits.faces < 0] = BEHIND
        shown = shown.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean(axis=(1, 3))
        pictures.append((np.clip(shown, 0, 1) * 255).astype(np.uint8))
    iio.imwrite(out, np.concatenate(pictures, axis=1), quality=QUALITY)


if __name__ == "__main__":
    main(*sys.argv[1:])
