"""Projections of environment images: canonical lat-long, light probes resampled to it, and images in fewer texels.

Canonical lat-long (OpenEXR's definition): row 0 is +y, the centre looks at +z, +x is a quarter from the left.
"""

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask, Radiance
from splat2mesh.base.sphere import row_solid_angles as row_solid_angles
from splat2mesh.base.sphere import texel_directions

from ..sh import rotors
from ..sh.latlong import project_latlong

_DARK = 0.1  # mean outside the picture over the median inside, at most: black, but with room for a logo in a corner
SUBSAMPLES = 4  # a side of each texel: a sun as wide as one keeps its energy to within 1 to 3%

# Vertical cross: (column, row) of each face, and the directions of its centre, its right and its lower edge.
_CROSS_FACES = (
    ((1, 0), (0, 1, 0), (1, 0, 0), (0, 0, -1)),
    ((0, 1), (-1, 0, 0), (0, 0, -1), (0, -1, 0)),
    ((1, 1), (0, 0, -1), (1, 0, 0), (0, -1, 0)),
    ((2, 1), (1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ((1, 2), (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ((1, 3), (0, 0, 1), (1, 0, 0), (0, 1, 0)),
)


def recognise(image: Radiance) -> str | None:
    """Recognise the projection of an image (H, W, 3) by its aspect and its black regions.

    "lat-long" for 2:1; "angular map" for a square that is black outside its circle; "vertical cross" for 3:4 with black
    cells where no face is; None for anything else.
    """
    height, width = image.shape[:2]
    if width == 2 * height:
        return "lat-long"
    if width == height and _is_black_outside(image, _angular_inside(width)):
        return "angular map"
    if 4 * width == 3 * height and width % 3 == 0 and _is_black_outside(image, _cross_inside(width // 3)):
        return "vertical cross"
    return None


def latlong_from_angular(image: Radiance) -> NDArray[np.float32]:
    """Resample Debevec's angular map (www.pauldebevec.com/Probes), (N, N, 3), as lat-long (N / 2, N, 3) float32.

    Its centre is -z, right +x, top +y, its radius proportional to the angle.
    """
    size = image.shape[0]

    def pixel(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats]:
        across = np.hypot(x, y)
        # Bilinear lookups that straddled the rim would mix in the black beyond it.
        radius = np.minimum(np.arctan2(across, -z) / np.pi, 1.0 - 3.0 / size)
        radius *= 0.5 * size / np.maximum(across, 1e-12)
        return 0.5 * size + radius * x, 0.5 * size - radius * y

    return _resample(image, max(1, size // 2), pixel)


def latlong_from_cross(image: Radiance) -> NDArray[np.float32]:
    """Resample a vertical cross of cube faces, (4 F, 3 F, 3), as lat-long (2 F, 4 F, 3) float32.

    Rows of faces: +y / -x, -z, +x / -y / +z upside down.
    """
    face = image.shape[1] // 3

    def pixel(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats]:
        directions = np.stack([x, y, z])
        column, row = np.zeros((2, *x.shape))
        largest = np.abs(directions).max(axis=0)
        for cell, forward, right, down in _CROSS_FACES:
            hit = np.tensordot(forward, directions, 1) >= largest
            local = directions[:, hit] / largest[hit]
            # Texel centres bound the lookup: beyond them lies another face, or nothing.
            u, v = (0.5 * face * (1.0 + np.dot(axis, local)) for axis in (right, down))
            u, v = np.clip((u, v), 0.5, face - 0.5)
            column[hit], row[hit] = u + face * cell[0], v + face * cell[1]
        return column, row

    return _resample(image, 2 * face, pixel)


def latlong_turned(image: Radiance, rotor: Floats, rotation_deg: float = 0.0) -> NDArray[np.float32]:
    """Resample a lat-long image (H, W, 3) as turned by a rotor of `relight.sh.rotors`, (4,): L(d) becomes L(R^-1 d).

    rotation_deg: turn about +y before it. Returns (H, 2 H, 3) float32, with the mean radiance of the image.
    """
    height, width = image.shape[:2]
    ends = [np.roll(image[row : row + 1], width // 2, axis=1) for row in (0, height - 1)]  # beyond a pole
    padded = np.pad(np.concatenate([ends[0], image, ends[1]]), ((0, 0), (1, 1), (0, 0)), mode="wrap")
    back = np.asarray(rotor) * [1.0, -1.0, -1.0, -1.0]

    def pixel(x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats]:
        # Harmonics of degree 1 are y, z and x, so they turn as directions do.
        turned = rotors.rotate(np.stack([np.zeros_like(x), y, z, x]).reshape(4, -1), back)
        _, y, z, x = turned.reshape(4, *x.shape)
        around = (0.5 - np.arctan2(x, z) / (2.0 * np.pi) + rotation_deg / 360.0) % 1.0
        return around * width + 1.0, (0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * height + 1.0

    turned = _resample(padded, height, pixel)
    before, after = project_latlong(image, 1)[0], project_latlong(turned, 1)[0]
    return (turned * np.where(after > 0.0, before / np.maximum(after, 1e-30), 1.0)).astype(np.float32)


def _resample(
    image: Radiance, height: int, pixel: Callable[[Floats, Floats, Floats], tuple[Floats, Floats]]
) -> NDArray[np.float32]:
    """Lat-long (height, 2 height, 3) float32: the mean of bilinear lookups over each texel, by solid angle.

    pixel: function of a direction's x, y, z to image coordinates (column, row), texel centres at + 1/2.
    """
    width, k = 2 * height, SUBSAMPLES
    result = np.zeros((height, width, 3), np.float32)
    rows = max(1, 2**18 // (width * k * k))
    for start in range(0, height, rows):
        stop = min(start + rows, height)
        directions = texel_directions(height * k, width * k, slice(start * k, stop * k))
        column, row = pixel(*np.moveaxis(directions, -1, 0))
        weight = np.hypot(directions[..., 0], directions[..., 2])  # cos(latitude)
        blocks = (stop - start, k, width, k)
        total = weight.reshape(blocks).sum(axis=(1, 3))
        for channel in range(3):
            values = scipy.ndimage.map_coordinates(
                image[..., channel], (row - 0.5, column - 0.5), order=1, mode="nearest"
            )
            result[start:stop, :, channel] = (values * weight).reshape(blocks).sum(axis=(1, 3)) / total
    return result


def _is_black_outside(image: Radiance, inside: Mask) -> bool:
    brightness = np.max(image, axis=2)
    outside = brightness[~inside]
    median = np.median(brightness[inside])
    return outside.size > 0 and median > 0 and np.minimum(outside, median).mean() <= _DARK * median


def _angular_inside(size: int) -> Mask:
    """(N, N) bool: within the circle, with two texels to spare for soft rims."""
    offset = np.arange(size) + 0.5 - 0.5 * size
    return np.hypot(offset, offset[:, None]) <= 0.5 * size + 2.0


def _cross_inside(face: int) -> Mask:
    """(4 F, 3 F) bool: the six cells that hold a face."""
    cells = np.zeros((4, 3), bool)
    for (column, row), *_ in _CROSS_FACES:
        cells[row, column] = True
    return cells.repeat(face, axis=0).repeat(face, axis=1)


def texel_parts(
    row: Integers, column: Integers, height: int, width: int, parts: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Divide T texels of a lat-long image into P = `parts` along each side.

    Returns unit vectors (T, P^2, 3) to the middles of the parts, canonical frame, and their solid angles (T, P^2), sr.
    """
    step = np.arange(parts)
    fine_row = row[:, None] * parts + step
    longitude = np.pi * (1.0 - 2.0 * (column[:, None] * parts + step + 0.5) / (width * parts))
    edge = np.cos(np.pi * np.stack([fine_row, fine_row + 1]) / (height * parts))
    latitude = np.pi * (0.5 - (fine_row + 0.5) / (height * parts))[:, :, None]
    x, z = np.cos(latitude) * np.sin(longitude)[:, None], np.cos(latitude) * np.cos(longitude)[:, None]
    toward = np.stack([x, np.broadcast_to(np.sin(latitude), x.shape), z], axis=-1)
    area = np.broadcast_to(((edge[0] - edge[1]) * (2.0 * np.pi / (width * parts)))[:, :, None], x.shape)
    return toward.reshape(len(row), parts * parts, 3), area.reshape(len(row), parts * parts)


def pooled(image: Radiance, grid: tuple[int, int]) -> NDArray[np.float64]:
    """Return the mean radiance, (rows, columns, 3) float64, of a lat-long image (H, W, 3) in the cells of a grid."""
    rows, columns = pooling(image.shape[:2], grid)
    cells = [(columns @ (rows @ image[..., color]).T).T for color in range(3)]
    return np.stack(cells, axis=-1).astype(np.float64)


def pooling(shape: tuple[int, int], grid: tuple[int, int]) -> tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]:
    """Sparse (rows, H) and (columns, W): what shares of their solid angle the cells of a grid take from an image."""
    rows = _overlap(grid[0], shape[0], lambda share: -np.cos(np.pi * share))
    return rows, _overlap(grid[1], shape[1], lambda share: share)


def _overlap(
    cells: int, texels: int, measure: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> scipy.sparse.csr_array:
    """Sparse (cells, texels): the share of each cell's extent, as `measure` maps 0..1, that a texel takes."""
    edges = np.union1d(np.arange(cells + 1) / cells, np.arange(texels + 1) / texels)
    middle, extent = 0.5 * (edges[1:] + edges[:-1]), np.diff(measure(edges))
    cell = np.minimum((middle * cells).astype(int), cells - 1)
    texel = np.minimum((middle * texels).astype(int), texels - 1)
    whole = np.diff(measure(np.arange(cells + 1) / cells))
    return scipy.sparse.csr_array((extent / whole[cell], (cell, texel)), (cells, texels))
