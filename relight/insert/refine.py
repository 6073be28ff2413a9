"""Local refinement of triangles without gaps, and cut-outs.

Long edges are halved on both sides of every seam. A cut-out is the part of a surface that an alpha mask leaves, as
triangles, so that the rest casts no shadow.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Integers, Mask, Points
from splat2mesh.base.threads import ROWS_AT_ONCE
from splat2mesh.scene.gltftextures import MappedTexture
from splat2mesh.scene.mesh import edges_of, halved

from ..lamps.gltf_lights import PARTS

MOST_ROUNDS = 12
"""Rounds of halving: an edge becomes at most 4,096 edges."""

LATER_PARTS = PARTS // 2
"""Into which each side of a face is cut to find both sides of a mask on it, first and in halved faces."""


def refined(
    points: Points,  # (V, 3)
    faces: Faces,  # (F, 3)
    longest: float,  # length up to which edges stay
    most_faces: int,  # no round begins with more
    wanted: Mask | None = None,  # (V,) bool: edges between two others stay whole
) -> tuple[Faces, list[Integers]]:
    """Halve long edges, round after round: the new faces, and the parents (M, 2) of the vertices of each round. A new
    vertex lies halfway between its parents, after all earlier vertices. See `carried`."""
    points, corners = np.asarray(points, np.float64), faces.astype(np.int64)
    wanted = np.ones(len(points), bool) if wanted is None else wanted
    rounds: list[Integers] = []
    near = wanted[corners].any(axis=1)  # no other face has an edge that is halved
    others, corners = corners[~near], corners[near]
    for _ in range(MOST_ROUNDS):
        if len(corners) + len(others) > most_faces:
            break
        edges = edges_of(corners)
        length = np.linalg.norm(points[edges[..., 0]] - points[edges[..., 1]], axis=-1)
        long = (length > longest) & wanted[edges].any(axis=-1)
        if not long.any():
            break
        corners, parents = halved(corners, long, len(points))
        rounds.append(parents)
        points = np.concatenate([points, points[parents].mean(axis=1)])
        wanted = np.concatenate([wanted, wanted[parents].any(axis=1)])
    return np.concatenate([others, corners]).astype(np.int32), rounds


def carried(values: NDArray, rounds: list[Integers]) -> NDArray:
    """Values (V, ...) of vertices, followed by those of new vertices, the means of their parents'."""
    for parents in rounds:
        values = np.concatenate([values, values[parents].mean(axis=1, dtype=np.float64).astype(values.dtype)])
    return values


class Cut(NamedTuple):
    """The vertices that remain of a surface and those at its cuts: W points on edges of the whole one.

    ends: (W, 2), vertices of the whole surface. share: (W,) float64, of the second.
    """

    ends: Integers
    share: NDArray[np.float64]

    def of(self, values: NDArray) -> NDArray:
        """Values (V, ...) of the whole surface at the W points."""
        first, second = values[self.ends[:, 0]], values[self.ends[:, 1]]
        share = self.share.reshape(-1, *[1] * (values.ndim - 1))
        return np.where(share > 0.0, first + (second - first) * share, first).astype(values.dtype)


def carried_through(values: NDArray, rounds: list[Integers], cut: Cut | None) -> NDArray:
    """Values (V, ...) of vertices at those of the surface that was refined in rounds and then cut."""
    found = carried(values, rounds)
    return found if cut is None else cut.of(found)


class Masked(NamedTuple):
    """A surface with an alpha mask.

    points: (V, 3). uv: (V, 2). opacity: (V,), factor on the alpha of the texture. cutoff: alpha from which there is
    a surface.
    """

    points: Points
    uv: NDArray[np.float64]
    opacity: Floats
    texture: MappedTexture | None
    cutoff: float

    def refined(self, rounds: list[Integers]) -> "Masked":
        """The surface after rounds of refinement."""
        return self._replace(
            points=carried(self.points, rounds), uv=carried(self.uv, rounds), opacity=carried(self.opacity, rounds)
        )

    def covered(self, faces: Integers, weights: NDArray) -> NDArray[np.float64]:
        """(F,): share of points (N, 3) of each face at which there is a surface."""
        found = np.zeros(len(faces))
        for weight in weights:
            for start in range(0, len(faces), ROWS_AT_ONCE):
                corners = faces[start : start + ROWS_AT_ONCE]
                alpha = self.opacity[corners] @ weight
                if self.texture is not None:
                    alpha = alpha * self.texture.alpha(np.einsum("k,fkc->fc", weight, self.uv[corners]))
                found[start : start + ROWS_AT_ONCE] += alpha >= self.cutoff
        return found / len(weights)

    def texels(self, faces: Integers) -> NDArray[np.float64]:
        """(F,): texels along the longest edge of a face."""
        if self.texture is None:
            return np.zeros(len(faces))
        height, width = self.texture.pixels.shape[:2]
        corners = self.uv[faces] * [width, height]
        return np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)


