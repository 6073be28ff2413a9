"""Harmonics of Gaussians whose pictures differ by given amounts: least squares over all views at once.

Source: conjugate gradients on the normal equations, with Jacobi's preconditioner; Hestenes and Stiefel (1952).
"""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.screentiles import AREA
from splat2mesh.splats.splats import sh_basis_3dgs

from ..splats.blending import Blending

STEPS = 4
"""Twelve gain 0.01 dB on a trained table."""

RIDGE = 0.1
"""Pixels that hold each coefficient back: Gaussians that few pixels show change little. 2 loses 0.15 dB on a trained
table. A fifth of it for the constant one, which every view shows."""

BlendedView: TypeAlias = tuple[Blending, NDArray[np.int64], NDArray[np.float64]]
"""Blending of one view; (Q,) the pixels that count; (3,) the eye."""


def fitted(
    means: NDArray[np.float32],  # (N, 3) centres of the Gaussians of the views
    rows: NDArray[np.int64],  # (G,) those that may change
    views: Sequence[BlendedView],
    errors: Sequence[NDArray[np.float32]],  # of each view, (P, 3), what its pixels lack; 0 where they do not count
    degree: int,
) -> NDArray[np.float32]:
    """Changes (G, K, 3) float32 of the coefficients that best fit the missing light of pictures."""
    count, size = len(means), (degree + 1) ** 2
    seen = [np.flatnonzero(np.isin(rows, blending.splats)) for blending, _, _ in views]
    bases = [_basis(means[rows[mine]], eye, degree) for mine, (_, _, eye) in zip(seen, views, strict=True)]
    hold = np.full((1, size, 1), RIDGE, np.float32)
    hold[0, 0] = RIDGE / 5

    def drawn(change: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        pictures = []
        for (blending, known, _), mine, basis in zip(views, seen, bases, strict=True):
            colors = np.zeros((count, 3), np.float32)
            colors[rows[mine]] = np.einsum("gk,gkc->gc", basis, change[mine])
            picture = blending.drawn(colors)
            kept = np.zeros_like(picture)
            kept[known] = picture[known]
            pictures.append(kept)
        return pictures

    def gathered(pictures: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
        total = np.zeros((len(rows), size, 3), np.float32)
        for (blending, _, _), mine, basis, picture in zip(views, seen, bases, pictures, strict=True):
            sums = np.zeros((count, 3), np.float32)
            blending.spread(picture, sums)
            total[mine] += basis[:, :, None] * sums[rows[mine], None]
        return total

    weight = np.zeros((count, 3), np.float32)
    for blending, known, _ in views:
        ones = np.zeros((AREA * (len(blending.runs) - 1), 3), np.float32)
        ones[known] = 1.0
        blending.spread(ones, weight)
    scale = 1.0 / (0.3 * weight[rows][:, None] + hold + 0.5)

    left = [error.copy() for error in errors]
    change = np.zeros((len(rows), size, 3), np.float32)
    residual = gathered(left)
    step = scale * residual
    along = _dot(residual, step)
    for _ in range(STEPS):
        if along <= 0.0:
            break
        pictures = drawn(step)
        square = sum(_dot(picture, picture) for picture in pictures) + _dot(hold * step, step)
        length = np.float32(along / max(square, 1e-30))
        change += length * step
        for picture, lack in zip(pictures, left, strict=True):
            lack -= length * picture
        residual = gathered(left) - hold * change
        scaled = scale * residual
        along, before = _dot(residual, scaled), along
        step = scaled + np.float32(along / before) * step
    return change


def _basis(means: NDArray[np.float32], eye: NDArray[np.float64], degree: int) -> NDArray[np.float32]:
    """(G, K) of the directions from an eye to some centres."""
    away = means.astype(np.float64) - eye
    away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    return sh_basis_3dgs(away, degree).astype(np.float32)


def _dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    return float(np.sum(a * b, dtype=np.float64))
