"""The borders of patches of a surface, and which way leads from them into the patch.

A wall may end on a floor that has no vertex there. Its lowest vertices lie in the floor's plane, and rays from them
would be taken to start behind it, were they not to start a little up the wall.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Integers
from splat2mesh.base.kernels import kernel

OPEN_CHAIN = 0.3
"""Gap between the ends of the chain of edges around a vertex, over its length, above which the vertex is at a border.
Straight borders leave half and more, single faces 1; in a closed chain a face that is there twice leaves up to a
fifth."""

FIXED_POINT = 2.0**44
"""Edges are summed as integers, in this part of the unit, so that the order of faces changes no bit."""


@kernel
def inward_of_borders(
    vertices: NDArray[np.float32], normals: NDArray[np.float32], faces: Integers, place: Indices, distinct: Indices
) -> NDArray[np.float32]:
    """Unit directions along the surface from its borders inward, (V, 3) float32; 0 for all other vertices.

    The edges opposite a vertex form a chain around it. It closes inside a patch; at a border its ends are apart.
    vertices, normals: (V, 3) float32, unit frame. faces: (F, 3). place: (V,), a number that vertices of one position
    share. distinct: one vertex for each normal at each place; vertices that agree in both are one.
    """
    count = len(vertices)
    stands, first, following = np.full(count, -1), np.full(count, -1), np.full(count, -1)
    for d in distinct:
        following[d], first[place[d]] = first[place[d]], d
    chain, length = np.zeros((count, 3), np.int64), np.zeros(count, np.int64)
    for f in range(len(faces)):
        for corner in range(3):
            v, b, c = faces[f, corner], faces[f, (corner + 1) % 3], faces[f, (corner + 2) % 3]
            bx, by, bz = np.float64(vertices[b, 0]), np.float64(vertices[b, 1]), np.float64(vertices[b, 2])
            ex, ey, ez = vertices[c, 0] - bx, vertices[c, 1] - by, vertices[c, 2] - bz
            ax, ay, az = bx - vertices[v, 0], by - vertices[v, 1], bz - vertices[v, 2]
            facing = (ay * ez - az * ey) * normals[v, 0]
            facing += (az * ex - ax * ez) * normals[v, 1] + (ax * ey - ay * ex) * normals[v, 2]
            if facing == 0.0:  # without area, or on edge
                continue
            if stands[v] < 0:
                d = first[place[v]]
                while (
                    (normals[d, 0] != normals[v, 0])
                    or (normals[d, 1] != normals[v, 1])
                    or (normals[d, 2] != normals[v, 2])
                ):
                    d = following[d]
                stands[v] = d
            s, scale = stands[v], FIXED_POINT if facing > 0.0 else -FIXED_POINT  # whichever way round it is listed
            chain[s, 0] += np.int64(np.rint(scale * ex))
            chain[s, 1] += np.int64(np.rint(scale * ey))
            chain[s, 2] += np.int64(np.rint(scale * ez))
            length[s] += np.int64(np.rint(FIXED_POINT * np.sqrt(ex * ex + ey * ey + ez * ez)))
    inward = np.zeros((count, 3), np.float32)
    for v in range(count):
        s = stands[v]
        if s < 0:
            continue
        x, y, z = np.float64(chain[s, 0]), np.float64(chain[s, 1]), np.float64(chain[s, 2])
        nx, ny, nz = np.float64(normals[v, 0]), np.float64(normals[v, 1]), np.float64(normals[v, 2])
        x, y, z = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
        norm = np.sqrt(x * x + y * y + z * z)
        if norm > OPEN_CHAIN * length[s]:
            inward[v, 0], inward[v, 1], inward[v, 2] = x / norm, y / norm, z / norm
    return inward
