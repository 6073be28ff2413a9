"""The directions in which a surface point sees the light, and the colour of its occluders, in a few numbers."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Matrix3, Radiance
from splat2mesh.base.sphere import EVENLY, fibonacci_sphere
from splat2mesh.base.threads import in_batches
from splat2mesh.render.raycaster import corner_weights

from ..sh import harmonics
from ..splats.attachment import Surface
from ..transfer.occluder import BATCH_RAYS
from .pixels import LIFT

BANDS = 2
"""Bands of the visibility: four numbers. Nine made no difference on a trained glossy table, whose lobes blur all
edges."""

RIDGE = 0.02
"""Of the directions above a surface, on all coefficients but the constant one: half a sphere separates them badly.
Without occlusion the fit stays exact."""


def openness(
    surface: Surface, nodes: Indices, colors: Radiance, scene: Matrix3
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The open directions above some nodes of a Surface.

    nodes: (N,) their numbers. colors: (M, 3) linear, of all nodes. scene: (3, 3) rotation from the frame of the splat
    into the scene's. Returns (N, 4) SH coefficients of visibility, frame of the scene, valid only above the surface,
    and (N, 3), the mean colour of the occluders, 0 without any.
    """
    toward = fibonacci_sphere(EVENLY)
    basis = harmonics.evaluate(toward @ scene.T, BANDS)
    hold = np.diag([0.0] + [RIDGE] * (BANDS**2 - 1))
    visible, hidden = np.zeros((len(nodes), BANDS**2), np.float32), np.zeros((len(nodes), 3), np.float32)

    def see(rows: slice) -> None:
        points, normals = surface.points[nodes[rows]], surface.normals[nodes[rows]]
        above = (normals @ toward.T.astype(np.float32)) > 0.0
        place, way = np.nonzero(above)
        start = points[place] + LIFT * surface.diagonal * normals[place]
        hits = surface.caster.first_hits(np.concatenate([start, toward[way]], axis=1).astype(np.float32))
        met = np.isfinite(hits.distance)
        seen = np.zeros(above.shape)
        seen[place, way] = ~met
        square = np.einsum("nd,di,dj->nij", above.astype(np.float64), basis, basis, optimize=True)
        count = above.sum(axis=1)
        # A coefficient of a function that is 1 everywhere is sqrt(4 pi) in the constant one: then all others stay 0.
        moments = seen @ basis
        visible[rows] = np.linalg.solve(square + count[:, None, None] * hold, moments[:, :, None])[:, :, 0]
        sent = np.einsum("nk,nkc->nc", corner_weights(hits.uv[met]), colors[surface.faces[hits.faces[met]]])
        total = np.stack([np.bincount(place[met], column, len(points)) for column in sent.T], axis=1)
        hidden[rows] = total / np.maximum(np.bincount(place[met], minlength=len(points)), 1)[:, None]

    in_batches(see, len(nodes), BATCH_RAYS // EVENLY)
    return visible, hidden
