"""Depth maps of many views fused into one signed distance field, and its zero surface as a mesh.

Source: Curless and Levoy, "A Volumetric Method for Building Complex Models from Range Images" (1996), with the distance
to each pixel's tangent plane instead of the distance along its ray.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.arrays import DepthMap, Faces, Floats, Integers, Points, Vector
from ..base.cells import CELLS, cells_of, keys_of
from ..base.distinct import distinct
from ..base.kernels import kernel
from ..base.meshlibrary import open3d
from ..base.threads import shared
from ..render.view import View

BLOCK = 8
"""Voxels along a block's side: only blocks near a surface exist."""

TRUNCATION = 2.0
"""Voxels within which the distance field is kept on either side of the surface."""

SHARP = 0.01
"""Spread of a surface, in units of the scene's radius, at which its weight is halved."""

ENOUGH_WEIGHT = 0.03
"""Sum of weights that a voxel needs before it takes part in the surface: little, or dark gloss becomes a sieve."""


@dataclass(frozen=True)
class PlaneMap:
    """One view's surface, ready for fusion. H, W are the view's size.

    plane: (H, W, 4) float32: unit normal in the world towards the camera, and camera z (NaN where there is none).
    weight: (H, W) float32 in [0, 1]: trust in the pixel.
    """

    view: View
    plane: np.ndarray
    weight: np.ndarray

    @classmethod
    def from_depth(cls, view: View, depth: DepthMap, normal: Floats, spread: Floats, radius: float) -> "PlaneMap":
        """Trust falls with the angle of incidence and with the spread of the surface relative to `radius`."""
        rays = view.ray_directions().astype(np.float32)
        frontal = -(rays * normal).sum(axis=-1) / np.linalg.norm(rays, axis=-1)
        weight = np.maximum(frontal, 0) / (1 + (spread / (SHARP * radius)) ** 2)
        plane = np.concatenate([normal, depth[..., None]], axis=-1).astype(np.float32, order="C")
        return cls(view, plane, np.where(np.isfinite(depth), weight, 0).astype(np.float32))


def fuse(maps: Sequence[PlaneMap], voxel: float, advance: Callable[[], None] = lambda: None) -> Any:
    """Fuse DepthMaps at a voxel size in world units. Returns an open3d TriangleMesh (legacy), in a fixed order."""
    o3d = open3d()

    origin = np.floor(np.mean([m.view.center for m in maps], axis=0))
    keys = _blocks_near(maps, origin, voxel)
    values = np.zeros((len(keys), BLOCK**3), np.float32)
    weights = np.zeros_like(values)
    for depth_map in maps:
        view = depth_map.view
        pose = view.camera_from_world.copy()
        pose[:3, 3] += pose[:3, :3] @ origin
        intrinsics = np.array([view.fx, view.fy, view.cx, view.cy])
        _integrate(len(keys), keys, voxel, pose, intrinsics, depth_map.plane, depth_map.weight, values, weights)
        advance()
    np.divide(values, weights, out=values, where=weights > 0)
    if not ((values < 0) & (weights > ENOUGH_WEIGHT)).any():  # open3d raises where there is no surface
        return o3d.geometry.TriangleMesh()
    grid = o3d.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), (o3d.core.float32, o3d.core.float32), ((1), (1)), voxel, BLOCK, len(keys) + 16
    )
    slots, _ = grid.hashmap().activate(o3d.core.Tensor(keys))
    slots = slots.numpy()
    for name, array in (("tsdf", values), ("weight", weights)):
        grid.attribute(name).numpy()[slots] = array.reshape(-1, BLOCK, BLOCK, BLOCK, 1)
    mesh = grid.extract_triangle_mesh(ENOUGH_WEIGHT)
    vertices, faces = mesh.vertex.positions.numpy().astype(np.float64), mesh.triangle.indices.numpy()
    vertices, faces = _in_fixed_order(vertices, faces)
    vertices, faces = o3d.utility.Vector3dVector(vertices + origin), o3d.utility.Vector3iVector(faces)
    return o3d.geometry.TriangleMesh(vertices, faces)


