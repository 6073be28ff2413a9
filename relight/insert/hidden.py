"""The shadow of a moved object without rays: the light at its last position that it hides.

For each direction of that light a depth map of the object says which points lie behind it. The maps are drawn once;
they move and turn with the object. Other surfaces occlude as they did at the old position.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Mask
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices

from .arriving import DIRECTIONS, light_at, shown_along
from .gathering import in_box
from .standing import Standing
from .surroundings import Receiving, Surroundings

SIDE = 64
"""Texels along the side of a map."""

OFF = 1.0
"""Texels along the normal from which a point looks at a map."""


class _Maps(NamedTuple):
    """K depth maps of an object, unit frame of the scene. directions, across, down: (K, 3) float32, the axes of each.
    depths: (K, SIDE, SIDE) float32 along the direction from the middle, -inf where the object is not."""

    directions: NDArray[np.float32]
    across: NDArray[np.float32]
    down: NDArray[np.float32]
    depths: NDArray[np.float32]

    def instead(self, first: int, others: "_Maps") -> "_Maps":
        """The first maps, followed by others."""
        return _Maps(*(np.concatenate([own[:first], new]) for own, new in zip(self, others, strict=True)))


@dataclass(frozen=True, eq=False)
class HiddenLight:
    """One object in the light of its place, K directions; unit frame of the scene.

    stood: the Standing there. number: of the object. light, sent: (K, 3) of `arriving.light_at` and `shown_along`.
    maps: of the object there.
    """

    stood: Standing
    number: int
    light: NDArray[np.float32]
    sent: NDArray[np.float32]
    maps: _Maps

    @classmethod
    def of(cls, around: Surroundings, stood: Standing, number: int, radiance: NDArray[np.float32]) -> "HiddenLight":
        """Of one of the objects of a Standing. radiance: (W, 3) of the vertices of all."""
        directions, light = light_at(around, stood.spheres[number][0])
        first, last = stood.starts[number : number + 2]
        faces = stood.faces[stood.owner == number] - first
        sent = shown_along(stood.vertices[first:last], faces, radiance[first:last], directions)
        return cls(stood, number, light, sent, _maps_of(stood, number, directions))

    @property
    def suns(self) -> int:
        """Number of suns and lamps with a direction of their own."""
        return len(self.light) - DIRECTIONS

    def reached(self, standing: Standing, at: Receiving, least: float) -> Mask:
        """Mask (M,) of the points near the object where it stands now, and where a sun may throw its shadow.

        least: part of a hemisphere that its sphere must fill."""
        middle, radius = standing.spheres[self.number]
        found = in_box(middle, radius, at, least)
        for sun in self.maps.directions[DIRECTIONS:].astype(np.float64):
            toward = middle - at.origins
            along = toward @ sun
            found |= (along > 0.0) & (np.einsum("ij,ij->i", toward, toward) - along**2 < radius**2)
        return found

    def logarithms(self, standing: Standing, at: Receiving) -> NDArray[np.float32]:
        """Change of the logarithm of light (M, 3) at points that the object makes where it stands now."""
        # To where it stood, from where it stands.
        back = self.stood.placed[self.number] @ np.linalg.inv(standing.placed[self.number])
        turn, frame, maps, light = back[:3, :3], standing.frame, self.maps, self.light
        moved = (back[:3, 3] + (turn - np.eye(3)) @ frame.center) / frame.diagonal
        if not np.allclose(turn, np.eye(3)):
            # The maps turn with the object, the light does not.
            even, suns = np.split(maps.directions.astype(np.float64), [DIRECTIONS])
            light = np.concatenate([light[scipy.spatial.cKDTree(even).query(even @ turn)[1]], light[DIRECTIONS:]])
            if len(suns):
                maps = maps.instead(DIRECTIONS, _maps_of(self.stood, self.number, suns @ turn.T))
        solid = np.where(np.arange(len(light)) < DIRECTIONS, 4.0 * np.pi / DIRECTIONS, 0.0)
        gain = (self.sent * solid[:, None] - light).astype(np.float32)
        middle, radius = self.stood.spheres[self.number]
        origins, normals = (at.origins @ turn.T + (moved - middle)).astype(np.float32), at.normals @ turn.T
        found = np.zeros((len(origins), 3), np.float32)
        arrays = origins, normals.astype(np.float32), np.float32(_texel(radius)), *maps, light, gain, found
        in_slices(_hide, len(origins), *arrays)
        return found


def _texel(radius: float) -> float:
    return 2.0 * radius / (SIDE - 2)


def _maps_of(stood: Standing, number: int, directions: Directions) -> _Maps:
    """The maps of an object from directions (K, 3), by rays."""
    middle, radius = stood.spheres[number]
    side = np.where(np.abs(directions[:, 1:2]) > 0.9, np.eye(3)[:1], np.eye(3)[1:2])
    across = np.cross(side, directions)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    down = np.cross(directions, across)
    steps = (np.arange(SIDE) - 0.5 * (SIDE - 1)) * _texel(radius)
    plane = steps[:, None, None] * down[:, None, None] + steps[None, :, None] * across[:, None, None]
    starts = middle + plane + 2.0 * radius * directions[:, None, None]
    rays = np.concatenate([starts, np.broadcast_to(-directions[:, None, None], starts.shape)], axis=-1)
    hits = stood.caster.first_hits(rays.reshape(-1, 6).astype(np.float32))
    met = (hits.faces >= 0) & (stood.owner[np.maximum(hits.faces, 0)] == number)
    depths = np.where(met, 2.0 * radius - hits.distance, -np.inf).astype(np.float32)
    axes = directions.astype(np.float32), across.astype(np.float32), down.astype(np.float32)
    return _Maps(*axes, depths.reshape(len(directions), SIDE, SIDE))


@kernel
def _hide(
    begin: int,
    end: int,
    origins: NDArray,
    normals: NDArray,
    texel: float,
    directions: NDArray,
    across: NDArray,
    down: NDArray,
    depths: NDArray,
    light: NDArray,
    gain: NDArray,
    found: NDArray,
) -> None:
    """At points relative to the middle of the maps: the logarithm of 1 + (hidden light times gain) / light."""
    off, half = np.float32(OFF) * texel, np.float32(0.5 * (SIDE - 1))
    zero, least = np.float32(0), np.float32(0.03)
    for v in range(begin, end):
        nx, ny, nz = normals[v]
        x, y, z = origins[v, 0], origins[v, 1], origins[v, 2]
        x, y, z = x + off * nx, y + off * ny, z + off * nz
        red, green, blue, r, g, b = zero, zero, zero, zero, zero, zero
        for k in range(len(directions)):
            dx, dy, dz = directions[k]
            facing = nx * dx + ny * dy + nz * dz
            if facing <= zero:
                continue
            red += facing * light[k, 0]
            green += facing * light[k, 1]
            blue += facing * light[k, 2]
            column = (x * across[k, 0] + y * across[k, 1] + z * across[k, 2]) / texel + half
            row = (x * down[k, 0] + y * down[k, 1] + z * down[k, 2]) / texel + half
            if not (column >= zero and row >= zero and column < SIDE - 1 and row < SIDE - 1):
                continue
            left, top, depth = int(column), int(row), x * dx + y * dy + z * dz + off
            right, low = column - np.float32(left), row - np.float32(top)
            above = below = zero
            if depths[k, top, left] > depth:
                above += np.float32(1) - right
            if depths[k, top, left + 1] > depth:
                above += right
            if depths[k, top + 1, left] > depth:
                below += np.float32(1) - right
            if depths[k, top + 1, left + 1] > depth:
                below += right
            hidden = facing * (above + (below - above) * low)
            r += hidden * gain[k, 0]
            g += hidden * gain[k, 1]
            b += hidden * gain[k, 2]
        if r != zero or g != zero or b != zero:
            found[v, 0] = np.log(max(np.float32(1) + r / max(red, np.float32(1e-12)), least))
            found[v, 1] = np.log(max(np.float32(1) + g / max(green, np.float32(1e-12)), least))
            found[v, 2] = np.log(max(np.float32(1) + b / max(blue, np.float32(1e-12)), least))
