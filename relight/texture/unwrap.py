"""Unwrap the surface of a scene into one square texture by xatlas: few faces, few seams."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Integers, Points
from splat2mesh.texture.atlas import Atlas, atlas_of, check_size, face_areas, surface_area, welded

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

FILLING = 0.68
"""Share of the square that charts fill as xatlas packs them: .68 to .73 on an object of 5,000 and of 100,000 faces. In
small textures padding and what is left of the square beside them take a third of that."""

PADDING = 4
"""Texels between charts: each has two of its own beside it, so two levels of mipmaps keep neighbours out."""

FILLING = 0.68
"""Share of the square that charts fill as xatlas packs them: .68 to .73 on an object of 5,000 and of 100,000 faces. In
small textures padding and what is left of the square beside them take a third of that."""

PART_FACES = 4096
"""Faces that are unwrapped together: xatlas's time grows faster than their number, 33 s for 100,000 at once and 4 s in
parts. The borders of parts become seams."""


def unwrap(scene: "Scene", size: int) -> Atlas:
    """An Atlas of a scene in a texture of size x size texels.

    Faces without an area get coordinates and no texels. Raises InputError for a size out of range and a scene without
    an area.
    """
    size = check_size(size)
    mesh = welded(scene)
    uv, faces, side = _charts(mesh.nodes, mesh.corners, np.sqrt(FILLING / surface_area(mesh)) * size)
    return atlas_of(scene, mesh, uv * (size / side), faces, size)


def size_for(scene: "Scene", detail: float) -> int:
    """The power of two from 256 to 4096 at which a texel is no wider than `detail`, in the scene's unit, if one is."""
    mesh = welded(scene)
    needed = np.sqrt(face_areas(mesh.nodes[:, :3], mesh.corners).sum() / FILLING) / max(detail, 1e-30)
    return int(2 ** np.clip(np.ceil(np.log2(max(needed, 1.0))), 8, 12))


def _charts(
    nodes: NDArray[np.float32], corners: NDArray[np.int64], texels_per_unit: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], int]:
    """xatlas: uv (W, 2) float64 in texels, faces (F, 3) of these, and the side of the square that they fill."""
    import xatlas

    atlas = xatlas.Atlas()
    parts = _parts(nodes[:, :3], corners)
    used = []
    # xatlas merges points below a fixed distance: scale every mesh to the same size.
    points = nodes[:, :3].astype(np.float64)
    low, extent = points[corners].min(axis=(0, 1)), float(np.ptp(points[corners], axis=(0, 1)).max())
    points = ((points - low) / extent).astype(np.float32)
    for part in parts:
        own, local = np.unique(corners[part], return_inverse=True)
        used.append(own)
        atlas.add_mesh(points[own], local.reshape(-1, 3).astype(np.uint32), nodes[own, 3:])
    packing = xatlas.PackOptions()
    packing.padding, packing.texels_per_unit, packing.resolution = PADDING + 2, texels_per_unit * extent, 0
    atlas.generate(xatlas.ChartOptions(), packing)
    uv, node, faces, count = [], [], np.zeros_like(corners), 0
    for index, part in enumerate(parts):
        origin, local, coordinates = atlas[index]
        uv.append(coordinates)
        node.append(used[index][origin])
        faces[part] = local.astype(np.int64) + count
        count += len(origin)
    uv = np.concatenate(uv).astype(np.float64) * [atlas.width, atlas.height]
    return *_without_holes(uv, np.concatenate(node), faces), max(atlas.width, atlas.height)


def _without_holes(
    uv: NDArray[np.float64], node: Integers, faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Give slivers that xatlas left out, at (0, 0), the coordinates of one of their corners in another face."""
    lost = np.flatnonzero((uv[faces] == 0.0).all(axis=(1, 2)))
    if len(lost) == 0:
        return uv, faces
    kept = np.ones(len(faces), bool)
    kept[lost] = False
    placed = np.full(node.max() + 1, -1)
    placed[node[faces[kept]]] = faces[kept]
    faces, added = faces.copy(), []
    for face in lost:
        known = placed[node[faces[face]]].max()
        added.append(uv[known] if known >= 0 else np.zeros(2))
    faces[lost] = len(uv) + 3 * np.arange(len(lost))[:, None] + np.arange(3)
    return np.concatenate([uv, np.repeat(added, 3, axis=0)]), faces


def _parts(points: Points, faces: Integers) -> list[Indices]:
    """Divide faces into compact parts of at most PART_FACES: list of ascending indices."""
    centers = points[faces].mean(axis=1)
    pending, parts = [np.arange(len(faces))], []
    while pending:
        part = pending.pop()
        if len(part) <= PART_FACES:
            parts.append(part)
            continue
        order = part[np.argsort(centers[part, np.ptp(centers[part], axis=0).argmax()], kind="stable")]
        pending += [np.sort(order[len(order) // 2 :]), np.sort(order[: len(order) // 2])]
    return parts
