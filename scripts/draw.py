"""Draw splats from one camera: side by side, or one after another as a film (animated WebP).

python scripts/draw.py OUT.jpg|OUT.webp (--scene FOLDER | --eye X,Y,Z --target X,Y,Z) [--fov DEG] SPLAT...

The camera is that of a scene folder, or one in the frame of generated scenes: +y up, metres.
"""

import argparse

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

GENERATED = np.diag([1.0, -1.0, -1.0])
"""Scene from splat, for scenes that `python -m scenes` wrote."""


def numbers(text):
    """Three numbers with commas between."""
    return np.array([float(part) for part in text.split(",")])


def camera_of(options):
    """The View that the command line asks for."""
    if options.scene:
        scene = Scene.load(options.scene)
        turn, camera = np.array(scene.scene_from_splat)[:3, :3], scene.preview_camera
        eye, target, up, fov = camera["eye"], camera["target"], camera["up"], camera["fov_deg"]
    else:
        turn, eye, target, up, fov = GENERATED, options.eye, options.target, [0, 1, 0], options.fov
    eye, target, up = (turn.T @ np.array(each) for each in (eye, target, up))
    return View.look_at(eye, target, up, options.fov or fov, FINER * WIDTH, FINER * HEIGHT)


def picture(splat, view):
    """(HEIGHT, WIDTH, 3) uint8 of a splat file."""
    seen = rasterize(read_splats(splat), view)
    image = np.clip(seen.color + BEHIND * (1 - seen.alpha[..., None]), 0, 1)
    image = image.reshape(HEIGHT, FINER, WIDTH, FINER, 3).mean(axis=(1, 3))
    return (image * 255).astype(np.uint8)


def main():
    """Write the picture or the film."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out")
    parser.add_argument("splats", nargs="+", metavar="SPLAT")
    parser.add_argument("--scene")
    parser.add_argument("--eye", type=numbers)
    parser.add_argument("--target", type=numbers)
    parser.add_argument("--fov", type=float)
    options = parser.parse_intermixed_args()
    view = camera_of(options)
    pictures = [picture(splat, view) for splat in options.splats]
    if options.out.endswith(".webp"):
        iio.imwrite(options.out, np.stack(pictures), duration=FRAME_MS, loop=0, quality=QUALITY)
    else:
        iio.imwrite(options.out, np.concatenate(pictures, axis=1), quality=QUALITY)


if __name__ == "__main__":
    main()
