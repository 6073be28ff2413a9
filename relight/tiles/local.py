"""The part of a city that the light of one tile depends on: its own mesh, its neighbours' near it, all else coarse."""

from typing import Any, NamedTuple

import numpy as np

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.store import Store

NEAR = 1.0
"""How far around its core a tile sees its neighbours as they are, in distances between stations."""


class Local(NamedTuple):
    """A tile among its surroundings. scene: its own mesh is the first chunk, what lies near it the next ones, the
    coarse rest the last. own: vertices of the tile. near: chunks of the tile and what lies near it."""

    scene: Scene
    own: int
    near: int


def city_of(store: Store) -> dict[str, Any]:
    """The city.json of a folder."""
    return store.read_json("city.json")


def tile_mesh(store: Store, entry: dict[str, Any], file: str = "mesh.ply") -> Mesh:
    """The mesh of a tile that has faces, or its coarse twin."""
    return mesh_from_ply_bytes(store.read(f"{entry['name']}/{file}"))


def local_scene(store: Store, city: dict[str, Any], tile: int, distance: float) -> Local:
    """A tile among its surroundings. distance: around its core within which neighbours are seen as they are."""
    entry = city["tiles"][tile]
    core = np.array(entry["core"]).reshape(2, 2)
    box = core + np.array([[-distance], [distance]])
    chunks, far = [tile_mesh(store, entry)], []
    for other, about in enumerate(city["tiles"]):
        if other == tile or not about["faces"]:
            continue
        (low, high) = np.array(about["core"]).reshape(2, 2)
        touches = (low < box[1]).all() and (high > box[0]).all()
        if touches:
            part = _part(tile_mesh(store, about), box, inside=True)
            if len(part.faces):
                chunks.append(part)
        distant = tile_mesh(store, about, "far.ply")
        distant = _part(distant, box, inside=False) if touches else distant
        if len(distant.faces):
            far.append(distant)
    own = chunks[0]
    scene = Scene(
        [*chunks, *_joined(far)],
        scene_from_splat=np.array(city["scene_from_splat"]),
        source={"file": "a city"},
        capture={"from": "both"},
    )
    return Local(scene, len(own.vertices), len(chunks))


def far_scene(store: Store, city: dict[str, Any]) -> Scene:
    """The whole city, coarse."""
    meshes = [tile_mesh(store, entry, "far.ply") for entry in city["tiles"] if entry["faces"]]
    return Scene(
        _joined(meshes),
        scene_from_splat=np.array(city["scene_from_splat"]),
        source={"file": "a city"},
        capture={"from": "both"},
    )


def _part(mesh, box, inside):
    """The faces of a Mesh whose middles lie in a box of x and z, or those whose do not."""
    middle = mesh.vertices[mesh.faces].mean(axis=1)[:, [0, 2]]
    chosen = ((middle >= box[0]) & (middle < box[1])).all(axis=1) == inside
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    faces = faces.reshape(-1, 3).astype(np.int32)
    return Mesh(mesh.vertices[used], mesh.normals[used], faces, mesh.colors_srgb[used])


def _joined(meshes):
    """Meshes as a list of one, or of none."""
    if not meshes:
        return []
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return [
        Mesh(
            np.concatenate([mesh.vertices for mesh in meshes]),
            np.concatenate([mesh.normals for mesh in meshes]),
            np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.int32),
            np.concatenate([mesh.colors_srgb for mesh in meshes]),
        )
    ]
