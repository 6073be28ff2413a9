"""Move a mesh as glTF 2.0 does: keyframes, node transforms, joints and morph targets, as arrays.

Matrices act on column vectors from the left; rotations in glTF are quaternions x y z w. Source: glTF 2.0
specification, sections 3.7 (skins, morph targets) and 3.11 with appendix C (interpolation).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from splat2mesh.base.arrays import Floats, Integers, Matrix4
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltfnodes import for_normals
from splat2mesh.scene.mesh import unit

INTERPOLATIONS = "LINEAR", "STEP", "CUBICSPLINE"


class Track:
    """One property over time: keyframes and the interpolation between them.

    times: (T,) float64, s, rising. interpolation: one of INTERPOLATIONS. spherical: whether values are quaternions.
    """

    def __init__(
        self,
        times: ArrayLike,  # (T,)
        values: ArrayLike,  # (T, N), with CUBICSPLINE (T, 3, N): tangent in, value, tangent out
        interpolation: str = "LINEAR",
        spherical: bool = False,
    ) -> None:
        """Raises InputError for keyframes that do not fit or do not rise."""
        self.times, self.interpolation, self.spherical = np.asarray(times, np.float64), interpolation, spherical
        if interpolation not in INTERPOLATIONS:
            raise InputError(f"interpolation {interpolation!r}: expected one of {', '.join(INTERPOLATIONS)}")
        values = np.asarray(values, np.float64)
        expected = 3 if interpolation == "CUBICSPLINE" else 2
        if values.ndim != expected or len(values) != len(self.times) or not len(values):
            raise InputError(f"{interpolation} keyframes of shape {values.shape} do not fit {len(self.times)} times")
        if not (np.isfinite(self.times).all() and np.isfinite(values).all() and (np.diff(self.times) >= 0).all()):
            raise InputError("keyframes must be finite, and their times must not fall")
        keys = values[:, 1] if interpolation == "CUBICSPLINE" else values
        if spherical and not keys.any(axis=1).all():
            raise InputError("a keyframe is the rotation 0 0 0 0, which is none")
        self._values = values

    def at(self, time_s: float) -> NDArray[np.float64]:
        """The value at a time, (N,) float64; that of the first key before it, of the last after it."""
        values = self._values[:, 1] if self.interpolation == "CUBICSPLINE" else self._values
        after = int(np.searchsorted(self.times, time_s, side="right"))
        if after == 0 or after == len(self.times):
            return self._unit(values[0 if after == 0 else -1])
        before = after - 1
        span = self.times[after] - self.times[before]
        share = (time_s - self.times[before]) / span
        if self.interpolation == "STEP":
            return self._unit(values[before])
        if self.interpolation == "LINEAR":
            if self.spherical:
                turns = Rotation.from_quat(values[[before, after]])
                return np.asarray(Slerp([0.0, 1.0], turns)(share).as_quat())
            return (1.0 - share) * values[before] + share * values[after]
        square, cube = share**2, share**3
        leaving, arriving = span * self._values[before, 2], span * self._values[after, 0]
        value = (2 * cube - 3 * square + 1) * values[before] + (cube - 2 * square + share) * leaving
        return self._unit(value + (3 * square - 2 * cube) * values[after] + (cube - square) * arriving)

    def _unit(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        return value / max(float(np.linalg.norm(value)), 1e-300) if self.spherical else value


def morphed(
    base: NDArray[np.float32],  # (V, 3)
    targets: NDArray[np.float32],  # (M, V, 3) differences
    weights: Floats,  # (M,)
) -> NDArray[np.float32]:
    """The base plus the weighted differences, (V, 3) float32."""
    result = base.astype(np.float64)
    for target, weight in zip(targets, weights, strict=True):
        if weight != 0.0:
            result += weight * target
    return result.astype(np.float32)


def moved(
    vertices: NDArray[np.float32],  # (V, 3)
    normals: NDArray[np.float32],  # (V, 3)
    matrix: Matrix4,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points and normals under one matrix: (V, 3) float32 each, the normals unit, or 0 where they were."""
    turned = unit(normals @ for_normals(matrix).T)
    return (vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32), turned.astype(np.float32)


def skinned(
    vertices: NDArray[np.float32],  # (V, 3)
    normals: NDArray[np.float32],  # (V, 3)
    joints: Integers,  # (V, J) into the matrices
    weights: NDArray[np.float32],  # (V, J) rows that sum to 1
    matrices: Floats,  # (N, 4, 4): of every joint, its pose times its inverse bind matrix
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Linear blend skinning: as `moved`, each vertex under its own weighted mean of matrices."""
    shares = np.asarray(weights, np.float64)
    bound = np.where(shares[..., None, None] != 0.0, np.asarray(matrices, np.float64)[joints], 0.0)
    own = np.einsum("vj,vjrc->vrc", shares, bound)
    place = np.einsum("vrc,vc->vr", own[:, :3, :3], vertices) + own[:, :3, 3]
    turned = unit(np.einsum("vrc,vc->vr", for_normals(own), normals))
    return place.astype(np.float32), turned.astype(np.float32)
