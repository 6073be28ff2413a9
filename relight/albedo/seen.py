"""Views of a place from where it was captured, and the size of every vertex in them.

A mesh of a place has parts that no camera saw: the underside of a lawn, the backs of hedges. Their colours are invented
and their area is half of the whole, so neither an estimate of light nor its check may count them by area.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Frame, Occluder

LOOKS = 4096
"""Directions from each place where the capture stood: 3 degrees apart; 24 places make 98,000 rays."""


class SeenPoints(NamedTuple):
    """L looks that met the front of a surface. corners: (L, 3) vertices of what they met. shares: (L, 3) float32, what
    each corner has of the point, which sum to 1. distance: (L,) float32, in the occluder's unit frame."""

    corners: NDArray[np.int64]
    shares: NDArray[np.float32]
    distance: NDArray[np.float32]

    def of(self, rows: Mask | Integers) -> "SeenPoints":
        """Some of the looks."""
        return SeenPoints(self.corners[rows], self.shares[rows], self.distance[rows])

    def at(self, values: Floats) -> Floats:
        """Values (V, C) of vertices as values (L, C) of the looks."""
        return np.einsum("lk,lkc->lc", self.shares, values[self.corners])

    def sizes(self, count: int) -> NDArray[np.float64]:
        """(V,) float64: how many looks each of `count` vertices was met by, in parts."""
        return np.asarray(np.bincount(self.corners.ravel(), self.shares.ravel(), count), np.float64)


def standing(scene: Scene) -> NDArray[np.float64]:
    """(E, 3) float64, scene frame: where the capture of a place stood; none of an object."""
    eyes = scene.capture.get("eyes", ()) if scene.is_place else ()
    return np.asarray(eyes, np.float64).reshape(-1, 3)


def looks_from(scene: Scene, occluder: Occluder) -> SeenPoints | None:
    """The looks all around from the positions of a place's capture, without backs of faces; None for an object,
    and where nothing is seen."""
    eyes = standing(scene)
    if not len(eyes):
        return None
    directions = fibonacci_sphere(LOOKS)
    starts = np.repeat(Frame.around(scene.vertices, scene.faces).unit(eyes), LOOKS, axis=0)
    rays = np.hstack([starts, np.tile(directions, (len(eyes), 1))]).astype(np.float32)
    hits = occluder.first_hits(rays)
    met = np.flatnonzero(hits.faces >= 0)
    corners = occluder.faces[hits.faces[met]].astype(np.int64)
    front = np.einsum("ij,ij->i", occluder.normals[corners].sum(axis=1), rays[met, 3:]) < 0.0
    if not front.any():
        return None
    second, third = np.clip(hits.uv[met[front]], 0.0, 1.0).T
    shares = np.stack([np.maximum(1.0 - second - third, 0.0), second, third], axis=1)
    shares = (shares / shares.sum(axis=1, keepdims=True)).astype(np.float32)
    return SeenPoints(corners[front], shares, hits.distance[met[front]])
