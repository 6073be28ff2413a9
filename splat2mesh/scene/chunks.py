"""Cutting a mesh into sub-meshes below a vertex limit, which bounds a model's tensors."""

import numpy as np
from numpy.typing import NDArray

from ..base.choices import DEFAULT_MAX_VERTICES
from ..base.distinct import distinct
from ..base.errors import InputError
from .mesh import Mesh

SEAM_ALLOWANCE = 1.03
"""Vertices after a cut over vertices before it: what copying the seams adds, so equal parts still fit."""


def split(mesh: Mesh, max_vertices: int = DEFAULT_MAX_VERTICES) -> list[Mesh]:
    """Cut a mesh into chunks that stay below a number of vertices.

    max_vertices: of a chunk. Vertices without a face are left out. Raises InputError for a limit below 3.

    Faces are bisected by their centroids along the longest axis until every part fits, so chunks are compact in space,
    of similar size and few. A vertex on a seam is copied, attributes and all, into each chunk that uses it: normals are
    equal on both sides.
    """
    if max_vertices < 3:
        raise InputError(f"a chunk needs room for at least 3 vertices, the limit is {max_vertices}")
    centroids = mesh.vertices[mesh.faces].mean(axis=1)
    return [mesh.of_faces(faces) for faces in _bisect(mesh.faces, centroids, max_vertices)]


def _bisect(faces: NDArray[np.int32], centroids: NDArray[np.float32], max_vertices: int) -> list[NDArray[np.intp]]:
    pending, parts = [np.arange(len(faces))], []
    while pending:
        part = pending.pop()
        count = len(distinct(faces[part].ravel()))
        if count <= max_vertices:
            parts.append(part)
            continue
        wanted = int(np.ceil(SEAM_ALLOWANCE * count / max_vertices))
        axis = np.ptp(centroids[part], axis=0).argmax()
        order = part[np.argsort(centroids[part, axis], kind="stable")]
        middle = max(1, len(order) * (wanted // 2) // wanted)
        pending += [np.sort(order[middle:]), np.sort(order[:middle])]
    return parts