def _blocks_near(maps: Sequence[PlaneMap], origin: Vector, voxel: float) -> Integers:
    """Keys of the blocks within the truncation of any depth pixel: (B, 3) int32, sorted."""
    side, margin = BLOCK * voxel, TRUNCATION * voxel
    corners = np.stack(np.meshgrid(*[[-margin, margin]] * 3), axis=-1).reshape(-1, 3)
    found = []
    for m in maps:
        trusted = m.weight > 0.02
        points = m.view.center - origin + m.view.ray_directions()[trusted] * m.plane[trusted, 3:]
        cells = _unique_rows(np.floor(points / voxel).astype(np.int32)) * voxel
        for corner in corners:
            found.append(_unique_rows(np.floor((cells + corner) / side).astype(np.int32)))
    return _unique_rows(np.concatenate(found))


def _unique_rows(keys: Integers) -> Integers:
    """Rows (N, 3) int32, each once, in the order of their numbers."""
    if np.abs(keys).max(initial=0) >= CELLS // 2:  # too far out for a key
        return np.unique(keys, axis=0)
    return cells_of(distinct(keys_of(keys)))


def _in_fixed_order(vertices: Points, faces: Faces) -> tuple[Points, Faces]:
    """The same mesh, whatever the order in which threads wrote it: vertices by position, faces by index."""
    order = np.lexsort(vertices.T)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    corners = rank[faces]
    turn = corners.argmin(axis=1)[:, None]
    corners = np.take_along_axis(corners, (turn + np.arange(3)) % 3, axis=1)
    return vertices[order], corners[np.lexsort(corners.T[::-1])].astype(np.int32)


@shared
@kernel
def _integrate(
    begin: int,
    end: int,
    keys: Integers,
    voxel: float,
    pose: Floats,
    intrinsics: Floats,
    planes: Floats,
    trust: Floats,
    values: Floats,
    weights: Floats,
) -> None:
    height, width = trust.shape
    limit = TRUNCATION * voxel
    for b in range(begin, end):
        # The block's bounding sphere decides whether the view can see any of it.
        side = BLOCK * voxel
        half = 0.5 * side
        x, y, z = keys[b, 0] * side + half, keys[b, 1] * side + half, keys[b, 2] * side + half
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if depth < -1.8 * half:
            continue
        for i in range(BLOCK):
            for j in range(BLOCK):
                for k in range(BLOCK):
                    x = (keys[b, 0] * BLOCK + k) * voxel
                    y = (keys[b, 1] * BLOCK + j) * voxel
                    z = (keys[b, 2] * BLOCK + i) * voxel
                    cx = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
                    cy = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
                    cz = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
                    if cz <= 0:
                        continue
                    u = intrinsics[0] * cx / cz + intrinsics[2]
                    v = intrinsics[1] * cy / cz + intrinsics[3]
                    if not (0 <= u < width and 0 <= v < height):
                        continue
                    column, row = int(u), int(v)
                    surface, trusted = planes[row, column, 3], trust[row, column]
                    if not (surface > 0 and trusted > 0):
                        continue
                    ahead = surface - cz
                    if ahead < -3 * limit:
                        continue
                    # The pixel's surface point, and the voxel's distance to the tangent plane there.
                    px = (column + 0.5 - intrinsics[2]) / intrinsics[0] * surface
                    py = (row + 0.5 - intrinsics[3]) / intrinsics[1] * surface
                    dx, dy, dz = cx - px, cy - py, cz - surface
                    distance = 0.0
                    for axis in range(3):
                        along = pose[0, axis] * dx + pose[1, axis] * dy + pose[2, axis] * dz
                        distance += along * planes[row, column, axis]
                    if ahead > 3 * limit:
                        distance = limit
                    if distance < -limit:
                        continue
                    index = (i * BLOCK + j) * BLOCK + k
                    values[b, index] += trusted * min(distance / limit, 1.0)
                    weights[b, index] += trusted
