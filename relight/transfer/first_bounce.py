"""The first bounce of a light, by more rays than a matrix of bounces keeps: gathered as they are traced.

Light that is concentrated, such as the pool of a spot on a floor, is met by few of the rays of a vertex. The noise
that follows is in the first bounce; later ones start from light that has spread.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers
from splat2mesh.base.kernels import kernel
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_slices

from . import check_rays, sampling
from .bounce_places import batch_of
from .facing import is_front
from .occluder import Occluder


def first_bounce(
    occluder: Occluder,
    sent: NDArray[np.float32],
    rays: int,
    rows: NDArray[np.int64] | slice = slice(None),
    seed: int = 0,
    advance: Advance = lambda count: None,
    met: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return what white vertices send on of the light that other surfaces send to them, (N, 3) float32.

    occluder: the surfaces. The back of a face is black, as in `transfer.bounces`. sent: (V, 3) float32, exit radiance
    of its vertices. rays: from each vertex, cosine-distributed. Raises InputError outside 1..65536. rows: (N,) int, the
    vertices that gather; all without. seed: of the directions. advance: called with the number of vertices done. met:
    (N,) float32, takes the share of the rays of each vertex that met anything.
    """
    azimuths = sampling.fibonacci_azimuths(check_rays(rays))
    origins, normals = occluder.origins[rows], occluder.normals[rows]
    gathered, batch = np.zeros((len(origins), 3), np.float32), batch_of(rays)
    shot = np.zeros((min(batch, len(origins)), rays, 6), np.float32)
    for start in range(0, len(origins), batch):
        part = slice(start, start + batch)
        some = shot[: len(origins[part])]
        sampling.shoot(origins[part], normals[part], azimuths, seed, some)
        hits = occluder.first_hits(some)[1:]
        if met is not None:
            met[part] = (hits[0] >= 0).mean(axis=1)
        in_slices(_gather, len(some), some, *hits, occluder.faces, occluder.normals, sent, gathered[part])
        advance(len(some))
    return gathered


@kernel
def _gather(
    begin: int,
    end: int,
    rays: NDArray[np.float32],
    faces: Integers,
    uv: NDArray[np.float32],
    normals: NDArray[np.float32],
    corners: Integers,
    vertex_normals: NDArray[np.float32],
    sent: NDArray[np.float32],
    gathered: NDArray[np.float32],
) -> None:
    for v in range(begin, end):
        red, green, blue = 0.0, 0.0, 0.0
        for i in range(rays.shape[1]):
            face = faces[v, i]
            if face < 0 or not is_front(normals[v, i], rays[v, i, 3:], corners[face], vertex_normals):
                continue
            a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
            second = min(max(uv[v, i, 0], np.float32(0)), np.float32(1))
            third = min(max(uv[v, i, 1], np.float32(0)), np.float32(1) - second)
            first = np.float32(1) - second - third
            red += first * sent[a, 0] + second * sent[b, 0] + third * sent[c, 0]
            green += first * sent[a, 1] + second * sent[b, 1] + third * sent[c, 1]
            blue += first * sent[a, 2] + second * sent[b, 2] + third * sent[c, 2]
        gathered[v, 0] = red / rays.shape[1]
        gathered[v, 1] = green / rays.shape[1]
        gathered[v, 2] = blue / rays.shape[1]
