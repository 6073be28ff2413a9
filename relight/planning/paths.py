"""Measure the bounced light by a few random paths from the vertices of a sample, without matrix or transfer.

The product of two halves of the paths is the squared size of each bounce without bias from noise.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Radiance

from ..sh import harmonics
from ..transfer import FEW_BANDS
from ..transfer.facing import met_in_front
from .costs import FOLLOWED
from .sample import Sample

PATHS = 24  # of each vertex, in two halves


class Bounced:
    """Light that reaches the vertices of a sample from other surfaces, for TURNS rotations.

    halves: (2, FOLLOWED, S, TURNS, 3), exit radiance of white vertices after 1.. bounces, by half of the paths.
    """

    def __init__(
        self,
        sample: Sample,
        albedo: Radiance,  # (V, 3) linear
        coefficients: Floats,  # (K, TURNS, 3) of the light, at least FEW_BANDS bands
    ) -> None:
        count, turns = len(sample.rows), coefficients.shape[1]
        coefficients = coefficients[: FEW_BANDS**2].reshape(FEW_BANDS**2, -1)
        random = np.random.default_rng(0)
        self.halves = np.zeros((2, FOLLOWED, count, turns, 3))
        occluder = sample.occluder
        start = np.repeat(np.arange(count), PATHS)
        half = np.tile(np.arange(PATHS) % 2, count)
        position, normal = occluder.origins[sample.rows[start]], occluder.normals[sample.rows[start]]
        weight = np.ones((len(start), 3)) / (PATHS / 2)
        for depth in range(FOLLOWED + 1):
            toward = _cosine(normal, random)
            hits = occluder.first_hits(np.concatenate([position, toward], axis=1, dtype=np.float32))
            _, face, uv, _ = hits
            if depth:
                free = face < 0
                light = np.maximum(harmonics.evaluate(toward[free], FEW_BANDS) @ coefficients, 0.0).reshape(
                    -1, turns, 3
                )
                at = half[free], np.full(free.sum(), depth - 1), start[free]
                np.add.at(self.halves, at, light * weight[free][:, None])
            met = np.flatnonzero(met_in_front(occluder, hits, toward))
            corners = occluder.faces[face[met]].astype(np.int64)
            shares = np.stack([1.0 - uv[met].sum(axis=1), *uv[met].T], axis=1)
            outward = np.einsum("ik,ikc->ic", shares, occluder.normals[corners])
            if not len(met):
                break
            start, half = start[met], half[met]
            position = np.einsum("ik,ikc->ic", shares, occluder.origins[corners]).astype(np.float32)
            normal = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
            weight = weight[met] * np.einsum("ik,ikc->ic", shares, albedo[corners])


def _cosine(normals: Directions, random: np.random.Generator) -> NDArray[np.float32]:
    """Cosine-distributed directions about unit normals: a point of the sphere added to each."""
    toward = random.normal(size=normals.shape)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    toward = normals + 0.9999 * toward
    return (toward / np.linalg.norm(toward, axis=1, keepdims=True)).astype(np.float32)
