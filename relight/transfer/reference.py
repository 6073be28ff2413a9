"""Exit radiance under the full image, without spherical harmonics: the reference for every faster method."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from splat2mesh.base.arrays import Indices, Radiance
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import luminance

from ..light import projections
from ..light.environment import Environment, Suns
from ..light.projections import texel_parts
from ..light.sun_split import PARTS
from . import MAX_RAYS
from .occluder import BATCH_RAYS, Occluder
from .sunlight import sunlight
from .volume import Foliage

DEFAULT_DIRECTIONS = 8192


def reference(
    occluder: Occluder,
    rows: slice | Indices,  # slice or (R,) indices into the occluder's vertices
    environment: Environment,
    directions: int = DEFAULT_DIRECTIONS,
    foliage: Foliage | None = None,  # Foliage of the scene; without, leaves and grass are surfaces
) -> NDArray[np.float32]:
    """Exit radiance of white vertices under all the light of an environment: (R, 3) float32.

    One ray for each vertex and each of the `light_directions` before it. On two meshes under three measured lights
    and the clear sky 8192 directions came within 0.02 to 0.11% (relative L2) of 65536. Raises InputError for
    directions outside 64..65536.
    """
    suns = light_directions(environment, directions)
    light = sunlight(occluder, rows, suns)
    if foliage is None or not len(suns):
        return light
    share, free, _ = foliage.seen(np.arange(len(occluder.origins))[rows], suns.directions)
    own = (free @ (suns.weights / (4.0 * np.pi))).astype(np.float32)
    return light + share[:, None] * (own - light)


def light_directions(environment: Environment, count: int) -> Suns:
    """All the light of an environment as Suns, at most 3 `count` of them: S directions, radiance x solid angle.

    Texels are patches of constant radiance. Each is divided until a part holds no more than 1 / count of the
    luminous energy (but into 64 parts at most: the sun's disc is about a texel) and is smaller than a cell of `count`
    even ones. Parts that hold over half of that are directions of their own; the rest are gathered in the cells of a
    Fibonacci sphere, and each cell shines from the centroid of its luminance. So every texel's energy counts, and
    cells turn with the environment.
    """
    if count != int(count) or not 64 <= count <= MAX_RAYS:
        raise InputError(f"reference directions must be a whole number from 64 to {MAX_RAYS}, found {count}")
    image = environment.radiance
    height, width = image.shape[:2]
    share = _energy(image).sum() / count
    if not share > 0.0:
        return Suns(np.zeros((0, 3)), np.zeros((0, 3)))
    tree = cKDTree(fibonacci_sphere(int(count)))
    # Three parts across a cell, of 4 pi / count steradians: finer ones move a centroid by under a tenth of it.
    least = math.ceil(3.0 * math.pi / height / math.sqrt(4.0 * math.pi / count))
    own, cells, moment = [], np.zeros((count, 3)), np.zeros((count, 3))
    rows = max(1, BATCH_RAYS // (width * least * least))
    for start in range(0, height, rows):
        block = image[start : start + rows].astype(np.float64)
        energy = _energy(block, start, height)
        split = np.clip(np.ceil(np.sqrt(energy / share)), least, max(PARTS, least)).astype(int)
        for parts in np.unique(split[energy > 0.0]):
            row, column = np.nonzero((split == parts) & (energy > 0.0))
            toward, area = texel_parts(row + start, column, height, width, parts)
            weights = (area[..., None] * block[row, column][:, None]).reshape(-1, 3)
            toward, bright = toward.reshape(-1, 3), luminance(weights)
            alone = bright > 0.5 * share
            own.append(np.hstack([toward, weights])[alone])
            _, cell = tree.query(toward[~alone], workers=-1)
            np.add.at(cells, cell, weights[~alone])
            np.add.at(moment, cell, toward[~alone] * bright[~alone, None])
    filled = cells.any(axis=1)
    moment = moment[filled] / np.linalg.norm(moment[filled], axis=1, keepdims=True)
    every = np.concatenate([*own, np.hstack([moment, cells[filled]])])
    return Suns(every[:, :3], every[:, 3:]).rotated(environment.rotation_deg)


def _energy(image: Radiance, start: int = 0, height: int | None = None) -> NDArray[np.float64]:
    """Luminance times solid angle of every texel, (H, W), of an image or of its rows from `start` on."""
    rows, width = image.shape[:2]
    areas = projections.row_solid_angles(height or rows, width)
    return luminance(image) * areas[start : start + rows]
