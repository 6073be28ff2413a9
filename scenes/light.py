"""The light of the capture day: radiance of every vertex under an environment, shadowed by the whole scene.

Every vertex looks in the same directions, drawn from the environment in proportion to its brightness. That omits
neither detail of the sky nor a small sun, and shares no step with the transfer it is compared to.
"""

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import luminance

from .splat import PLASTIC

DIRECTIONS = 512
"""Draws from the environment, a sun taking as many as its share of the light: errors of 0.5 to 1% on a tabletop."""

CLEARANCE = 1e-4
"""Offset of ray origins from the surface, in diagonals of the scene: smaller than any visible shadow."""

BLOCK = 4096
"""Vertices traced at a time: 2 million rays, 50 MB."""

WHITE_POINT, WHITE_PERCENTILE = 0.9, 98.0
"""Display value of this percentile of the brightest channel: a well-exposed photograph, hardly clipped."""


def bake(truth, environment, count=None):
    """Exit radiance of every vertex, without interreflection: (V, 3) float32, linear, not exposed.

    environment: relight.Environment. count: number of leading vertices to light, whose normals and albedos alone are
    needed; the others hide light. Raises InputError when it is black.
    """
    toward, light, _ = distant_lights(environment)
    caster = RayCaster(truth.vertices, truth.faces)
    diagonal = np.linalg.norm(np.ptp(truth.vertices, axis=0))
    origins = truth.vertices[:count] + np.float32(CLEARANCE * diagonal) * truth.normals
    irradiance = np.zeros_like(origins)
    for start in range(0, len(origins), BLOCK):
        block = slice(start, start + BLOCK)
        cosine = np.maximum(truth.normals[block] @ toward.T, 0.0)
        vertex, direction = np.nonzero(cosine)
        rays = np.hstack([origins[block][vertex], toward[direction]])
        cosine[vertex, direction] *= ~caster.occluded(rays)
        irradiance[block] = cosine @ light
    return truth.albedo_linear * irradiance / np.float32(np.pi)


def exposure(radiance):
    """The factor that exposes radiance, (V, 3), so that hardly any of it clips."""
    return WHITE_POINT / np.percentile(radiance.max(axis=1), WHITE_PERCENTILE)


def distant_lights(environment, count=DIRECTIONS):
    """Distant lights that replace the environment: unit directions and irradiances, (D, 3) float32, and texels (D,).

    count: how many draws; D are of different texels. Raises InputError when the environment is black.

    Importance sampling of texels by inversion, rows first, with a low-discrepancy sequence (Pharr, Jakob and
    Humphreys, "Physically Based Rendering", section 12.5).
    """
    height, width = environment.radiance.shape[:2]
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
    longitude = np.pi * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    lat, lon = (grid.ravel() for grid in np.meshgrid(latitude, longitude, indexing="ij"))
    texels = np.stack([np.sin(lon) * np.cos(lat), np.sin(lat), np.cos(lon) * np.cos(lat)], axis=1)
    power = environment.lookup(texels) * (np.cos(lat) * 2.0 * np.pi**2 / (height * width))[:, None]
    weight = luminance(power)
    reached = np.cumsum(weight)
    if reached[-1] == 0.0:
        raise InputError(f"{environment.name}: black, so nothing can be seen by it; expected an environment with light")
    row_end = reached[width - 1 :: width]
    first, second = ((np.arange(count) / PLASTIC**axis + 0.5) % 1.0 for axis in (1, 2))
    row = np.searchsorted(row_end, first * reached[-1])
    row_start = np.where(row > 0, row_end[row - 1], 0.0)
    texel = np.searchsorted(reached, row_start + second * (row_end[row] - row_start))
    texel, draws = np.unique(texel, return_counts=True)
    share = draws * reached[-1] / (count * weight[texel])
    return texels[texel].astype(np.float32), (power[texel] * share[:, None]).astype(np.float32), texel
