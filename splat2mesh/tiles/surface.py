"""The mesh of one tile: raw surface, decimation that keeps the border, fairing, colours, and a coarse twin for afar.

Position, normal and colour on a border between tiles come from the raw surface of the ring alone, which
all adjacent tiles share to the bit.
"""

from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Indices, Points
from ..scene.mesh import Mesh, edge_keys, normals_of
from ..scene.meshfile import mesh_ply_bytes
from ..scene.scene import Scene
from ..surface.album import GREY, Album, filled_in
from ..surface.clean import fill_holes, without_floaters
from ..surface.fair import fair
from ..surface.place import HOLE_CELLS, SPARE
from ..surface.simplify import simplify
from .coarse import twins
from .lattice import Raw, raw_surface, seam_edges, seam_of, smoothed
from .look import shots_around, sight_of
from .memory import give_back
from .plan import DISTANT, FAR, CityPlan, folder_of, plan_at
from .store import Store
from .tileset import glb_bytes


def mesh(store: Store, key: str, tile: int) -> dict[str, Any]:
    """Make the mesh of a tile: tiles/TILE/mesh.ply, mesh.glb, its twins, and its record; returns the record."""
    known = plan_at(store.root, key)
    sights, pictures = [], []
    for shot in shots_around(store, known, tile):
        sights.append(sight_of(shot, known, tile))
        pictures.append(Album.of([shot]))
    album = Album.joined(pictures) if pictures else None
    pictures.clear()
    give_back()
    raw = raw_surface(sights, known, tile)
    give_back()
    made, facts = tile_mesh(raw, tile, album, known)
    del raw, album
    give_back()
    name, files = folder_of(tile), {}
    if made is not None:
        far, distant = twins(made, len(known.tiles))
        files = {
            f"{name}/mesh.ply": mesh_ply_bytes(made),
            f"{name}/mesh.glb": glb_bytes(made, Scene([made]).colors_linear),
            f"{name}/{FAR}": mesh_ply_bytes(far),
            f"{name}/far.glb": glb_bytes(far, Scene([far]).colors_linear),
        }
        if distant is not None:
            files[f"{name}/{DISTANT}"] = mesh_ply_bytes(distant)
        facts |= {"bounds": [made.vertices.min(axis=0).tolist(), made.vertices.max(axis=0).tolist()]}
        facts |= {"far_vertices": len((distant or far).vertices)}
    return store.commit(f"{name}/mesh.json", files, tile=tile, **facts)


def tile_mesh(raw: Raw, tile: int, album: Album | None, plan: CityPlan) -> tuple[Mesh | None, dict[str, Any]]:
    """The Mesh of a tile of its raw surface (Raw), coloured by an Album, None without faces, and its statistics."""
    seam = seam_of(raw, tile)
    soft = smoothed(raw)
    normals = normals_of(soft, raw.faces)
    points = np.where(seam[:, None], soft, raw.points)
    chosen = raw.faces[raw.owner == tile]
    chosen, dropped = without_floaters(chosen, seam)
    if album is None or len(chosen) == 0:
        nothing = {"vertices": 0, "faces": 0, "seam_vertices": 0, "components_dropped": dropped}
        return None, nothing | {"borders": {}, "border_edges_missing": 0}
    used, corners = np.unique(chosen, return_inverse=True)
    local: Faces = corners.reshape(-1, 3).astype(np.int32)
    at: Points = points[used]
    cells, fixed = raw.cells[used], seam[used]
    del chosen, soft, points
    give_back()
    found = len(used)
    wanted = plan.settings.get("vertices")
    most = round(found / SPARE) if wanted is None else round(wanted * plan.counts[tile] / max(sum(plan.counts), 1))
    at, local, cells, kept = simplify(at, local, cells, max(most, 4), fixed)
    kept = np.where(kept >= 0, used[kept], -1)  # which vertex of the raw surface it is
    local = without_crowded(at, local, kept >= 0)
    at, local, filled = fill_holes(at, local, HOLE_CELLS * float(np.median(cells)), kept >= 0)
    kept = np.concatenate([kept, np.full(filled, -1)])
    _, thickness, seen_by = album.look_up(at, normals_of(at, local))
    size = np.where(np.isfinite(seen_by), np.maximum(seen_by, plan.pixel), plan.pixel)
    at = fair(at, local, thickness / size, float(np.median(size)), kept >= 0)
    used, corners = np.unique(local, return_inverse=True)
    local, vertices, kept = corners.reshape(-1, 3).astype(np.int32), at[used].astype(np.float32), kept[used]
    directions = normals_of(vertices.astype(np.float64), local)
    border = np.flatnonzero(kept >= 0)
    directions[border] = normals[kept[border]]  # from the ring, as on the other side
    shown = album.look_up(vertices, directions.astype(np.float32))[0]
    unseen = np.isnan(shown[:, 0])
    shown[unseen & (kept >= 0)] = GREY
    colors, _ = filled_in(shown, vertices)
    missing, borders = _borders(raw, tile, kept, local, vertices)
    facts: dict[str, Any] = {
        "borders": borders,
        "border_edges_missing": missing,
        "vertices": len(vertices),
        "faces": len(local),
        "vertices_found": found,
        "seam_vertices": len(border),
        "seam_unseen": int(unseen[border].sum()),
        "components_dropped": dropped,
        "holes_filled": filled,
        "vertices_unseen": int(unseen.sum()),
    }
    return Mesh(vertices, directions.astype(np.float32), local, colors), facts


def _borders(raw: Raw, tile: int, kept: Indices, faces: Faces, points: Points) -> tuple[int, dict[str, list[Any]]]:
    """The number of missing edges to other tiles, and for each other tile their number and a checksum of their
    positions, which the other tile must have too. kept: which vertex of the raw surface each of the mesh is, -1 for
    none."""
    edges, other = seam_edges(raw, tile)
    number = np.full(len(raw.points), -1, np.int64)
    number[kept[kept >= 0]] = np.flatnonzero(kept >= 0)
    edges = number[edges]
    there = np.isin(edges.min(axis=1) * len(points) + edges.max(axis=1), edge_keys(faces, len(points)))
    there &= edges.min(axis=1, initial=0) >= 0
    borders = {}
    for neighbor in np.unique(other):
        ends = points[edges[(other == neighbor) & there]].reshape(-1, 6)
        turned = np.concatenate([ends[:, 3:], ends[:, :3]], axis=1)
        first = [tuple(row) for row in ends.tolist()]
        lines = sorted(min(row, back) for row, back in zip(first, map(tuple, turned.tolist()), strict=True))
        borders[str(neighbor)] = [len(lines), sha256(np.array(lines, np.float32).tobytes()).hexdigest()[:16]]
    return int((~there).sum()), borders


def without_crowded(points: NDArray, faces: NDArray, fixed: NDArray) -> NDArray:
    """Faces with at most two at an edge, the largest; those at fixed vertices stay."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    key = edge_keys(faces, len(points)).ravel()
    of_face = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((of_face, -area[of_face], key))
    first = np.append(True, key[order][1:] != key[order][:-1])
    rank = np.arange(len(order)) - np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
    crowded = np.zeros(len(faces), bool)
    crowded[of_face[order[rank >= 2]]] = True
    return faces[~crowded | fixed[faces].any(axis=1)]
