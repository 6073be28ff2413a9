"""Rays of vertices that share nothing with their neighbours: what the transfer of a scene is compared with."""

import numpy as np

from relight.sh import harmonics
from relight.transfer import check_rays, sampling
from relight.transfer.occluder import BATCH_RAYS
from relight.transfer.visibility import completed


def raytraced(occluder, vertices, bands, rays, seed=0):
    """Transfer of some white vertices in the shadow of everything: (V, K) float32, unfiltered.

    vertices: slice or (V,) indices into those of the Occluder. rays: per vertex.

    Cosine-distributed rays about the vertex normal, with a linear model of the visibility as control variate
    (`sampling.gather`): exact for what nothing hides, exactly 0 for what sees no sky. Surfaces hide light from both
    sides, so a vertex whose normal points into a closed body is black. Its own faces count like any others: they
    occlude the same directions as the fold, and none at a convex vertex, above whose normal plane no face rises.
    A vertex's row depends on its position, its normal, the seed and the occluder, and on nothing else.
    Raises InputError for bands outside 1..10 and rays outside 1..65536.
    """
    bands, rays = harmonics.check_bands(bands), check_rays(rays)
    origins, normals = occluder.origins[vertices], occluder.normals[vertices]
    transfer = np.zeros((len(origins), bands**2), np.float32)

    def offsets(part):
        return sampling.hashed_offsets(origins[part], normals[part], seed)

    for part, (model, rest) in trace(occluder, origins, normals, bands, rays, offsets):
        transfer[part] = completed(normals[part], model, rest)
    return transfer


def offsets_by_rank(part, seed):
    """Ray offsets of a slice of nodes, by their ranks along the curve."""
    return sampling.ranked_offsets(np.arange(part.start, part.stop), seed)


def trace(occluder, origins, normals, bands, rays, offsets):
    """Visibility of batches of vertices: their slice, and (model, rest) as `sampling.gather` separates them."""
    azimuths = sampling.fibonacci_azimuths(rays)
    batch = max(1, BATCH_RAYS // rays)
    buffer = np.zeros((min(batch, len(origins)), rays, 6), np.float32)
    for start in range(0, len(origins), batch):
        part = slice(start, min(start + batch, len(origins)))
        shot = buffer[: part.stop - start]
        sampling.shoot_at(origins[part], normals[part], azimuths, offsets(part), shot)
        model, rest = np.zeros((len(shot), 4), np.float32), np.zeros((len(shot), bands**2), np.float32)
        sampling.gather(shot, occluder.occluded(shot), normals[part], model, rest)
        yield part, (model, rest)
