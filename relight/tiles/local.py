"""The part of a city that the light of one tile depends on: its own mesh, its neighbours' near it, all else coarse."""

from typing import NamedTuple

import numpy as np

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.plan import folder_of
from splat2mesh.tiles.store import Store

from .shared import Shared, joined_meshes, scene_of

NEAR = 1.0
"""How far around its core a tile sees its neighbours as they are, in distances between stations."""

LOWEST = 0.005
"""Elevation, in radians, below which nothing of a distant tile reaches and it is left out: the coarse scene of a tile
stays as large as it is, however large the city. From there a wall gets 0.6% of its light under an even sky."""


class Local(NamedTuple):
    """A tile among its surroundings. scene: its own mesh is the first chunk, what lies near it the next ones, the
    coarse rest the last. own: vertices of the tile. near: chunks of the tile and what lies near it."""

    scene: Scene
    own: int
    near: int


def tile_mesh(store: Store, tile: int) -> Mesh:
    """The mesh of a tile that has faces."""
    return mesh_from_ply_bytes(store.read(f"{folder_of(tile)}/mesh.ply"))


def local_scene(store: Store, shared: Shared, tile: int, distance: float) -> Local:
    """A tile among its surroundings. distance: around its core within which neighbours are seen as they are."""
    box = shared.cores[tile] + np.array([[-distance], [distance]])
    touching = (shared.cores[:, 0] < box[1]).all(axis=1) & (shared.cores[:, 1] > box[0]).all(axis=1)
    chunks, far = [tile_mesh(store, tile)], []
    apart = np.maximum(shared.cores[:, 0] - shared.cores[tile, 1], shared.cores[tile, 0] - shared.cores[:, 1])
    apart = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
    lowest = chunks[0].vertices[:, 1].min()
    for other, distant in enumerate(shared.coarse):
        if other == tile or distant is None or distant.vertices[:, 1].max() - lowest < LOWEST * apart[other]:
            continue
        if touching[other]:
            part = _part(tile_mesh(store, other), box, inside=True)
            if len(part.faces):
                chunks.append(part)
            distant = _part(distant, box, inside=False)
        if len(distant.faces):
            far.append(distant)
    return Local(scene_of([*chunks, *joined_meshes(far)], shared), len(chunks[0].vertices), len(chunks))


def far_scene(shared: Shared) -> Scene:
    """The whole city, coarse."""
    return scene_of(joined_meshes([mesh for mesh in shared.coarse if mesh is not None]), shared)


def _part(mesh, box, inside):
    """The faces of a Mesh whose middles lie in a box of x and z, or those whose do not."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)[:, [0, 2]]
    chosen = ((middle >= box[0]) & (middle < box[1])).all(axis=1) == inside
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return Mesh(mesh.vertices[used], mesh.normals[used], faces, mesh.colors_srgb[used])
