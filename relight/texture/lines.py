"""The colour of a splat along short lines: what an eye right above a point of the surface would see there.

Along a line a Gaussian peaks once; seen in parallel perspective, its share of a pixel is its opacity times that peak.
Blended in the order of the peaks that is exactly what a rasteriser draws of a view straight from above, but each point
has its own view and nothing outside the line's ends stands before it.
"""

import numba
import numpy as np

from splat2mesh.splats import sh_basis_3dgs

FARTHEST_Q = 12.0
"""Squared standard deviations from its centre at which a Gaussian ends, as in the rasteriser."""

LEAST_ALPHA = np.float32(1 / 255)
"""Below this a Gaussian adds nothing, as in the rasteriser."""

MAX_ALPHA = np.float32(0.99)
"""One Gaussian never hides everything behind it, as in the rasteriser."""

LIST = 96
"""Gaussians kept along a line, nearest first."""

MEAN_OF_LOBE = (1.0, 2 / 3, 1 / 4, 0.0)
"""By degree: the mean of a harmonic over all directions from which a point is seen, weighted by the cosine, over its
value straight from above (Ramamoorthi, Hanrahan 2001). The value itself is no better (0.1 dB), and where no camera
looked from above it is anything; the first coefficient alone is 0.3 dB worse."""

_BATCH = 1 << 17


class Lines:
    """Splats, ready to be asked along lines near a surface. Rows that cannot be drawn are left out by the caller."""

    def __init__(
        self,
        splats,  # Splats, already dilated
        points,  # (T, 3) middles of all lines there will be
        reach,  # longest way from a middle to an end
    ):
        """Sort the splats into cells around the lines."""
        self._splats = splats
        shape = splats.rotation_matrices().transpose(0, 2, 1) / np.maximum(splats.scales, 1e-30)[:, :, None]
        center = np.einsum("nij,nj->ni", shape, splats.means)
        self._shapes = np.concatenate([shape.reshape(-1, 9), center], axis=1).astype(np.float32)
        # Of the ellipsoid where a Gaussian of this opacity falls to LEAST_ALPHA.
        visible = 2.0 * np.log(np.maximum(splats.opacities / LEAST_ALPHA, 1.0))
        extent = np.sqrt(np.minimum(visible, FARTHEST_Q))
        variances = np.einsum("nii->ni", splats.covariances())
        half = (extent[:, None] * np.sqrt(variances)).astype(np.float64)
        usual = float(np.median(half)) if len(half) else 1.0
        self._low = points.min(axis=0).astype(np.float64)
        extent = float(np.ptp(points, axis=0).max())
        self._cell = max(reach, usual, extent / 200.0, 1e-30)
        self._shape = np.floor((points.max(axis=0) - self._low) / self._cell).astype(np.int64) + 1
        occupied = np.unique(self._cells(points))
        self._number = np.full(int(self._shape.prod()), -1, np.int32)
        self._number[occupied] = np.arange(len(occupied))
        drawn = splats.opacities >= LEAST_ALPHA
        first = np.floor((splats.means - half - reach - self._low) / self._cell)
        last = np.floor((splats.means + half + reach - self._low) / self._cell)
        first = np.clip(first, 0, self._shape).astype(np.int64)
        last = np.clip(last, -1, self._shape - 1).astype(np.int64)
        last[~drawn] = -1
        counts = np.zeros(len(occupied) + 1, np.int64)
        _count(first, last, self._shape, self._number, counts)
        self._starts = np.concatenate([[0], np.cumsum(counts[:-1])])
        self._entries = np.empty(self._starts[-1], np.int32)
        _enter(first, last, self._shape, self._number, self._starts[:-1].copy(), self._entries)

    def colors(self, points, directions, above, below, advance=lambda count: None):
        """What is seen along lines: sRGB (T, 3) float32, not premultiplied, and alpha (T,) float32.

        points: (T, 3). directions: (T, 3) unit, towards the eye. above, below: (T,), where lines begin and end.
        """
        count, degree = len(points), self._splats.degree
        color, alpha = np.zeros((count, 3), np.float32), np.zeros(count, np.float32)
        by_coefficient = np.repeat(MEAN_OF_LOBE[: degree + 1], np.arange(degree + 1) * 2 + 1)
        for start in range(0, count, _BATCH):
            rows = slice(start, start + _BATCH)
            basis = sh_basis_3dgs(-directions[rows].astype(np.float32), degree) * by_coefficient
            cells = self._number[self._cells(points[rows])]
            _look(
                points[rows].astype(np.float32),
                directions[rows].astype(np.float32),
                above[rows].astype(np.float32),
                below[rows].astype(np.float32),
                cells,
                self._starts,
                self._entries,
                self._shapes,
                self._splats.opacities,
                np.ascontiguousarray(self._splats.sh),
                basis.astype(np.float32),
                color[rows],
                alpha[rows],
            )
            advance(len(cells))
        return color, alpha

    def _cells(self, points):
        cells = np.clip(np.floor((points - self._low) / self._cell).astype(np.int64), 0, self._shape - 1)
        return np.ravel_multi_index(cells.T, self._shape)


