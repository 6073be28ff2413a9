"""The views for the fit of relit splats: pictures of them, and the mesh point that each pixel shows."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.threads import in_batches
from splat2mesh.render.raycaster import corner_weights
from splat2mesh.render.screentiles import AREA
from splat2mesh.render.view import View
from splat2mesh.splats.splats import SH_C0, Splats

from .attachment import Surface
from .blend_lists import in_tiles
from .blending import Blending, blending_of
from .light_ratio import CURVE_OFFSET

DEPTH_TOLERANCE = 0.03
"""Largest distance, in diagonals, between mesh and splats in a view; beyond it, the pixel does not show the mesh's
light."""

OBJECT_DISTANCE = 0.5
"""Diagonals from which a view sees a scene at least: what is nearer lets mesh and splats be apart by as much less, so
that within a place nothing bleeds over jumps of depth."""

MIN_ALPHA = 0.5
"""Least opacity of a pixel that shows anything."""

EYES = 8
"""Of a place: the places to stand from which looks go all around, six views from each."""

CAUTION = 0.5
"""Pixels added to those that a Gaussian's correction is a mean of: who is hardly seen is hardly corrected."""

UV_PARTS = np.float32(np.iinfo(np.uint16).max)
"""Weights of corners are whole parts of it: next to the noise of a mesh that is nothing."""


