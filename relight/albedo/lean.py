"""Which way the clipped part of a captured sky is brightest, told by how colours vary within materials.

Pairs of neighbours do not tell it: what the mesh gets wrong makes any light but a flat one cost more. But whatever
adds noise to the irradiance of a place leaves its correlation with the colours to the right light. So skies that lean
by exp(a . direction) are tried, and each counts by how much of the variance of log colour it explains within materials
whose surfaces lie alike: with a slope that is free, as regression on noisy values asks for.
"""

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from splat2mesh.scene.color import luminance

from ..sh import harmonics
from ..sh.sphere import fibonacci_sphere
from ..transfer.bounces import visible_fraction
from .division import weighted_median

CELL = 0.04
"""Side of a patch over the median distance from which patches are seen."""

MOST_VOLUME, LEAST_VISIBLE, SMOOTH = 0.35, 0.15, 0.9
"""Of what is looked at: how far it may be leaves or grass, the part of its sky that it sees at least, and the least
length of a normal between those of a face's corners."""

ALIKE, MATERIAL = 0.15, 0.12
"""Log chroma that a patch, and a material, spans."""

LEVEL, BENEATH = 0.7, -0.3
"""Height of a normal from which a surface counts as level, and below which it hangs: a material counts once for
each, since floors and walls of one hue are not of one paint."""

LEAST_PATCHES = 200
"""Fewer tell nothing."""

OUTLIER = 0.5
"""Of log colour within a material: what is further off counts less than half."""

INDEPENDENT = 300.0
"""Patches that their sum of evidence is scaled to: neighbours err alike, however many there are."""

SPREAD = 1.5
"""Of the lean in the prior, along each axis: at 1.5 one side of the sky is twenty times as bright as the other."""

STEEPNESS = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5)
TRIED = 48
"""Leans that are tried: these in each of so many directions, and none."""


class Patches(NamedTuple):
    """N patches of surfaces. log_captured: (N,) of luminance. transfer: (N, K). bounced: (N,) luminance. material:
    (N,) numbers. weight: (N,)."""

    log_captured: np.ndarray
    transfer: np.ndarray
    bounced: np.ndarray
    material: np.ndarray
    weight: np.ndarray


def patches_of(
    looks,  # Looks
    occluder,  # Occluder
    captured,  # (V, 3) linear
    usable,  # (V,) bool, neither black nor clipped
    transfer,  # (V, K)
    bounce,  # (V, 3)
    volume=None,  # (V,) in [0, 1]
):
    """The Patches of what is looked at, or None where they are too few."""
    normal = looks.at(occluder.normals)
    good = usable[looks.corners].all(axis=1) & (np.linalg.norm(normal, axis=1) > SMOOTH)
    good &= looks.at(visible_fraction(transfer)[:, None])[:, 0] > LEAST_VISIBLE
    if volume is not None:
        good &= looks.at(volume[:, None])[:, 0] < MOST_VOLUME
    if np.count_nonzero(good) < LEAST_PATCHES:
        return None
    some = looks.of(good)
    logs, normal, points = np.log(some.at(captured)), normal[good], some.at(occluder.origins)
    chroma = (logs - logs.mean(axis=1, keepdims=True))[:, :2]
    cell = CELL * float(np.median(some.distance))
    index = _numbered([points / cell, 1.2 * normal + 0.5, chroma / ALIKE])
    count = np.bincount(index)
    shape = len(count), len(captured)
    means = csr_array(
        ((some.shares / count[index][:, None]).ravel(), (np.repeat(index, 3), some.corners.ravel())), shape
    )
    height = means @ occluder.normals[:, 1]
    side = np.where(height > LEVEL, 0.0, np.where(height < BENEATH, 2.0, 1.0))
    hue = np.stack([np.bincount(index, column) / count for column in chroma.T], axis=1)
    return Patches(
        np.log(np.maximum(luminance(means @ captured), 1e-9)),
        (means @ transfer).astype(np.float64),
        luminance(means @ bounce),
        _numbered([hue / MATERIAL, side[:, None]]),
        np.sqrt(count),
    )


def lean_of(
    patches,  # Patches
    directions,  # (D, 3) that share the sphere evenly
    bound,  # (D,) luminance that is known, of each direction
    clipped,  # (D,) part of each direction that was clipped
    usual,  # median albedo
):
    """The lean (3,) of the excess of the clipped sky, exp(lean . direction) but for its scale: the mean over all that
    are tried, by how well they explain the patches. 0 where nothing was clipped or there is one material to a patch."""
    bands = int(np.sqrt(patches.transfer.shape[1]))
    project = harmonics.evaluate(directions, bands) * (4.0 * np.pi / len(directions))
    known = np.maximum(patches.transfer @ (project.T @ bound), 0.0) + patches.bounced
    tried = np.concatenate([np.zeros((1, 3)), *(s * fibonacci_sphere(TRIED) for s in STEEPNESS)])
    shape = np.exp(directions @ tried.T) * clipped[:, None]
    total = shape.sum(axis=0)
    if not total.min() > 0.0:
        return np.zeros(3)
    excess = np.maximum(patches.transfer @ (project.T @ (shape / total * len(directions))), 0.0)
    logs = np.empty(len(tried))
    for number, light in enumerate(excess.T):
        received = known + _scale(patches, known, light, usual) * light
        part = _explained(patches, np.log(np.maximum(received, 1e-9)))
        logs[number] = -0.5 * INDEPENDENT * np.log1p(-part)
    logs -= 0.5 * (tried * tried).sum(axis=1) / SPREAD**2
    # Each shell of directions stands for the volume around its steepness, as a prior over space has it.
    steep = np.linalg.norm(tried, axis=1)
    odds = np.exp(logs - logs.max()) * np.where(steep > 0.0, steep**2 * _widths(steep), 0.0)
    return odds @ tried / odds.sum()


def _widths(steep):
    """How much of the axis of steepness each of the tried stands for."""
    edges = np.concatenate([[0.0], 0.5 * np.add(STEEPNESS[1:], STEEPNESS[:-1]), [STEEPNESS[-1]]])
    return np.concatenate([[0.0], np.repeat(np.diff(edges), TRIED)])[: len(steep)]


def _scale(patches, known, light, usual):
    """How much of `light` makes the median albedo the usual one, not negative."""
    needed = (np.exp(patches.log_captured) / usual - known) / np.maximum(light, 1e-9)
    return max(weighted_median(needed, patches.weight), 0.0)


def _explained(patches, log_received):
    """Part of the variance of log colour within materials that a log irradiance explains, 0 where they are opposed."""
    weight, material = patches.weight, patches.material
    off = _within(patches.log_captured, weight, material)
    weight = weight / (1.0 + (off / OUTLIER) ** 2)
    colors, light = (_within(values, weight, material) for values in (patches.log_captured, log_received))
    across, own = weight @ (colors * light), (weight @ colors**2) * (weight @ light**2)
    return float(np.clip(across, 0.0, None) ** 2 / own) if own > 0.0 else 0.0


def _within(values, weight, groups):
    """Values (N,) less the weighted mean of their group."""
    return values - (np.bincount(groups, weight * values) / np.bincount(groups, weight))[groups]


def _numbered(columns):
    """Numbers (N,) from 0 for rows that fall into the same cell of side 1: a list of (N, C)."""
    cells = np.floor(np.concatenate(columns, axis=1)).astype(np.int64)
    cells -= cells.min(axis=0)
    key = np.zeros(len(cells), np.int64)
    for column in cells.T:
        key = np.unique(key * (int(column.max()) + 1) + column, return_inverse=True)[1].reshape(-1)
    return key
