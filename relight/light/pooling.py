"""Lat-long images in fewer texels, each the mean over the solid angle that it covers."""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance


def pooled(image: Radiance, grid: tuple[int, int]) -> NDArray[np.float64]:
    """Return the mean radiance, (rows, columns, 3) float64, of a lat-long image (H, W, 3) in the cells of a grid."""
    rows, columns = pooling(image.shape[:2], grid)
    cells = [(columns @ (rows @ image[..., color]).T).T for color in range(3)]
    return np.stack(cells, axis=-1).astype(np.float64)


def pooling(shape: tuple[int, int], grid: tuple[int, int]) -> "tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]":
    """Sparse (rows, H) and (columns, W): what shares of their solid angle the cells of a grid take from an image."""
    rows = _overlap(grid[0], shape[0], lambda share: -np.cos(np.pi * share))
    return rows, _overlap(grid[1], shape[1], lambda share: share)


def _overlap(
    cells: int, texels: int, measure: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> "scipy.sparse.csr_array":
    """Sparse (cells, texels): the share of each cell's extent, as `measure` maps 0..1, that a texel takes."""
    edges = np.union1d(np.arange(cells + 1) / cells, np.arange(texels + 1) / texels)
    middle, extent = 0.5 * (edges[1:] + edges[:-1]), np.diff(measure(edges))
    cell = np.minimum((middle * cells).astype(int), cells - 1)
    texel = np.minimum((middle * texels).astype(int), texels - 1)
    whole = np.diff(measure(np.arange(cells + 1) / cells))
    return scipy.sparse.csr_array((extent / whole[cell], (cell, texel)), (cells, texels))
