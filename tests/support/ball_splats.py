"""The splat of a solid ball."""

import numpy as np

from splat2mesh.splats.formats.encoding import sh_from_color
from splat2mesh.splats.splats import Splats

RADIUS, THICKNESS = 2.0, 0.01


RED, GREEN = np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.6, 0.2])


def solid_ball(count=3000):
    """Opaque flat Gaussians on a sphere in the splat's frame, y down: red where y < 0 (above), green below.

    Round ones fill it, so that nobody looks at it from inside.
    """
    inside = np.stack(np.meshgrid(*[np.arange(-1.75, 2, 0.35)] * 3), axis=-1).reshape(-1, 3)
    inside = inside[np.linalg.norm(inside, axis=1) < 1.75]
    shell = count - len(inside)
    k = np.arange(shell) + 0.5
    z, azimuth = 1 - 2 * k / shell, k * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z * z)
    normals = np.stack([r * np.cos(azimuth), r * np.sin(azimuth), z], axis=1)
    # The rotation from +z to n about z x n: half-way quaternion (1 + z.n, z x n).
    quats = np.stack([1 + z, -normals[:, 1], normals[:, 0], 0 * z], axis=1)
    width = 0.7 * RADIUS * np.sqrt(4 * np.pi / shell)
    means = np.vstack([RADIUS * normals, inside])
    return Splats(
        means=means,
        scales=np.vstack([np.tile([width, width, THICKNESS], (shell, 1)), np.full(inside.shape, 0.1)]),
        quats_wxyz=np.vstack([quats, np.tile([1, 0, 0, 0], (len(inside), 1))]),
        opacities=np.full(count, 0.97),
        sh=sh_from_color(np.where(means[:, 1:2] < 0, RED, GREEN))[:, None],
    )