class Looks(NamedTuple):
    """Pictures of N Gaussians. blending: Blending of the pixels that show the mesh. known: (Q,) int64, these pixels.
    corners: (Q, 3) int32, the nodes around what each shows. uv: (Q, 2) float32, the weights of the second and third.
    eyes: (L, 3) float64, from where each picture is taken, in the frame of the surface."""

    blending: Blending
    known: NDArray[np.int64]
    corners: NDArray[np.int32]
    uv: NDArray[np.float32]
    eyes: NDArray[np.float64]

    @classmethod
    def at(
        cls,
        splats: Splats,
        surface: Surface,
        views: Sequence[View],
        near: float,
        advance: Callable[[int], None] = lambda count: None,
    ) -> "Looks":
        """Look at splats in front of a surface, both in the frame of the views; near: of the camera, its z."""
        found = []

        def look(number: int, alpha: NDArray[np.float32], depth: NDArray[np.float32]) -> Mask:
            found.append(_shown(views[number], alpha, depth, surface))
            advance(1)
            return found[-1][0]

        blending = blending_of(splats, views, near, look)
        known = np.concatenate([in_tiles(each[0]) for each in found])
        corners, uv = (np.concatenate([in_tiles(each[i]) for each in found])[known] for i in (1, 2))
        eyes = np.array([view.center for view in views], np.float64).reshape(-1, 3)
        return cls(blending, np.flatnonzero(known), corners, np.rint(uv * UV_PARTS) / UV_PARTS, eyes)

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]], splats: int, surface: Surface) -> "Looks":
        """Restore from `arrays`, for a number of splats and a Surface. Raises InputError or KeyError for arrays that do
        not fit."""
        blending = Blending(**{name: arrays[name] for name in Blending._fields}).checked(splats)
        faces, uv, eyes = (arrays[name] for name in ("faces", "uv", "eyes"))
        known = np.flatnonzero(np.unpackbits(arrays["known"], count=AREA * (len(blending.runs) - 1)))
        if eyes.shape != (len(blending.tiles) - 1, 3) or not np.isfinite(eyes).all():
            raise InputError("kept pictures were taken from elsewhere")
        kinds = faces.dtype == np.int32 and uv.dtype == np.uint16
        if not kinds or faces.shape != known.shape or uv.shape != (len(known), 2):
            raise InputError("kept pictures are of another kind")
        if not (faces.min(initial=0) >= 0 and faces.max(initial=-1) < len(surface.faces)):
            raise InputError("kept pictures show another mesh")
        return cls(blending, known, surface.faces[faces], uv.astype(np.float32) / UV_PARTS, eyes)

    def arrays(self, surface: Surface) -> dict[str, NDArray[Any]]:
        """Dict of the arrays that `restored` takes; surface: that they were taken of."""
        known = np.zeros(AREA * (len(self.blending.runs) - 1), bool)
        known[self.known] = True
        arrays = {"known": np.packbits(known), "faces": surface.numbers_of(self.corners), "eyes": self.eyes}
        return self.blending._asdict() | arrays | {"uv": np.rint(self.uv * UV_PARTS).astype(np.uint16)}

    def at_pixels(self, kept: Mask) -> "Looks":
        """These pictures, of which some of the known pixels, (K,) bool, are known."""
        return self._replace(known=self.known[kept], corners=self.corners[kept], uv=self.uv[kept])

    def of_view(self, number: int) -> "Looks":
        """The picture of one view alone, without a copy."""
        first, last = np.searchsorted(self.known, AREA * self.blending.tiles[number : number + 2])
        rows = slice(first, last)
        known = self.known[rows] - AREA * self.blending.tiles[number]
        eyes = self.eyes[number : number + 1]
        return Looks(self.blending.of_view(number), known, self.corners[rows], self.uv[rows], eyes)

    def corrections(
        self, before: NDArray[np.float32], relit: NDArray[np.float32], of_nodes: Floats, rounds: int
    ) -> NDArray[np.float32]:
        """Corrections (N, 3) float32 to add to the constant coefficients `relit`, so that pictures of the relit splats
        agree with pictures of the captured ones times the light ratio of the mesh.

        before, relit: (N, 3) float32 constant coefficients. of_nodes: (M, 3) log gain.
        Gaussians lie before and behind the surface, so that their blend shows the light of neither place. Each round
        draws all pictures and moves each Gaussian's colour by the mean error of the pixels it contributes to.
        Source: Gilbert, "Iterative methods for the three-dimensional reconstruction of an object from projections"
        (1972): simultaneous iterative reconstruction (SIRT).
        """
        shown, wanted = _shown_colors(before), np.empty((len(self.known), 3), np.float32)

        def gain(rows: slice) -> None:
            wanted[rows] = np.expm1(
                np.einsum("nk,nkc->nc", corner_weights(self.uv[rows]), of_nodes[self.corners[rows]])
            )

        in_batches(gain, len(wanted))
        wanted *= self.blending.drawn(shown + np.float32(CURVE_OFFSET))[self.known]
        seen, moved = self._spread(np.ones_like(wanted), len(relit)), np.zeros_like(relit)
        for _ in range(rounds):
            lacking = wanted - self.blending.drawn(_shown_colors(relit + moved) - shown)[self.known]
            moved += self._spread(lacking, len(relit)) / (seen + CAUTION) / SH_C0
        return moved

    def _spread(self, values: NDArray[np.float32], count: int) -> NDArray[np.float32]:
        """The sums (N, 3) of the shares that Gaussians have of values (Q, 3) of the known pixels."""
        pixels = np.zeros((AREA * (len(self.blending.runs) - 1), 3), np.float32)
        pixels[self.known] = values
        sums = np.zeros((count, 3), np.float32)
        self.blending.spread(pixels, sums)
        return sums


def _shown_colors(constant: NDArray[np.float32]) -> NDArray[np.float32]:
    """Constant coefficients as what is drawn, (N, 3) float32."""
    return np.maximum(np.float32(0.5) + np.float32(SH_C0) * constant, np.float32(0.0))


def _shown(
    view: View, alpha: NDArray[np.float32], depth: NDArray[np.float32], surface: Surface
) -> tuple[Mask, Faces, NDArray[np.float32]]:
    """Whether each pixel shows the mesh (H, W), the corners (H, W, 3) int32 and weights (H, W, 2) float32 of where."""
    directions = view.ray_directions().astype(np.float32)
    rays = np.concatenate([np.broadcast_to(view.center.astype(np.float32), directions.shape), directions], axis=-1)
    hits = surface.caster.first_hits(rays)  # distances in camera z, as the directions are
    apart = np.abs(hits.distance - depth)
    allowed = DEPTH_TOLERANCE * np.minimum(surface.diagonal, depth / OBJECT_DISTANCE)
    known = (alpha > MIN_ALPHA) & (apart < allowed)
    return known, surface.faces[np.where(known, hits.faces, 0)], hits.uv
