"""Rims of captured shadows: where the shadow of the mesh and that of the photographs end a little apart.

There the colours are of one side and the light is of the other, so the albedo comes out as no paint around is. Across
the edge of a shadow the paint goes on; what it does not explain is the light's.
"""

import numpy as np
import scipy

from splat2mesh.base.arrays import Floats, Mask
from splat2mesh.base.threads import in_batches
from splat2mesh.scene.color import luminance

from ..transfer.occluder import Occluder
from .captured import CapturedScene, Estimate
from .division import albedo_of
from .edges import ROUGHEST
from .patches import PATCHES

STEP = 0.3
"""Difference of the log light of two ends of an edge of the mesh from which on a shadow ends between them."""

FLAT = 0.99
"""Length of the mean normal of a face from which on its light differs by shadow, not by slope."""

RINGS = 2
"""Rings around such edges that are judged."""

AROUND, APART = 48, 0.5
"""Vertices beside the edges that say which paint is near, and how far apart, in the unit frame, normals at right
angles count."""

RANGE = 5.0, 95.0
"""Percentiles of their albedo between which that of the rim is kept."""

SWAPPED = 0.15
"""Part of the difference between light and shade around, by which an albedo must be off: less may be other paint."""

BATCH = 4096
"""Vertices of the rim whose surroundings a core ranks at once."""

LEAST = 1e-6
"""Linear light that counts as none."""


def evened(scene: CapturedScene, found: Estimate, volume: Floats | None = None) -> Estimate:
    """An Estimate of a CapturedScene whose irradiance and albedo at the edges of shadows fit the paint around.

    volume: (V,) in [0, 1], how far each vertex is of leaves: these have no edges.
    """
    occluder, judged = scene.occluder, scene.usable & (scene.roughness < ROUGHEST)
    if volume is not None:
        judged &= volume < PATCHES.most_volume
    light = np.log(np.maximum(found.irradiance, LEAST))
    rim = _rim(occluder, np.log(np.maximum(luminance(found.irradiance), LEAST)), judged)
    rows, beside = np.flatnonzero(rim & judged), np.flatnonzero(~rim & judged)
    if not len(rows) or len(beside) < AROUND:
        return found
    alike = np.hstack([occluder.origins, APART / np.sqrt(2.0) * occluder.normals])
    near = beside[scipy.spatial.cKDTree(alike[beside]).query(alike[rows], AROUND, workers=-1)[1]]
    paint = np.log(np.maximum(scene.captured, LEAST)) - light
    bounds = np.empty((len(RANGE), len(rows), 3))

    def ranked(part: slice) -> None:
        for color in range(3):
            bounds[:, part, color] = np.percentile(paint[near[part], color], RANGE, axis=1)

    in_batches(ranked, len(rows), BATCH)
    explained = np.clip(paint[rows], *bounds)
    darkest, brightest = light[near].min(axis=1), light[near].max(axis=1)
    span = (brightest - darkest).mean(axis=1)
    swapped = (np.abs(paint[rows] - explained).mean(axis=1) > SWAPPED * span) & (span > STEP)
    evener = np.exp(np.clip(light[rows] + paint[rows] - explained, darkest, brightest))
    irradiance = found.irradiance.copy()
    irradiance[rows] = np.where(swapped[:, None], evener, irradiance[rows])
    return found._replace(irradiance=irradiance, albedo=albedo_of(scene.captured, irradiance, found.prior))


def _rim(occluder: Occluder, light: Floats, judged: Mask) -> Mask:
    """(V,) bool, near the edges of shadows in the log light (V,), on flat ground between vertices that are judged."""
    faces, rim = occluder.faces, np.zeros(len(light), bool)
    flat = np.linalg.norm(occluder.normals[faces].sum(axis=1), axis=1) > 3.0 * FLAT
    rim[faces[flat & judged[faces].all(axis=1) & (np.ptp(light[faces], axis=1) > STEP)].ravel()] = True
    for _ in range(RINGS):
        rim[faces[rim[faces].any(axis=1)].ravel()] = True
    return rim
