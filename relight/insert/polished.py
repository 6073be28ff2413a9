"""Objects over a floor that mirrors in the splats: what it shows in a new light, and images of them below it."""

from typing import TYPE_CHECKING

import numpy as np

from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

from ..splats.floor_mirror import LEVEL, FloorMirror
from ..splats.mirrored_places import mirrored_splats, plane_of

if TYPE_CHECKING:
    from .inserts import InsertedLight

AROUND = 3.0
"""How far from an object the floor counts for the light on it, in radii of the object."""


def floor_under(mirror: FloorMirror, light: "InsertedLight", exposure: float) -> FloorMirror:
    """The floor with the radiance that it sends of itself near objects in a new light, as displayed.

    exposure: units of the picture per unit of the light's radiance.
    """
    scene, before = light.inserts.relighter.scene, light.inserts.look.irradiance
    if before is None:
        return mirror
    floor = np.abs(scene.vertices @ mirror.normal - mirror.offset) < mirror.margin
    floor &= scene.normals @ mirror.normal > LEVEL
    near, frame = np.zeros_like(floor), light.standing.frame
    points = frame.unit(scene.vertices)
    for middle, radius in light.standing.spheres:
        near |= np.linalg.norm(points - middle, axis=1) < AROUND * radius
    rows = np.flatnonzero(floor & near) if (floor & near).any() else np.flatnonzero(floor)
    if not len(rows):
        return mirror
    of_light = light.received[rows].mean(axis=0, dtype=np.float64) * exposure
    return mirror._replace(own=mirror.own * of_light / np.maximum(before[rows].mean(axis=0, dtype=np.float64), 1e-6))


def images_of(splats: Splats, floor: FloorMirror, scene: Scene) -> Splats:
    """What a floor shows of splats of objects above it: dimmer, below it. floor: of `floor_under`."""
    normal, offset, _ = plane_of(floor, scene)
    depth = offset - splats.means.astype(np.float64) @ normal
    rows = np.flatnonzero(depth < 0.0)
    some = splats.take(rows)
    image = mirrored_splats(some, normal, depth[rows])
    color = linear_from_srgb(np.clip(0.5 + SH_C0 * some.sh[:, 0], 0.0, 1.0).astype(np.float32))
    sh = np.zeros_like(some.sh)
    shown = np.clip(floor.own + floor.reflectance * color, 0.0, 1.0).astype(np.float32)
    sh[:, 0] = (srgb_from_linear(shown) - 0.5) / SH_C0
    return Splats(image.means, image.scales, image.quats_wxyz, image.opacities, sh)
