"""What is drawn of a scene: its surfaces, and cards in place of the leaves that are only there for the light."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices
from .color import BLACK, linear_from_srgb
from .mesh import Mesh
from .scene import Scene

AROUND = 8
"""Vertices of the hull whose mean light a vertex of a card takes: the normal of a single one is noise."""

MOST_TINT = 8.0
"""Least linear colour that a card is compared with, and how many times brighter than the hull around it a card may be:
where the hull is black, nothing says how much light there is."""


class Drawn:
    """What is drawn of a Scene, and the values of its vertices there. scene: Scene of the drawn chunks, cards last: the
    same object where nothing is hidden. D vertices."""

    def __init__(self, scene: Scene) -> None:
        self._lit = scene
        self.scene = scene
        if scene.hull or scene.cards:
            chunks = [chunk for number, chunk in enumerate(scene.chunks) if number not in scene.hull]
            self.scene = replace(scene, chunks=[*chunks, *scene.cards], hull=(), cards=[], measured=None)

    @classmethod
    def surfaces(cls, scene: Scene) -> "Drawn":
        """The same without cards, which have no texture."""
        return cls(replace(scene, cards=[]) if scene.cards else scene)

    @property
    def mesh(self) -> Mesh:
        """All that is drawn as one Mesh, as captured."""
        return Mesh(self.scene.vertices, self.scene.normals, self.scene.faces, self.scene.colors_srgb)

    def values(self, of_vertices: Floats) -> Floats:
        """Values (V, C) of the scene's vertices, such as light: (D, C) of what is drawn. Cards take the mean around."""
        if self.scene is self._lit:
            return of_vertices
        around = of_vertices[self._near].mean(axis=1, dtype=np.float32) if self._lit.cards else of_vertices[:0]
        return np.concatenate([of_vertices[self._rows], around.astype(of_vertices.dtype)])

    def colors(self, of_vertices: Floats) -> Floats:
        """The same of what surfaces send out, (V, 3) linear: albedo, or radiance in any light. Cards have their own
        colour, in the light around them."""
        found = self.values(of_vertices)
        if self._lit.cards:
            found[len(self._rows) :] *= self._tint
        return found

    def cards_in(self, of_vertices: Floats) -> list[tuple[Mesh, Floats]]:
        """Each chunk of cards with those of its vertices among `colors`."""
        if not self._lit.cards:
            return []
        found = self.colors(of_vertices)[len(self._rows) :]
        ends = np.cumsum([len(mesh.vertices) for mesh in self._lit.cards])[:-1]
        return list(zip(self._lit.cards, np.split(found, ends), strict=True))

    @cached_property
    def _rows(self) -> Indices:
        """Vertices of the scene in drawn chunks."""
        sizes = [len(chunk.vertices) for chunk in self._lit.chunks]
        shown = np.ones(len(sizes), bool)
        shown[list(self._lit.hull)] = False
        return np.flatnonzero(np.repeat(shown, sizes))

    @cached_property
    def _near(self) -> NDArray[np.intp]:
        """(C, AROUND) vertices of the hull about each vertex of a card; of all chunks where there is no hull."""
        shown = np.zeros(self._lit.vertex_count, bool)
        shown[self._rows] = bool(self._lit.hull)
        hull = np.flatnonzero(~shown)
        points = np.concatenate([mesh.vertices for mesh in self._lit.cards])
        _, near = scipy.spatial.cKDTree(self._lit.vertices[hull]).query(
            points, range(1, min(AROUND, len(hull)) + 1), workers=-1
        )
        return hull[near]

    @cached_property
    def _tint(self) -> NDArray[np.float32]:
        """(C, 3) colours of the cards over those of the hull around them, as captured."""
        own = np.concatenate([mesh.colors_srgb for mesh in self._lit.cards]).astype(np.float32) / np.float32(255.0)
        around = self._lit.colors_linear[self._near].mean(axis=1, dtype=np.float32)
        return np.minimum(linear_from_srgb(own) / np.maximum(around, np.float32(BLACK)), np.float32(MOST_TINT))
