"""The mesh of a splat in other poses, as its Gaussians carry it, with torn faces left out."""

from dataclasses import replace
from typing import NamedTuple

from splat2mesh.base.arrays import Indices
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.carried import Carrier, Pose

from .attachment import Surface


class MovedMesh(NamedTuple):
    """A mesh in another pose: the Pose of its nodes. first, surface: the Surface in either, the latter without torn
    faces."""

    first: Surface
    surface: Surface
    pose: Pose

    def scene(self, like: Scene) -> Scene:
        """The Scene in this pose: its moved vertices and their normals, and the faces that are whole."""
        node = self.first.node
        vertices, normals = self.pose.vertices(like, node)
        chunks, start = [], 0
        for chunk in like.chunks:
            part = slice(start, start + len(chunk.vertices))
            whole = ~self.pose.torn(node[part][chunk.faces])
            chunks.append(replace(chunk, vertices=vertices[part], normals=normals[part], faces=chunk.faces[whole]))
            start = part.stop
        return replace(like, chunks=chunks, path=None)


class CarriedMesh:
    """A mesh as Splats carry it. surface: in the first pose. first: the Splats there. rows: of those that count."""

    def __init__(self, surface: Surface, first: Splats, rows: Indices) -> None:
        self._surface = surface
        self._carrier = Carrier(surface.points, surface.normals, surface.diagonal, first, rows)

    def at(self, splats: Splats) -> MovedMesh:
        """The mesh where other Splats, row by row the same, carry it."""
        pose, surface = self._carrier.at(splats), self._surface
        whole = surface.faces[~pose.torn(surface.faces)]
        return MovedMesh(surface, surface.posed(pose.points, pose.normals, whole), pose)
