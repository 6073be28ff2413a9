"""What the page packs, unpacked."""

import numpy as np


def from_rgbe(packed):
    """Radiance (..., 3) float32 of RGBE bytes (..., 4): the middle of the interval that rounds to them."""
    scale = np.ldexp(1.0, packed[..., 3:].astype(int) - 136)
    return np.where(packed[..., 3:] > 0, (packed[..., :3] + 0.5) * scale, 0.0).astype(np.float32)


def from_octahedral(packed):
    """Unit vectors (N, 3) float32 of `octahedral`."""
    u, v = packed.astype(np.float32).T / np.float32(127.0)
    z = 1.0 - np.abs(u) - np.abs(v)
    fold = np.maximum(-z, 0.0)
    normals = np.stack([u - np.copysign(fold, u), v - np.copysign(fold, v), z], axis=1)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
