"""A relit city as a streamed SOG: a viewer loads it fine nearby and coarse far away.

sog/lod-meta.json        the tree: where each level of each leaf lies
sog/0_00003/meta.json    level 0, all splats of tile 3, beside its images; levels 1 and more are ever fewer
sog/env/meta.json        the background outside all tiles: sky and far distance
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.version import VERSION
from splat2mesh.splats.formats.sog_writing import sog_files
from splat2mesh.splats.joining import joined
from splat2mesh.splats.merging import merged
from splat2mesh.splats.splats import Splats

LOD_LEVELS = 5
"""Levels of detail. Each has a quarter of the splats of the one before, so the last has one for 256."""

LEAF = 32_768
"""Most splats of a leaf: a viewer chooses the level leaf by leaf."""

FOLDER = "sog"


def tile_levels(splats: Splats, tile: int) -> tuple[dict[str, bytes], list[dict[str, Any]]]:
    """The levels of a tile's splats: files by name within the city's folder, and its leaves in the form of the tree,
    with the name of the tile's file for a level instead of its number."""
    leaves = [splats.take(rows).in_spatial_order() for rows in _parts(splats.means)]
    nodes: list[dict[str, Any]] = [{"bound": _bound(leaf), "lods": {}} for leaf in leaves]
    files: dict[str, bytes] = {}
    for level in range(LOD_LEVELS):
        if level:
            leaves = [merged(replace(leaf, sh=leaf.sh[:, :1])) for leaf in leaves]
        name, offset = f"{level}_{tile:05d}", 0
        for leaf, node in zip(leaves, nodes, strict=True):
            node["lods"][str(level)] = {"file": f"{name}/meta.json", "offset": offset, "count": len(leaf)}
            offset += len(leaf)
        whole = sog_files(joined(list(leaves)), f"{FOLDER}/{name}")
        files |= {f"{FOLDER}/{name}/{file}": data for file, data in whole.items()}
    return files, nodes


def _parts(means: NDArray) -> list[NDArray[np.int64]]:
    """Rows of the leaves: cut at the median across the longest side until a part has at most LEAF."""
    pending, done = [np.arange(len(means))], []
    while pending:
        rows = pending.pop()
        if len(rows) <= LEAF:
            done.append(rows)
            continue
        axis = int(np.ptp(means[rows], axis=0).argmax())
        order = rows[np.argsort(means[rows, axis], kind="stable")]
        pending += [np.sort(order[len(order) // 2 :]), np.sort(order[: len(order) // 2])]
    return done


def _bound(splats: Splats) -> dict[str, list[float]]:
    """The box of the splats' standard deviations."""
    reach = np.sqrt(np.einsum("nii->ni", splats.covariances()))
    low, high = (splats.means - reach).min(axis=0), (splats.means + reach).max(axis=0)
    return {"min": low.astype(float).tolist(), "max": high.astype(float).tolist()}


def lod_meta(leaves: list[dict[str, Any]], environment: bool) -> dict[str, Any]:
    """The content of lod-meta.json for the leaves of all tiles. environment: whether there is one."""
    names = sorted({lod["file"] for leaf in leaves for lod in leaf["lods"].values()})
    number = {name: index for index, name in enumerate(names)}
    counts = [sum(leaf["lods"][str(level)]["count"] for leaf in leaves) for level in range(LOD_LEVELS)]
    filled = []
    for leaf in leaves:
        lods = {level: {**lod, "file": number[lod["file"]]} for level, lod in leaf["lods"].items()}
        filled.append({"bound": leaf["bound"], "lods": lods})
    meta = {
        "version": 1,
        "asset": {"generator": f"splat2mesh {VERSION}"},
        "count": sum(counts),
        "counts": counts,
        "lodLevels": LOD_LEVELS,
        "filenames": names,
        "tree": _tree(filled),
    }
    return meta | ({"environment": "env/meta.json"} if environment else {})


def _tree(leaves: list[dict[str, Any]]) -> dict[str, Any]:
    """A tree of two children a node, cut at the middle leaf across the longest side."""
    if len(leaves) == 1:
        return leaves[0]
    low = np.array([leaf["bound"]["min"] for leaf in leaves])
    high = np.array([leaf["bound"]["max"] for leaf in leaves])
    middle = (low + high) / 2
    order = np.argsort(middle[:, np.ptp(middle, axis=0).argmax()], kind="stable")
    half = len(leaves) // 2
    children = [_tree([leaves[i] for i in part]) for part in (order[:half], order[half:])]
    return {"bound": {"min": low.min(axis=0).tolist(), "max": high.max(axis=0).tolist()}, "children": children}


def environment_files(splats: Splats) -> dict[str, bytes]:
    """The files of the background outside all tiles."""
    return {f"{FOLDER}/env/{name}": data for name, data in sog_files(splats, f"{FOLDER}/env").items()}