def cut_out(surface: Masked, faces: Faces, most_faces: int) -> tuple[Faces, list[Integers], Cut]:
    """Refine faces where the mask crosses them, down to single texels, and cut them there.

    most_faces: no round begins with more. Returns the faces (F, 3) over the W points of the Cut, and the rounds of
    `refined` that lead to the surface that it cuts.
    """
    rounds: list[Integers] = []
    fine = surface
    for step in range(MOST_ROUNDS + 1):
        weights = _lattice(LATER_PARTS if step else PARTS)
        share = fine.covered(faces, weights)
        coarse = (share > 0.0) & (share < 1.0) & (fine.texels(faces) > 1.0)
        if not coarse.any() or len(faces) > most_faces or step == MOST_ROUNDS:
            break
        corners = fine.points[faces[coarse]].astype(np.float64)
        longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max()
        wanted = np.zeros(len(fine.points), bool)
        wanted[faces[coarse]] = True
        finer, more = refined(fine.points, faces, 0.5 * float(longest), most_faces, wanted)
        if not more:
            break
        faces, rounds, fine = finer, rounds + more, fine.refined(more)
    mostly = share >= 0.5  # of faces that stay too large to be cut
    at_vertices = fine.opacity if fine.texture is None else fine.opacity * fine.texture.alpha(fine.uv)
    kept, cut = _clipped(faces[~coarse], faces[coarse & mostly], np.asarray(at_vertices, np.float64), surface.cutoff)
    return kept, rounds, cut


def _lattice(parts: int) -> NDArray[np.float64]:
    """Weights (N, 3) of a triangle's corners at points in rows, corners among them."""
    first, second = np.meshgrid(np.arange(parts + 1), np.arange(parts + 1))
    inside = first + second <= parts
    pair = np.stack([first[inside], second[inside]], axis=1) / parts
    return np.column_stack([1.0 - pair.sum(axis=1), pair])


def _clipped(faces: Integers, whole: Integers, alpha: NDArray[np.float64], cutoff: float) -> tuple[Faces, Cut]:
    """Faces (F, 3) cut where alpha (V,) crosses the cutoff along their edges, and whole ones."""
    inside: Mask = alpha >= cutoff
    number = inside[faces].sum(axis=1)
    one, two = faces[number == 1], faces[number == 2]
    a, b, c = _turned(one, inside[one].argmax(axis=1)).T
    o, p, q = _turned(two, (~inside[two]).argmax(axis=1)).T
    edges = np.concatenate([np.stack(pair, axis=1) for pair in ((a, b), (a, c), (o, p), (o, q))])
    pairs, place = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
    low, high = alpha[pairs].T
    share = (cutoff - low) / np.where(high == low, 1.0, high - low)
    # Where the mask crosses an edge at its end, that vertex; elsewhere a new one.
    met = np.select([share <= 0.0, share >= 1.0], [*pairs.T], np.arange(len(pairs)) + len(alpha))[place.reshape(-1)]
    ab, ac, op, oq = np.split(met, np.cumsum([len(a), len(a), len(o)]))
    kept = [whole, faces[number == 3], np.stack([a, ab, ac], axis=1)]
    kept += [np.stack([op, p, q], axis=1), np.stack([op, q, oq], axis=1)]
    corners = np.concatenate(kept)
    corners = corners[(corners != np.roll(corners, -1, axis=1)).all(axis=1)]
    every = np.concatenate([np.repeat(np.arange(len(alpha))[:, None], 2, axis=1), pairs])
    used, rows = np.unique(corners, return_inverse=True)
    cut = Cut(every[used], np.concatenate([np.zeros(len(alpha)), share])[used])
    return rows.reshape(-1, 3).astype(np.int32), cut


def _turned(faces: Integers, first: Integers) -> Integers:
    """Faces (F, 3) that begin with another of their corners."""
    return np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
