"""Splats of a few discs, for the tests of depth and surface."""

import numpy as np

from splat2mesh.splats.splats import SH_C0, Splats


def plain(means, scale, opacity=0.9, color=0.5, quats=(1, 0, 0, 0)):
    """Splats of one colour: means (N, 3); the rest is broadcast."""
    n = len(means)
    sh = np.broadcast_to((np.asarray(color) - 0.5) / SH_C0, (n, 3))[:, None]
    return Splats(
        means, np.broadcast_to(scale, (n, 3)), np.broadcast_to(quats, (n, 4)), np.broadcast_to(opacity, n) * 1.0, sh
    )


def discs(points, normals, radius, thickness):
    """Opaque flat splats: points (N, 3), unit normals (N, 3)."""
    quats = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], 0 * normals[:, 0]], axis=1)  # +z to normal
    return plain(points, [radius, radius, thickness], quats=quats)
