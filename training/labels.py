"""The labels of the network: the transfer of a mesh's vertices, ray traced by this project."""

import numpy as np

from relight.transfer.occluder import Occluder
from relight.transfer.visibility import raytraced_scene

COLORS = 3


def transfer_labels(mesh, bands=3, rays=64, seed=0):
    """Transfer of a mesh, white and in its own shadow, 1% off with 64 rays: (V, K) float32."""
    return raytraced_scene(Occluder(mesh.vertices, mesh.normals, mesh.faces), bands, rays, seed)


def as_rgb(transfer):
    """Grey transfer (V, K) as the paper's rows (V, 3 K): t_(3 j + k), harmonic j, colour k, all colours equal."""
    return np.repeat(transfer, COLORS, axis=1)
