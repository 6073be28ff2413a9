"""The data of a splat that suns and the albedo view need, in 8 bytes: position and normal of its surface, and its gain
under a light."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions
from splat2mesh.base.threads import in_batches

from ..splats.mirrored_places import as_mirrored

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

    from ..splats.binding import Binding
    from ..transfer.volume import Foliage

UNLIT, LIT, SKY = 0, 1, 2
"""Kinds of splats: unchanged, lit, and far background, which shows the sky."""

OWN_STEPS = 32.0
"""Steps per stop of the light ratio per light: 2.2% each, over four stops to either side."""

VOLUME_STEPS = 63
"""Steps of the foliage share of a splat, in the six high bits of its kind."""


class Surfaces(NamedTuple):
    """packed: (N, 8) uint8. lift: scene units per step of the fourth byte. own: (3,) of its middle step."""

    packed: NDArray[np.uint8]
    lift: float
    own: NDArray[np.float64]


def octahedral(normals: Directions) -> NDArray[np.int8]:
    """(N, 2) int8 of unit vectors (N, 3): the octahedron unfolded, z up."""
    x, y, z = (normals / np.maximum(np.abs(normals).sum(axis=1, keepdims=True), 1e-12)).T
    fold = z < 0.0
    u = np.where(fold, (1.0 - np.abs(y)) * np.where(x < 0.0, -1.0, 1.0), x)
    v = np.where(fold, (1.0 - np.abs(x)) * np.where(y < 0.0, -1.0, 1.0), y)
    return np.rint(np.stack([u, v], axis=1) * 127.0).astype(np.int8)


def surfaces(
    binding: "Binding",
    means: NDArray[np.float32],
    scene: "Scene",
    own: NDArray[np.float32],
    kinds: NDArray[np.uint8],
    foliage: "Foliage | None" = None,
) -> Surfaces:
    """The Surfaces of N splats.

    binding: Binding. means: (N, 3) centres, splat frame. own: (V, 3) of `response.Response`. kinds: (N,) uint8.
    foliage: `transfer.volume.Foliage` where leaves and grass are volumes, or None.
    """
    lit = binding.lit
    normals = binding.spread(scene.normals.astype(np.float32), as_mirrored)
    ratio = np.maximum(binding.spread(own), np.float32(1e-12))
    length = np.linalg.norm(normals, axis=1)
    unit = normals / np.maximum(length, 1e-6)[:, None]
    frame = np.asarray(scene.scene_from_splat, np.float64)[:3, :3]
    lift = np.zeros(len(normals), np.float32)
    places, mirrored = means[lit], binding.mirrored
    if mirrored is not None:
        places[mirrored.rows] = mirrored.means

    def measure(part: slice) -> None:
        gap = binding.surface.caster.closest(places[part]).points - places[part]
        lift[part] = np.einsum("nc,nc->n", gap @ frame.T, unit[part])

    in_batches(measure, len(places))
    most = float(np.percentile(np.abs(lift), 99.0)) if len(lift) else 0.0
    step = max(most, 1e-9) / 127.0
    middle = np.median(ratio, axis=0) if len(ratio) else np.ones(3, np.float32)
    packed = np.zeros((len(means), 8), np.uint8)
    rows = np.zeros((len(normals), 8), np.uint8)
    rows[:, :2] = octahedral(unit).view(np.uint8)
    rows[:, 2] = np.clip(np.rint(length * 255.0), 0, 255)
    rows[:, 3] = np.clip(np.rint(lift / step), -127, 127).astype(np.int8).view(np.uint8)
    rows[:, 4:7] = np.clip(np.rint(np.log2(ratio / middle) * OWN_STEPS) + 128, 0, 255)
    packed[lit] = rows
    packed[:, 7] = kinds
    if foliage is not None or mirrored is not None:
        volume = np.zeros((len(own), 1), np.float32)
        if foliage is not None:
            volume[foliage.rows] = foliage.share
        share = np.clip(binding.spread(volume, as_mirrored)[:, 0], 0.0, 1.0)
        if mirrored is not None:
            share[mirrored.rows] = 1.0  # no map of a sun is of a mirrored place
        packed[lit, 7] |= np.rint(VOLUME_STEPS * share).astype(np.uint8) << 2
    return Surfaces(packed, step, middle.astype(np.float64))
