"""The light that pixels of a view mirror: the environment where the lobe sees it, else the scene's radiance."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Matrix3
from splat2mesh.render.raycaster import corner_weights
from splat2mesh.render.screentiles import AREA

from ..sh import harmonics
from ..splats.attachment import Surface
from ..splats.blending import Blending
from .ggx import fresnel_rise, lobe_direction, zonal_factors
from .material import Gloss
from .pixels import SurfacePixels

RAYS = 8
"""Rays of each pixel's lobe: neighbours have others, and harmonics of degree 3 show their mean."""

BANDS = harmonics.MAX_BANDS
"""Bands of the light that lobes blur."""

LEAST_ALPHA = 0.15
"""Sharper lobes are blurred to this one: more than degree 3 shows, and 10 bands of a light still do not ring."""


class MirroredPixels(NamedTuple):
    """The Q glossy pixels of a view, and what each of their lobes' rays met.

    pixels: SurfacePixels. strength: (Q, 3), reflectance towards the eye. alpha: (Q,). visible: (Q,) share of the lobe
    that sees the light. corners: (Q, RAYS, 3) int32 nodes that rays hit, and weights: (Q, RAYS, 3) float32, whose sum
    is the share of the lobe that is hidden. scene: (3, 3) rotation into the frame of the scene. blending: of the view,
    as far as it is of these pixels.
    """

    pixels: SurfacePixels
    strength: NDArray[np.float32]
    alpha: NDArray[np.float32]
    visible: NDArray[np.float32]
    corners: NDArray[np.int32]
    weights: NDArray[np.float32]
    scene: Matrix3
    blending: Blending

    @classmethod
    def of(cls, seen: SurfacePixels, surface: Surface, gloss: Gloss, scene: Matrix3) -> "MirroredPixels":
        """The pixels of a view on glossy patches."""
        pixels = seen.take(gloss.glossy[seen.nodes])
        nodes = pixels.nodes
        alpha = np.maximum(gloss.alpha[nodes], np.float32(LEAST_ALPHA))
        strength = gloss.reflectance[nodes] * fresnel_rise(pixels.cosine, gloss.flat[nodes])[:, None]
        count = len(nodes)
        shift = np.mod(np.arange(count) * 0.7548776662466927, 1.0)  # a sequence without clumps, Roberts' R1
        corners, weights = np.zeros((count, RAYS, 3), np.int32), np.zeros((count, RAYS, 3), np.float32)
        visible, total = np.zeros(count), np.full(count, 1e-12)
        for ray in range(RAYS):
            directions, weight = lobe_direction(alpha, pixels.normals, pixels.toward, ray, RAYS, shift)
            hits = pixels.hits(surface, directions)
            open_sky = ~np.isfinite(hits.distance)
            corners[:, ray] = surface.faces[np.where(open_sky, 0, hits.faces)]
            shares = corner_weights(hits.uv)
            weights[:, ray] = np.where(open_sky, 0.0, weight)[:, None] * np.where(open_sky[:, None], 0.0, shares)
            visible += weight * open_sky
            total += weight
        weights /= total[:, None, None].astype(np.float32)
        share = np.where(total > 1e-9, visible / total, 1.0).astype(np.float32)
        wanted = np.zeros(AREA * (len(seen.blending.runs) - 1), bool)
        wanted[pixels.known] = True
        part = np.minimum(strength, 1.0).astype(np.float32)
        return cls(pixels, part, alpha, share, corners, weights, scene, seen.blending.of_pixels(wanted))

    def reflected(self, light: Floats, radiance: Floats) -> NDArray[np.float64]:
        """(Q, 3) radiance that each sends to the eye by reflection.

        light: (K, 3) SH coefficients, frame of the scene. radiance: (M, 3) that nodes send out, in its unit.
        """
        hidden = np.einsum("qrk,qrkc->qc", self.weights, radiance[self.corners].astype(np.float32))
        return self.strength * (self.visible[:, None] * self._blurred(np.asarray(light, np.float64)) + hidden)

    def _blurred(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """(Q, 3) the light about the mirrored directions as lobes of each roughness see it."""
        bands = harmonics.bands_of(light)
        degree, _ = harmonics.degrees_and_orders(bands)
        basis = harmonics.evaluate(self.pixels.mirrored @ self.scene.T, bands)
        result = np.zeros((len(basis), 3))
        for alpha in np.unique(self.alpha):
            rows = self.alpha == alpha
            blurred = basis[rows] @ (zonal_factors(float(alpha), bands)[degree][:, None] * light)
            result[rows] = np.maximum(blurred, 0.0)
        return result
