"""Splats moved by similarity transforms, harmonics and all."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..base.errors import InputError
from ..base.threads import ROWS_AT_ONCE
from .harmonics import sh_basis_3dgs
from .splats import Splats

SAME = 1e-6
"""Relative error up to which a matrix counts as a similarity: float32 matrices pass, what a user could see does not."""


def similarity(
    scale: float = 1.0,
    rotation: ArrayLike | None = None,  # (3, 3)
    translation: ArrayLike = (0.0, 0.0, 0.0),
) -> NDArray[np.float64]:
    """Return the matrix of p -> scale * rotation @ p + translation. rotation: (3, 3), or None, none turns nothing.
    translation: (3,). Returns (4, 4) float64."""
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.asarray(np.eye(3) if rotation is None else rotation)
    matrix[:3, 3] = translation
    return matrix


def parts_of(matrix: ArrayLike) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Take a similarity transform apart.

    matrix: (4, 4). Returns scale; rotation: (3, 3) float64; translation: (3,) float64. Raises InputError for a matrix
    that shears, scales axes unequally, mirrors, projects, or holds NaN: a Gaussian splat turned by it would not look
    the same.
    """
    matrix = np.asarray(matrix, np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise InputError(f"expected a (4, 4) matrix of finite numbers, found {_text(matrix)}")
    if np.any(matrix[3] != [0, 0, 0, 1]):
        raise InputError(f"the last row of a transform is 0 0 0 1, found {_text(matrix[3])}")
    linear = matrix[:3, :3]
    scale = np.sqrt(np.mean(np.sum(linear * linear, axis=0)))
    if not np.abs(linear.T @ linear - scale**2 * np.eye(3)).max() <= SAME * scale**2 or scale == 0:
        lengths = np.linalg.norm(linear, axis=0)
        raise InputError(
            "splats can only be turned, moved and scaled alike in all directions: the axes of the matrix have lengths "
            f"{_text(lengths)} or are not at right angles"
        )
    if np.linalg.det(linear) < 0:
        raise InputError("the matrix mirrors: splats can be turned, moved and scaled, not mirrored")
    return float(scale), linear / scale, matrix[:3, 3]


def placed(splats: Splats, matrix: ArrayLike) -> Splats:
    """Return splats as seen in another frame: each looks there from everywhere as it did before.

    splats: rows that are not finite stay so. matrix: (4, 4), similarity, new_from_old. Returns Splats: row by row; the
    same object for the identity. Raises InputError for any other transform.
    """
    scale, rotation, translation = parts_of(matrix)
    if np.array_equal(np.asarray(matrix, np.float64), np.eye(4)):
        return splats
    with np.errstate(over="ignore", invalid="ignore"):  # `clean` drops and counts what leaves float32
        means = splats.means.astype(np.float64) @ (scale * rotation).T + translation
        return replace(
            splats,
            means=means,
            scales=splats.scales * scale,
            quats_wxyz=_times(
                np.roll(scipy.spatial.transform.Rotation.from_matrix(rotation).as_quat(), 1),
                splats.quats_wxyz.astype(np.float64),
            ),
            sh=_turned(splats.sh, sh_rotation_3dgs(rotation, splats.degree)),
            facts=splats.facts.turned(scale * rotation),
        )


def reframed(splats: Splats, matrix: ArrayLike) -> Splats:
    """Return splats whose axes are others: turned, or mirrored as a file of the other handedness has them.

    matrix: (3, 3), orthogonal, new_from_old. Returns Splats: row by row; the same object for the identity.

    A mirror is the inversion p -> -p before a rotation. It keeps the rotation of a Gaussian, which is even, and changes
    the sign of the harmonics of odd degree. Source: d -> -d in the definition of the harmonics.
    """
    matrix = np.asarray(matrix, np.float64)
    if np.linalg.det(matrix) < 0:
        degree = np.repeat(np.arange(splats.degree + 1), 2 * np.arange(splats.degree + 1) + 1)
        odd = np.where(degree % 2, -1, 1).astype(np.float32)
        facts = splats.facts.turned(-np.eye(3))
        splats = replace(splats, means=-splats.means, sh=splats.sh * odd[:, None], facts=facts)
        matrix = -matrix
    return placed(splats, similarity(rotation=matrix))


def placed_mesh(mesh: Any, matrix: ArrayLike) -> Any:
    """Return a mesh as seen in another frame. mesh: of `scene.mesh`. matrix: (4, 4), similarity, new_from_old. Raises
    InputError for any other transform."""
    scale, rotation, translation = parts_of(matrix)
    vertices = mesh.vertices.astype(np.float64) @ (scale * rotation).T + translation
    normals = mesh.normals.astype(np.float64) @ rotation.T
    return replace(mesh, vertices=vertices.astype(np.float32), normals=normals.astype(np.float32))


def sh_rotation_3dgs(rotation: ArrayLike, degree: int) -> NDArray[np.float64]:
    """Return the matrix that turns coefficients with the signs of 3DGS.

    rotation: (3, 3), R. degree: 0 to 3. Returns (K, K) float64: M c are the coefficients of f(R^-1 d) when c are those
    of f(d). Entries of quarter turns are exactly 0 and +-1.

    M_ij is the integral of Y_i(R d) Y_j(d), which the quadrature evaluates exactly, degree by degree.
    """
    directions, weights = _quadrature(degree)
    matrix = sh_basis_3dgs(directions @ np.asarray(rotation).T, degree).T @ (
        sh_basis_3dgs(directions, degree) * weights[:, None]
    )
    of_coefficient = np.repeat(np.arange(degree + 1), 2 * np.arange(degree + 1) + 1)
    # The quadrature is right to some 1e-15; without that noise a quarter turn keeps every bit of a coefficient.
    return np.where(of_coefficient[:, None] == of_coefficient, matrix.round(13), 0.0)


@lru_cache
def _quadrature(degree: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (N, 3) and weights (N,) that integrate products of two functions of the degree."""
    z, weight = np.polynomial.legendre.leggauss(degree + 1)
    steps = 2 * degree + 1
    angle = 2 * np.pi * np.arange(steps) / steps
    z, angle = (grid.ravel() for grid in np.meshgrid(z, angle, indexing="ij"))
    radius = np.sqrt(1 - z * z)
    directions = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    return directions, np.repeat(weight * (2 * np.pi / steps), steps)


def _turned(sh: NDArray[np.float32], matrix: NDArray[np.float64]) -> NDArray[np.float32]:
    """(N, K, 3) coefficients turned; the constant ones keep every bit."""
    turned = sh.copy()
    for start in range(0, len(sh), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        turned[rows, 1:] = np.matmul(matrix[1:, 1:], sh[rows, 1:])
    return turned


def _times(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternion products: first (4,), second (N, 4), wxyz -> (N, 4)."""
    w, x, y, z = first
    matrix = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return second @ matrix.T


def _text(values: ArrayLike) -> str:
    return " ".join(f"{value:g}" for value in np.ravel(values))
