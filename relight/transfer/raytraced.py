"""Transfer with shadows: the visibility of the whole scene, ray traced."""

import numpy as np

from .. import sh
from . import check_rays, sampling
from .analytic import analytic

BATCH_RAYS = 2**20
"""Rays in memory at once: 24 MiB."""


def raytraced(
    occluder,  # Occluder
    vertices,  # slice or (V,) indices into the occluder's vertices
    bands,
    rays,  # per vertex
    seed=0,
    advance=lambda count: None,  # called with the number of vertices done
):
    """Transfer of white vertices in the shadow of everything: (V, K) float32.

    Cosine-distributed rays about the vertex normal, with the unoccluded transfer as control variate: exact
    for what nothing hides, exactly 0 for what sees no sky. Surfaces hide light from both sides, so a vertex
    whose normal points into a closed body is black. Its own faces count like any others: they hide what a
    fold hides, and nothing at a convex vertex, above whose normal plane no face rises.
    A vertex's row depends on its position, its normal, the seed and the occluder, and on nothing else.
    Raises InputError for bands outside 1..10 and rays outside 1..65536.
    """
    sh.check_bands(bands)
    origins, normals = occluder.origins[vertices], occluder.normals[vertices]
    transfer = analytic(normals, bands)
    azimuths = sampling.fibonacci_azimuths(check_rays(rays))
    batch = max(1, BATCH_RAYS // len(azimuths))
    buffer = np.zeros((min(batch, len(origins)), len(azimuths), 6), np.float32)
    for start in range(0, len(origins), batch):
        part = slice(start, start + batch)
        shot = buffer[: len(origins[part])]
        sampling.shoot(origins[part], normals[part], azimuths, seed, shot)
        sampling.gather(shot, occluder.occluded(shot), transfer[part])
        advance(len(shot))
    return transfer
