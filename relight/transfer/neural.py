"""Transfer with shadows from few rays: a small network mixes several averages of them.

The network takes rotation-invariant numbers and returns weights, degree by degree (`features`), so its transfer turns
with the scene; it also returns the error that it expects. One network serves all numbers of bands and rays. Where
nothing is occluded, all averages agree, and the result equals that of `raytraced_scene`: exact.
"""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Transfer
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_order

from ..sh import harmonics
from .analytic import analytic
from .features import Estimates, describe, differing, estimate, mix
from .filtering import GUIDE_BANDS
from .occluder import Occluder
from .sessions import open_session, workers_of
from .visibility import Visibility, completed

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

MODEL = "neural"

BLOCK = 8192
"""Nodes the network is shown at once. Always the same ones, whatever the number of threads: not a bit changes."""


def neural(
    occluder: Occluder,
    bands: int,
    rays: int,  # per vertex
    seed: int = 0,
    advance: Advance = lambda count: None,  # called with the number of vertices done
) -> Transfer:
    """Transfer of all white vertices in the shadow of everything: (V, K) float32, as `raytraced_scene`.

    Vertices of equal position and normal get equal rows; no order of vertices or faces and no division into chunks
    changes a bit. The transfer of fewer bands is the first part of that of more, up to rounding.
    Raises InputError for bands outside 1..10, rays outside 1..65536, and without onnxruntime.
    """
    return neural_with_confidence(occluder, bands, rays, seed, advance)[0]


def neural_with_confidence(
    occluder: Occluder, bands: int, rays: int, seed: int = 0, advance: Advance = lambda count: None
) -> tuple[Transfer, NDArray[np.float32]]:
    """The transfer of `neural`, and the error that it expects of every vertex: (V,) float32, relative.

    That is the root of the expected squared error over a vertex's coefficients, over the norm of the transfer that
    an unoccluded vertex has: on that scale, because a vertex in the dark has next to none of its own. It is 0 where
    no ray within four rings met anything, or all did: the network knows no more than that.
    """
    harmonics.check_bands(bands)
    return from_visibility(Visibility(occluder, rays, seed, advance=advance), bands)


def from_visibility(visibility: Visibility, bands: int) -> tuple[Transfer, NDArray[np.float32]]:
    """Transfer (V, K) and expected error (V,) of rays that were traced before: see `neural_with_confidence`."""
    session, inner, node = _session(), max(bands, GUIDE_BANDS), visibility.neighbors.node
    model, rest = visibility.gathered(inner)
    estimates = estimate(visibility.neighbors, visibility.normals, model, rest, visibility.rays)
    transfer, error = mixed(session, estimates, visibility.normals, bands)
    return transfer[node], error[node]


def mixed(
    session: "InferenceSession",  # onnxruntime session of the network
    estimates: Estimates,  # Estimates of N nodes
    normals: NDArray[np.float32],  # (N, 3) float32, unit
    bands: int,  # at most those of the estimates
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Transfer (N, K) and expected relative error (N,), both float32, of the estimates as the network mixes them."""
    transfer, error = np.zeros((len(normals), bands**2), np.float32), np.zeros(len(normals), np.float32)
    open_norm = np.linalg.norm(analytic(np.array([[0.0, 1.0, 0.0]], np.float32), bands))

    def work(begin: int) -> None:
        end = min(begin + BLOCK, len(normals))
        part = slice(begin, end)
        complete = completed(normals[part], estimates.model[part], estimates.rest[part])
        chosen = differing(estimates, begin, end)
        if len(chosen):
            vertex, band = describe(estimates, begin, end, harmonics.evaluate(normals[part], _bands(estimates)), chosen)
            weights, squares = session.run(None, {"vertex": vertex, "band": np.ascontiguousarray(band[:, :bands])})
            mix(estimates, begin, chosen, weights, complete)
            variance = (2 * np.arange(bands) + 1) * squares * estimates.noise[begin + chosen, None]
            error[begin + chosen] = np.sqrt(variance.sum(axis=1)) / open_norm
        transfer[part] = complete[:, : bands**2]

    list(in_order(work, range(0, len(normals), BLOCK), workers=workers_of(session)))
    return transfer, error


@lru_cache(1)
def _session() -> "InferenceSession":
    """Opened once: that takes as long as some thousand vertices. One thread; the blocks share it, each from its own."""
    return open_session(MODEL, 1)


def _bands(estimates: Estimates) -> int:
    return int(np.sqrt(estimates.shadows.shape[2]))
