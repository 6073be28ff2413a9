"""Small generated rooms as scenes, with the light that radiosity knows."""

from functools import cache

import numpy as np

from relight import Environment
from scenes.places import build_place
from scenes.radiosity import light
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

VERTICES = 3000


@cache
def room(kind="closed-box", lamps=1.0, vertices=VERTICES):
    """(Scene as captured, Place, exposure, radiance (V, 3) with the lamps at a factor) of a hard place."""
    place = build_place(kind, 0, vertices)
    sky = Environment.load("overcast")
    radiance = light(place, sky).radiance()
    exposure = 0.8 / np.quantile(radiance[~place.emitted.any(axis=1)].max(axis=1), 0.98)
    eyes = np.asarray(place.walk(np.linspace(0.0, 1.0, 12, endpoint=False))[0], np.float64)
    colors = bytes_from_unit(srgb_from_linear(np.clip(radiance * exposure, 0.0, 1.0)))
    mesh = Mesh(place.vertices, place.normals, place.faces, colors)
    scene = Scene([mesh], capture={"from": "inside", "eyes": eyes.tolist(), "focal_px": 200.0})
    other = radiance if lamps == 1.0 else light(place, sky, lamps).radiance()
    return scene, place, exposure, exposure * other