@numba.njit(cache=True, nogil=True)
def _count(first, last, shape, number, counts):
    for n in range(len(first)):
        for x in range(first[n, 0], last[n, 0] + 1):
            for y in range(first[n, 1], last[n, 1] + 1):
                for z in range(first[n, 2], last[n, 2] + 1):
                    cell = number[(x * shape[1] + y) * shape[2] + z]
                    if cell >= 0:
                        counts[cell] += 1


@numba.njit(cache=True, nogil=True)
def _enter(first, last, shape, number, ends, entries):
    for n in range(len(first)):
        for x in range(first[n, 0], last[n, 0] + 1):
            for y in range(first[n, 1], last[n, 1] + 1):
                for z in range(first[n, 2], last[n, 2] + 1):
                    cell = number[(x * shape[1] + y) * shape[2] + z]
                    if cell >= 0:
                        entries[ends[cell]] = n
                        ends[cell] += 1


@numba.njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _look(points, directions, above, below, cells, starts, entries, shapes, opacities, sh, basis, color, alpha):
    """Blend what each line meets, sorted by insertion: (T, 3) colors and (T,) alpha, each by one thread."""
    for t in numba.prange(len(points)):
        px, py, pz = points[t]
        dx, dy, dz = directions[t]
        places, shares, which = np.empty(LIST, np.float32), np.empty(LIST, np.float32), np.empty(LIST, np.int32)
        kept = 0
        for e in range(starts[cells[t]], starts[cells[t] + 1]):
            n = entries[e]
            m = shapes[n]
            ox = m[0] * px + m[1] * py + m[2] * pz - m[9]
            oy = m[3] * px + m[4] * py + m[5] * pz - m[10]
            oz = m[6] * px + m[7] * py + m[8] * pz - m[11]
            rx = m[0] * dx + m[1] * dy + m[2] * dz
            ry = m[3] * dx + m[4] * dy + m[5] * dz
            rz = m[6] * dx + m[7] * dy + m[8] * dz
            squared = rx * rx + ry * ry + rz * rz
            place = -(ox * rx + oy * ry + oz * rz) / squared
            if not (place <= above[t] and place >= -below[t]):
                continue
            wx, wy, wz = ox + place * rx, oy + place * ry, oz + place * rz
            q = wx * wx + wy * wy + wz * wz
            if not q <= FARTHEST_Q:
                continue
            share = min(opacities[n] * np.exp(np.float32(-0.5) * q), MAX_ALPHA)
            if share < LEAST_ALPHA:
                continue
            i = kept
            if kept == LIST:
                if place <= places[LIST - 1]:
                    continue
                i = LIST - 1
            else:
                kept += 1
            while i > 0 and places[i - 1] < place:
                places[i], shares[i], which[i] = places[i - 1], shares[i - 1], which[i - 1]
                i -= 1
            places[i], shares[i], which[i] = place, share, n
        through = np.float32(1.0)
        red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for i in range(kept):
            n, weight = which[i], through * shares[i]
            r, g, b = np.float32(0.5), np.float32(0.5), np.float32(0.5)
            for k in range(basis.shape[1]):
                r += basis[t, k] * sh[n, k, 0]
                g += basis[t, k] * sh[n, k, 1]
                b += basis[t, k] * sh[n, k, 2]
            red += weight * max(r, np.float32(0.0))
            green += weight * max(g, np.float32(0.0))
            blue += weight * max(b, np.float32(0.0))
            through -= weight
            if through < np.float32(1e-3):
                break
        alpha[t] = np.float32(1.0) - through
        if alpha[t] > 0.0:
            color[t, 0], color[t, 1], color[t, 2] = red / alpha[t], green / alpha[t], blue / alpha[t]
