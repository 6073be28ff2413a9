"""Holes of a mesh that are openings of the thing itself: views look through them and see nothing behind."""

from collections.abc import Sequence

import numpy as np

from ..base.arrays import Mask, Points
from .album import TOLERANCE_OBJECT, RenderedPicture

SMALLEST = 10.0
"""Border of the smallest opening, in depth tolerances: about 16 pixels of a view. Smaller holes are pinholes."""


def openings(borders: Sequence[Points], pictures: Sequence[RenderedPicture], radius: float) -> Mask:
    """Which holes are openings, (N,) bool: more than half of each one's probes are empty in at least two pictures, and
    in more of them than show a surface there.

    borders: the corners (C, 3) of each hole in order, in the frame of the views. radius: of the mesh, same unit. A
    picture that shows something farther away says nothing: that may be the far side of a closed thing.
    """
    tolerance, found = TOLERANCE_OBJECT * radius, np.zeros(len(borders), bool)
    lengths = np.array([np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum() for corners in borders])
    large = np.flatnonzero(lengths > SMALLEST * tolerance)
    if not len(large) or not len(pictures):
        return found
    probes = [_probes(borders[hole]) for hole in large.tolist()]
    places, owner = np.concatenate(probes), np.repeat(np.arange(len(large)), [len(each) for each in probes])
    empty, there = np.zeros(len(places), np.int64), np.zeros(len(places), np.int64)
    for picture in pictures:
        shown, pixel, depth = picture.view.shown(places)
        seen = picture.depth[tuple(pixel)]
        empty[shown] += np.isnan(seen)
        there[shown] += np.abs(seen - depth) < tolerance
    through = (empty >= 2) & (empty > there)
    found[large] = np.bincount(owner, weights=through) > 0.5 * np.bincount(owner)
    return found


def _probes(corners: Points) -> Points:
    """(P, 3): the middle of a border, and the places half way from there to its corners."""
    middle = corners.mean(axis=0)
    return np.concatenate([middle[None], 0.5 * (middle + corners)])
