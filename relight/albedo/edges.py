"""The sun of a capture, found again by the edges of its shadows.

Across the edge of a cast shadow the paint goes on and the light does not. Between near neighbours of one slope and hue,
the colours of a place therefore follow a sun from the right direction better than one that is 3 degrees off, while the
contrast of whole materials tells directions apart by 5 to 15 degrees.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Vector
from splat2mesh.base.calibration import Provenance
from splat2mesh.scene.color import luminance

from ..light.environment import Environment
from ..transfer.bounces import visible_fraction
from ..transfer.occluder import Occluder
from . import samples
from .captured import CapturedScene
from .patches import PATCHES, numbered
from .shadows import CastShadows, cap, shadows_of
from .sun import Sun, lit_by

POINTS = 12_000
"""Vertices, evenly over what is seen, that are compared with their neighbours."""

CELL, HUE = 0.02, 0.25
"""Side of the cells within which they are, in the unit frame, and log chroma that these span: shadows are bluer."""

ROUGHEST = 0.06
"""Roughness of the surface up to which a vertex counts."""

WITHIN_DEG, COARSE_DEG = 20.0, 3.5
"""How far from the present estimate the sun is searched, and spacing of the directions."""

AROUND_DEG, FINE_DEG, CENTERS_DEG = 9.0, 1.5, 5.0
"""The same around the best of these, and how far from it a lobe may have its middle."""

WIDTHS_DEG = (1.5, 2.0, 3.0, 4.5)
"""Spreads of the lobes tried."""

SHADOW_POINTS = 40_000
"""Vertices among which cast shadows are looked for."""

OVER_SKY, LEAST_SKY = 2.0, 0.1
"""Irradiance of a sun at right angles over that of all sky, and what a place without sky receives, over the same."""


@dataclass(frozen=True)
class EdgeCalibration:
    """Which edges are those of a sun.

    explained: least part of the variance between neighbours that the best sun explains beyond the openness to the sky.
    clearer: by how much that must exceed what any sun further than `apart` degrees from it explains.
    depth, nat: logarithm of lit over shaded that makes shadows those of a sun, and by how much less takes a nat from
    the evidence for one. Fifteen captures under suns had 1.4 to 2.4; a false sun of a nook had .9.
    weight: of the strength that shadows show, over that of all; the rest is contrast's. Both are off, the former by
    holes of the mesh and blur, the latter by all errors of the mesh.
    certain: by how much the former must fall short of `clearer` to take a nat from the evidence for a sun. Soft light
    had .001 to .009, real suns .015 to .063.
    shaded: least variance of the light of a sun between neighbours, over that of their colours, for a sun without edges
    to be doubted: with less, nothing stands in its way. Nine scenes had .7 to 2.5.
    """

    provenance: ClassVar = Provenance(
        script="scripts/bench albedo",
        fitted_on="cells and lobes: gardens 4 and 7, nook 3; thresholds: gardens 2 to 12, nooks 1 to 6, the patio; "
        "depth: nook 11; weight: 15 sunny captures",
        held_out="relit splats of garden 10 at noon and garden 13: .12 to .43 dB better (docs/albedo.md)",
    )

    explained: float = 0.022
    clearer: float = 0.012
    apart: float = 10.0
    depth: float = 1.15
    nat: float = 0.05
    weight: float = 2.0 / 3.0
    certain: float = 0.0015
    shaded: float = 0.3


EDGES = EdgeCalibration()


class SunEdges(NamedTuple):
    """A sun as edges show it. direction: (3,) unit, scene frame. width_deg: spread of its lobe. rows: (N,) vertices
    compared. received: (N,) by them under a sun of irradiance 1. shadows: its CastShadows among the vertices
    `shadow_rows`, or None. explained, clearer: as of EdgeCalibration. inside: whether the best direction is no end of
    the search. shaded: as of EdgeCalibration.
    """

    direction: NDArray[np.float64]
    width_deg: float
    rows: NDArray[np.int64]
    received: Floats
    shadow_rows: NDArray[np.int64]
    shadows: CastShadows | None
    explained: float
    clearer: float
    inside: bool
    shaded: float

    @property
    def clear(self) -> bool:
        """Whether the edges are those of a sun."""
        most = self.explained >= EDGES.explained and self.clearer >= EDGES.clearer
        return most and self.inside and self.shadows is not None and self.shadows.depth >= EDGES.depth

    @property
    def nats(self) -> float:
        """What the edges add to the evidence for a sun found by contrast, never more than 0."""
        if self.shaded < EDGES.shaded:
            return 0.0
        return min((self.clearer if self.inside else 0.0) - EDGES.clearer, 0.0) / EDGES.certain

    @property
    def nats_of_depth(self) -> float:
        """What the depth of the shadows adds to it, never more than 0."""
        if self.shadows is None or not self.shadows.deep:
            return 0.0
        return min(self.shadows.depth - EDGES.depth, 0.0) / EDGES.nat


def sharpened(scene: CapturedScene, rest: Environment, lamp: Sun, share: float, edges: SunEdges | None) -> Sun | None:
    """A Sun found by contrast, where the SunEdges around it have it; None where they do not show it clearly.

    Its irradiance is the geometric mean of a share of what was found and of what its shadows show; where only their
    edges can be seen, which are blurred, the larger of both. rest: the light beside it.
    """
    if edges is None or not edges.clear or edges.shadows is None or lamp.irradiance is None:
        return None
    transfer, rows, found = scene.transport.transfer, edges.shadow_rows, share * lamp.irradiance
    coefficients = luminance(rest.sh(int(np.sqrt(transfer.shape[1])))).astype(np.float32)
    received = np.maximum(transfer[rows] @ coefficients, np.float32(0.0)) + luminance(scene.bounce[rows])
    shown, before = edges.shadows.irradiance(received.astype(np.float64)), float(luminance(found))
    change = (shown / before) ** EDGES.weight if edges.shadows.deep else max(shown / before, 1.0)
    return Sun(edges.direction, edges.width_deg, edges.received, change * found)


def sun_at_edges(scene: CapturedScene, near: Vector, volume: Floats | None = None) -> SunEdges | None:
    """The SunEdges of a CapturedScene around a direction (3,); None where too little of it has smooth surfaces.

    volume: (V,) in [0, 1], how far each vertex is of leaves, which have no edges.
    """
    occluder, visible = scene.occluder, visible_fraction(scene.transport.transfer)
    good = scene.usable & (scene.areas > 0.0) & (visible > PATCHES.least_visible)
    good &= scene.roughness < ROUGHEST
    if volume is not None:
        good &= volume < PATCHES.most_volume
    rows = samples.places(occluder, scene.areas, good, POINTS, scene.seed)
    if len(rows) < PATCHES.least_patches:
        return None
    between = _Neighbors(occluder, rows, scene.captured[rows], visible[rows])
    coarse = cap(near, WITHIN_DEG, COARSE_DEG)
    shadows = lit_by(occluder, rows, coarse)
    explained, shaded = between.explained(shadows), between.shaded(shadows[:, :1])
    best = coarse[explained.argmax()]
    rival = float(explained[coarse @ best < np.cos(np.radians(EDGES.apart))].max(initial=0.0))
    fine = cap(best, AROUND_DEG, FINE_DEG)
    shadows = lit_by(occluder, rows, fine)
    centers = np.flatnonzero(fine @ best > np.cos(np.radians(CENTERS_DEG)))
    angle = np.degrees(np.arccos(np.clip(fine[centers] @ fine.T, -1.0, 1.0)))
    most, top, width_deg, received = -1.0, 0, 0.0, shadows[:, 0]
    for width in WIDTHS_DEG:
        lobes = np.exp(-0.5 * (angle / width) ** 2).astype(np.float32)
        lobed = shadows @ (lobes / lobes.sum(axis=1, keepdims=True)).T
        explained = between.explained(lobed)
        if explained.max() > most:
            most, top, width_deg = float(explained.max()), int(explained.argmax()), width
            received = lobed[:, top]
    direction = fine[centers[top]]
    inside = direction @ near > np.cos(np.radians(WITHIN_DEG - COARSE_DEG))  # on the border it is no maximum
    some = samples.places(occluder, scene.areas, good, SHADOW_POINTS, scene.seed)
    cast = shadows_of(occluder, some, scene.captured[some], direction)
    return SunEdges(direction, width_deg, rows, received, some, cast, most, most - rival, inside, shaded)


class _Neighbors:
    """Points in cells of one slope and hue, and their colours less the mean of the cell."""

    def __init__(
        self,
        occluder: Occluder,
        rows: NDArray[np.int64],  # (N,) vertices
        captured: NDArray[np.float32],  # (N, 3) linear
        visible: NDArray[np.float32],  # (N,)
    ) -> None:
        logs = np.log(captured.astype(np.float64))
        chroma = (logs - logs.mean(axis=1, keepdims=True))[:, :2]
        self._alike = [1.5 * occluder.normals[rows] + 0.5, chroma / HUE]
        self._points = occluder.origins[rows]
        self._open = visible.astype(np.float64) + LEAST_SKY
        self._log_captured = np.log(luminance(captured).astype(np.float64))
        self._parts = [_Cells(self._cells(CELL, shift), self._log_captured, self._open) for shift in (0.0, 0.5)]

    def explained(self, shadows: NDArray[np.float32]) -> NDArray[np.float64]:
        """(S,) part of the variance between neighbours that suns explain, (N, S) of irradiance 1."""
        across, light, colors = self._moments(shadows)
        return np.maximum(across, 0.0) ** 2 / np.maximum(light * colors, 1e-12)

    def shaded(self, shadows: NDArray[np.float32]) -> float:
        """The variance of the light of a sun between neighbours, (N, 1) of irradiance 1, over that of their colours."""
        _, light, colors = self._moments(shadows)
        return float(light[0] / max(colors[0], 1e-12))

    def _moments(self, shadows: NDArray[np.float32]) -> NDArray[np.float64]:
        light = np.log(self._open[:, None] + np.pi * OVER_SKY * shadows)
        return np.asarray(np.sum([part.moments(light) for part in self._parts], axis=0))

    def _cells(self, side: float, shift: float) -> NDArray[np.int64]:
        return numbered([self._points / side + shift, *self._alike])


class _Cells:
    """Values of points within cells, less what the openness to the sky explains of them."""

    def __init__(self, cell: NDArray[np.int64], log_captured: NDArray[np.float64], openness: NDArray[np.float64]):
        """All (N,): cell numbers from 0."""
        count = len(cell)
        self._cell, self._member = cell, scipy.sparse.csr_array((np.ones(count), (cell, np.arange(count))))
        self._weight = np.ones(count)
        self._weight = 1.0 / (1.0 + (self._off(log_captured) / PATCHES.outlier) ** 2)
        self._sky = self._off(np.log(openness))
        self._own = float(self._weight @ self._sky**2)
        self._colors = self._beyond_sky(log_captured)

    def moments(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3, S) for log lights (N, S), weighted sums of colours times light and of the squares of both."""
        light = self._beyond_sky(light)
        across = (self._weight * self._colors) @ light
        return np.stack([across, self._weight @ light**2, np.full_like(across, self._weight @ self._colors**2)])

    def _beyond_sky(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        off = self._off(values)
        slope = ((self._weight * self._sky) @ off) / max(self._own, 1e-12)
        return off - np.multiply.outer(self._sky, slope)

    def _off(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (N,) or (N, S) less the weighted mean of their cell."""
        weight = self._member * self._weight
        mean = ((weight @ values).T / (self._member @ self._weight)).T
        return np.asarray(values - mean[self._cell])
