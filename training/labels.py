"""The labels of the networks: the transfer of a mesh's vertices, ray traced by this project."""

import numpy as np

from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import raytraced, raytraced_scene

COLORS = 3


def transfer_labels(mesh, bands=3, rays=64, seed=0, filtered=True):
    """Transfer of a mesh, white and in its own shadow: (V, K) float32.

    filtered: averaged over neighbours, 1% off with 64 rays. Without, only noise separates it from the truth, which
    a network that could learn the filter's own errors needs.
    """
    occluder = Occluder(mesh.vertices, mesh.normals, mesh.faces)
    if filtered:
        return raytraced_scene(occluder, bands, rays, seed)
    return raytraced(occluder, slice(None), bands, rays, seed)


def as_rgb(transfer):
    """Grey transfer (V, K) as the paper's rows (V, 3 K): t_(3 j + k), harmonic j, colour k, all colours equal."""
    return np.repeat(transfer, COLORS, axis=1)
