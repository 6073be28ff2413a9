"""Check that the meshes of a city join: every border from both sides, in the written files."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.tiles.store import Store


def check_seams(store: Store) -> dict[str, int]:
    """Count over all borders of a city: `borders` between tiles, `edges` and `vertices` on them, `cracks` (edges that
    one side has and the other lacks, or that the decimation lost), `normals` and `colors` that differ at a vertex."""
    tiles = store.read_json("city.json")["tiles"]
    total = dict.fromkeys(("borders", "edges", "vertices", "cracks", "normals", "colors"), 0)
    meshes: dict[int, Mesh] = {}
    for number, entry in enumerate(tiles):
        total["cracks"] += entry["border_edges_missing"]
        for name, (count, checksum) in entry["borders"].items():
            other = int(name)
            theirs = tiles[other]["borders"].get(str(number), [0, ""])
            total["cracks"] += (theirs != [count, checksum]) * max(count, theirs[0], 1)
            if other < number:
                continue
            total["borders"] += 1
            total["edges"] += count
            for each in (number, other):
                if each not in meshes:
                    meshes[each] = mesh_from_ply_bytes(store.read(f"{tiles[each]['name']}/mesh.ply"))
            for key, found in _compared(meshes[number], meshes[other]).items():
                total[key] += found
        last = max((int(name) for name in entry["borders"]), default=-1)
        meshes = {kept: mesh for kept, mesh in meshes.items() if kept > number or last > number}
    return total


def _compared(first: Mesh, second: Mesh) -> dict[str, Any]:
    """Places where both meshes have vertices, and at how many the normals or the colours there differ: where no vertex
    of the one has what a vertex of the other has. Apart from the border's own vertex another may lie at a place."""
    first, second = _maybe_shared(first, second), _maybe_shared(second, first)
    keys = [_keys(mesh.vertices) for mesh in (first, second)]
    shared = np.intersect1d(keys[0], keys[1])
    found = {"vertices": len(shared)}
    compared: dict[str, Any] = {
        "normals": (first.normals.view(np.uint32), second.normals.view(np.uint32)),
        "colors": (first.colors_srgb, second.colors_srgb),
    }
    for name, values in compared.items():
        sides = []
        for mesh, key, value in zip((first, second), keys, values, strict=True):
            rows = np.isin(key, shared)
            places = mesh.vertices[rows].view(np.uint32)
            sides.append({tuple(row) for row in np.hstack([places, value[rows].astype(np.uint32)]).tolist()})
        found[name] = len(shared) - len({row[:3] for row in sides[0] & sides[1]})
    return found


def _maybe_shared(mesh: Mesh, other: Mesh) -> Mesh:
    """The vertices of a Mesh, without faces, whose x and y a vertex of another has to the bit. Numbers are compared
    several times as fast as whole places, of which few are left then."""
    ours, theirs = (
        np.ascontiguousarray(each.vertices[:, :2], np.float32).view(np.uint64).ravel() for each in (mesh, other)
    )
    rows = np.flatnonzero(np.isin(ours, theirs))
    return Mesh(mesh.vertices[rows], mesh.normals[rows], np.zeros((0, 3), np.int32), mesh.colors_srgb[rows])


def _keys(points: NDArray) -> Any:
    """One key a point, by its bits."""
    return np.ascontiguousarray(points, np.float32).view([("", np.uint32)] * 3).ravel()
