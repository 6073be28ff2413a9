"""Draw splats from a scene's own camera: side by side, or one after another as a film (animated WebP).

python scripts/turning.py OUT.jpg|OUT.webp SCENE SPLAT...
"""

import sys

import imageio.v3 as iio
import numpy as np

from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats

WIDTH, HEIGHT, FINER = 480, 360, 2
BEHIND = 0.2
"""Grey where no splat is."""

FRAME_MS, QUALITY = 160, 85


def picture(splat, view):
    """(HEIGHT, WIDTH, 3) uint8 of a splat file."""
    seen = rasterize(read_splats(splat), view)
    image = np.clip(seen.color + BEHIND * (1 - seen.alpha[..., None]), 0, 1)
    image = image.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean(axis=(1, 3))
    return (image * 255).astype(np.uint8)


def main(out, scene, *splats):
    """Write the picture or the film."""
    scene = Scene.load(scene)
    turn, camera = np.array(scene.scene_from_splat)[:3, :3], scene.preview_camera
    eye, target, up = (turn.T @ np.array(camera[key]) for key in ("eye", "target", "up"))
    view = View.look_at(eye, target, up, camera["fov_deg"], FINER * WIDTH, FINER * HEIGHT)
    pictures = [picture(splat, view) for splat in splats]
    if out.endswith(".webp"):
        iio.imwrite(out, np.stack(pictures), duration=FRAME_MS, loop=0, quality=QUALITY)
    else:
        iio.imwrite(out, np.concatenate(pictures, axis=1), quality=QUALITY)


if __name__ == "__main__":
    main(*sys.argv[1:])
