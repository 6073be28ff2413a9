"""The captured light refined by a small network, which generated captures under known lights trained.

Places and directions of the sky send each other messages along what each place sees: the network knows no frame but the
vertical, no number of places, and no material. It changes the logarithm of the light and keeps the median place as
bright as it was. Source: message passing on graphs (Gilmer et al., 2017), here along the transfer of light.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.color import luminance

from ..sh import harmonics
from ..transfer.sessions import open_session
from .evidence import LEAST, Evidence
from .posterior import PosteriorLight, Refinement, mean_radiance

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

MODEL = "captured-light"

PLACES, CELLS, BANDS = 640, 256, 7
"""Places that the network looks at, cells of the sphere that it has, and bands in which cells share a message."""

AROUND = 0.12
"""Spread, in radians, over which the change of a cell is blended, as in training: about half of a cell."""


class NetworkInputs(NamedTuple):
    """What the network is given, float32; luminance in parts of the median captured one.

    sky: (N, K) of LitPlaces. captured, bounced: (N,). upward: (N,) of the normals. light: (K,) log luminance. seen:
    (K, 3) shares seen unclipped, and clipped, and the log luminance of what was seen. pool: (K, CELLS) whether a
    direction lies in a cell. height: (CELLS,) of the cells. basis: (CELLS, H) orthonormal harmonics of them. spread:
    (CELLS, K) weights of cells at directions.
    """

    sky: NDArray[np.float32]
    captured: NDArray[np.float32]
    bounced: NDArray[np.float32]
    upward: NDArray[np.float32]
    light: NDArray[np.float32]
    seen: NDArray[np.float32]
    pool: NDArray[np.float32]
    height: NDArray[np.float32]
    basis: NDArray[np.float32]
    spread: NDArray[np.float32]


def inputs_of(evidence: Evidence, radiance: Floats, rows: NDArray[np.int64]) -> NetworkInputs:
    """The NetworkInputs of some of the places under radiance (K, 3)."""
    places = evidence.places
    captured, bounced = luminance(places.captured), luminance(places.bounced)
    unit = float(np.median(captured))
    seen = np.zeros((len(places.directions), 3))
    if evidence.sky is not None:
        clipped, open_sky = (evidence.sky_shares() * (places.directions[:, 1:] > 0.0)).T
        looked = np.log(luminance(np.exp(evidence.sky.log_radiance)) / unit)
        seen = np.stack([open_sky, clipped, np.where(open_sky > 0.0, looked, 0.0)], axis=1)
    light = np.log(np.maximum(luminance(radiance), LEAST) / unit)
    of_places = places.sky[rows], captured[rows] / unit, bounced[rows] / unit, places.normals[rows, 1]
    arrays = (*of_places, light, seen, *_cells(places.directions.tobytes()))
    return NetworkInputs(*(np.ascontiguousarray(each, np.float32) for each in arrays))


def refined(evidence: Evidence, lights: list[PosteriorLight]) -> list[PosteriorLight]:
    """The lights of a posterior, each changed as the network changes their mean."""
    directions = evidence.places.directions
    change = change_of(evidence, mean_radiance(lights, directions), _by_network)
    return [light._replace(refinement=Refinement(directions, change)) for light in lights]


def change_of(
    evidence: Evidence, radiance: Floats, network: Callable[[NetworkInputs], NDArray[np.float32]]
) -> NDArray[np.float64]:
    """(K,) to add to the log of radiance (K, 3) at the directions of the places."""
    places = evidence.places
    count = min(PLACES, len(places.captured))
    change = network(inputs_of(evidence, radiance, (np.arange(count) * len(places.captured)) // count))
    factors = np.stack([np.ones(len(change)), np.exp(change)], axis=1)
    direct = places.sky @ (factors * luminance(radiance)[:, None]).astype(np.float32)
    before, after = np.log(np.maximum(direct.T + luminance(places.bounced), LEAST))
    return np.asarray(change - np.median(after - before), np.float64)


def _by_network(inputs: NetworkInputs) -> NDArray[np.float32]:
    (change,) = _session().run(None, inputs._asdict())
    return np.asarray(change)


@lru_cache(maxsize=1)
def _session() -> "InferenceSession":
    return open_session(MODEL, 1, accelerated=False)


@lru_cache(maxsize=1)
def _cells(directions: bytes) -> tuple[Floats, Floats, Floats, Floats]:
    """pool, height, basis and spread of NetworkInputs for directions, the bytes of (K, 3) float64."""
    toward, middles = np.frombuffer(directions).reshape(-1, 3), fibonacci_sphere(CELLS)
    tree = scipy.spatial.cKDTree(middles)
    pool = np.eye(CELLS)[tree.query(toward)[1]]
    away, near = tree.query(toward, 3)
    weights = np.exp(-((away / AROUND) ** 2)) + 1e-9
    spread = np.zeros((CELLS, len(toward)))
    spread[near, np.arange(len(toward))[:, None]] = weights / weights.sum(axis=1, keepdims=True)
    basis = harmonics.evaluate(middles, BANDS) * np.sqrt(4.0 * np.pi / CELLS)
    return pool, middles[:, 1], basis, spread
