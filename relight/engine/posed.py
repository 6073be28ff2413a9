"""A geometry in motion whose light depends on each vertex alone: a formula or a network takes every pose as it comes.

Neither traces rays, so nothing is precomputed, and nothing but the moved vertices is renewed. Source of the network:
Geronikolakis et al., "Neural-GASh", arXiv:2507.13917, 2025, whose claim this is.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Indices, Points, Transfer
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

from ..transfer.analytic import analytic
from ..transfer.neuralgash import UnitFrame, neural_gash
from ..transfer.settings import Settings

if TYPE_CHECKING:
    from ..light.environment import Suns

PER_VERTEX = "analytic", "neural-gash"
"""Methods whose transfer of a vertex depends on its position and normal alone."""


class PosedGeometry:
    """A scene whose chunks move, as `direct.DirectLight` asks it.

    settings: Settings of one of PER_VERTEX; suns are part of the harmonics. moving: numbers of the chunks that moved.
    """

    def __init__(self, scene: Scene, moving: Iterable[int], settings: Settings, before: "PosedGeometry | None") -> None:
        """before: that of the same scene with fewer moving chunks, whose pose is taken over."""
        self.settings, self.moving = settings._replace(sun_tolerance=0.0), frozenset(moving)
        self._ends = np.cumsum([0, *(len(chunk.vertices) for chunk in scene.chunks)])
        if before is None:
            self._vertices, self._normals = scene.vertices.copy(), scene.normals.copy()
            self._frame = UnitFrame.of(scene.vertices)  # which stays, so that no motion changes what rests
            self._transfer = self._of(slice(None))
        else:
            self._vertices, self._normals, self._frame = before._vertices, before._normals, before._frame
            self._transfer = before._transfer

    def transfer(self, settings: Settings | None = None) -> tuple[Transfer, Settings]:
        """(transfer (V, K) float32 in the present pose, the Settings that it was made by): the same for all."""
        return self._transfer, self.settings

    def sunlight(self, suns: "Suns", settings: Settings | None = None) -> NDArray[np.float32] | None:
        """None: suns are in the harmonics."""
        return None

    def update(self, changes: Mapping[int, tuple[Points, Directions]]) -> tuple[Indices, Indices]:
        """Move chunks, {number: (vertices, normals)}: sorted rows that may have changed, of transfer and of light."""
        for chunk, pose in changes.items():
            shape = self._ends[chunk + 1] - self._ends[chunk], 3
            for values in pose:
                if np.shape(values) != shape or not np.isfinite(values).all():
                    raise InputError(f"chunk {chunk}: vertices and normals must have shape {shape} and be finite")
        rows = [np.zeros(0, np.int64)]
        for chunk, (vertices, normals) in sorted(changes.items()):
            part = slice(self._ends[chunk], self._ends[chunk + 1])
            self._vertices[part], self._normals[part] = vertices, normals
            self._transfer[part] = self._of(part)
            rows.append(np.arange(part.start, part.stop))
        return np.concatenate(rows), np.concatenate(rows)

    def scene(self, like: Scene) -> Scene:
        """The Scene in its present pose, with all else from another."""
        return scene_at(like, self._vertices, self._normals)

    def _of(self, part: slice) -> Transfer:
        if self.settings.method == "analytic":
            return analytic(self._normals[part], self.settings.bands)
        guess = neural_gash(self._vertices[part], self._normals[part], frame=self._frame)
        return np.ascontiguousarray(guess[:, : self.settings.bands**2])


def scene_at(like: Scene, vertices: Points, normals: Directions) -> Scene:
    """A Scene with other vertices and normals, (V, 3) both, chunk after chunk."""
    ends = np.cumsum([len(chunk.vertices) for chunk in like.chunks])[:-1]
    chunks = zip(np.split(vertices, ends), np.split(normals, ends), like.chunks, strict=True)
    return Scene([Mesh(points, own, old.faces, old.colors_srgb) for points, own, old in chunks])


def check_changes(scene: Scene, changes: Iterable[int]) -> None:
    """Raise InputError for chunks that a scene does not have."""
    for chunk in changes:
        if chunk != int(chunk) or not 0 <= chunk < len(scene.chunks):
            raise InputError(f"chunk {chunk}: the scene has chunks 0 to {len(scene.chunks) - 1}")
