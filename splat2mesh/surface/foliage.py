"""Leaves apart from the mesh: their faces become a hull that is not drawn, and cards may stand in their place."""

import warnings
from dataclasses import replace

import numpy as np

from ..base.arrays import Indices, Mask
from ..base.choices import FOLIAGE_CHOICES
from ..base.errors import DataWarning, InputError
from ..scene.chunks import split
from ..scene.drawn import Drawn
from ..scene.leaves import leaf_faces
from ..scene.mesh import Mesh
from ..scene.scene import Scene
from ..splats.placing import placed
from ..splats.splats import Splats
from .cards import FACES, cards, leaf_splats

MESH, CARDS, NONE = FOLIAGE_CHOICES


def leaves_apart(scene: Scene, splats: Splats, kind: str, max_chunk_vertices: int) -> Scene:
    """The Scene without the faces of its leaves, whose chunks become its hull, and with cards where they are asked for.

    scene: Scene that was measured and not saved yet. splats: Splats that it was made of, cleaned, without the far
    background, in their own frame. kind: CARDS or NONE. Warns with a DataWarning where nothing is leaves; raises
    InputError where all is, and nothing would be drawn.
    """
    depth = None if scene.measured is None else scene.measured.depth
    leaf = leaf_faces(scene.vertices, scene.faces, scene.foliage, depth)
    scene.settings = scene.settings | {"foliage": kind}
    if not leaf.any():
        warnings.warn(f"no leaves or grass were found: `foliage` {kind} changes nothing", DataWarning, stacklevel=3)
        scene.statistics = scene.statistics | {"faces_leaves": 0}
        return scene
    if leaf.all():
        raise InputError(f"`foliage` {kind}: all of the mesh is leaves or grass, no surface is left; take mesh")
    parts, rows, hull = _parted(scene, leaf)
    measured = scene.measured
    if measured is not None:
        measured = measured._replace(vertex_volume=measured.vertex_volume[rows])
    apart = replace(scene, chunks=parts, hull=hull, measured=measured)
    statistics: dict[str, float] = {"faces": int((~leaf).sum()), "faces_leaves": int(leaf.sum())}
    if kind == CARDS:
        leaves = Drawn(Scene([parts[number] for number in hull])).mesh
        surface = [chunk.vertices for number, chunk in enumerate(parts) if number not in hull]
        upright = placed(splats, scene.scene_from_splat)
        of_leaves = leaf_splats(upright, np.concatenate([leaves.vertices[:0], *surface]), leaves, scene.diagonal)
        made, kept = cards(upright.take(of_leaves), leaves, int(leaf.sum()))
        apart.cards = split(made, max_chunk_vertices) if len(made.faces) else []
        statistics |= {"cards": len(made.faces) // FACES, "cards_cover": round(kept, 4)}
        statistics["faces"] += len(made.faces)
    vertices = sum(len(chunk.vertices) for number, chunk in enumerate(parts) if number not in hull)
    statistics["vertices"] = vertices + sum(len(mesh.vertices) for mesh in apart.cards)
    apart.statistics = scene.statistics | statistics
    return apart


def _parted(scene: Scene, leaf: Mask) -> tuple[list[Mesh], Indices, tuple[int, ...]]:
    """Chunks, each cut into surface and leaves; the old vertex of each of their vertices; which of them are leaves."""
    parts: list[Mesh] = []
    rows: list[Indices] = []
    hull: list[int] = []
    start, first = 0, 0
    for chunk in scene.chunks:
        of_chunk = leaf[first : first + len(chunk.faces)]
        for is_leaf in (False, True):
            faces = chunk.faces[of_chunk == is_leaf]
            if not len(faces):
                continue
            used, corners = np.unique(faces, return_inverse=True)
            hull += [len(parts)] * is_leaf
            own = np.asarray(corners.reshape(-1, 3), np.int32)
            parts.append(Mesh(chunk.vertices[used], chunk.normals[used], own, chunk.colors_srgb[used]))
            rows.append(start + used.astype(np.int64))
        start, first = start + len(chunk.vertices), first + len(chunk.faces)
    return parts, np.concatenate(rows), tuple(hull)
