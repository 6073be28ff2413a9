"""Glossy splats in a few bytes each: material, the directions in which they see the light, and their occluders.

Light is reflected about the mirrored direction, blurred by the lobe of a material. A reader blurs any light for each
roughness, removes the reflection of the captured light, and adds that of the new one: docs/live.md.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..gloss.ggx import zonal_factors
from ..gloss.lamp_facing import facing
from ..gloss.mirrored import LEAST_ALPHA
from ..gloss.openness import BANDS as OPEN_BANDS
from ..gloss.openness import openness
from ..gloss.reflections import MOSTLY
from .response import BANDS, about_y
from .terms import as_bytes, rows_of, runs_of

if TYPE_CHECKING:
    from splat2mesh.base.arrays import Coefficients, Indices, Matrix4, Radiance

    from ..gloss.material import Gloss
    from ..lamps.emitters import Emitters
    from ..splats.binding import Binding
    from ..transfer.occluder import Frame

FILE = "gloss.bin"

ROW = 4 + OPEN_BANDS**2
"""Bytes of a row: material, display colour of the occluder, coefficients of the visibility. Then one for each lamp."""

MOST_SHINING = 6
"""Most lamps with highlights of their own, the brightest on glossy surfaces: what is left of the 16 bytes that a splat
takes in a shader."""

LAMP_STEPS = 20.0
"""Steps of a byte per factor of two in the light of a lamp: 254 of them span 12 stops."""


class Shine(NamedTuple):
    """Glossy splats as they are stored. runs: (R, 2) uint32, first row and count. rows: (M, ROW) uint8 of the rows in
    the runs, concatenated. peaks: (4,) of the signed bytes of each coefficient. materials: list of dicts of reflectance
    (3), level, and metal: whether it does not rise at grazing angles. levels: list of dicts of alpha and its factors on
    each degree of a light. captured: (K, 3) coefficients about +y of the light of the capture, display units. lamps:
    list of dicts of term, place (3), reach, peak and steps of those with highlights.
    """

    runs: NDArray[np.uint32]
    rows: NDArray[np.uint8]
    peaks: list[float]
    materials: list[dict[str, Any]]
    levels: list[dict[str, Any]]
    captured: NDArray[np.float64]
    lamps: list[dict[str, Any]]

    def tobytes(self) -> bytes:
        """runs and rows, little-endian, concatenated."""
        return self.runs.astype("<u4").tobytes() + self.rows.tobytes()

    def described(self) -> dict[str, Any]:
        """Its entry in live.json: dict, JSON-clean."""
        return {
            "file": FILE,
            "bytes": ROW + len(self.lamps),
            "runs": len(self.runs),
            "rows": len(self.rows),
            "peaks": self.peaks,
            "materials": self.materials,
            "levels": self.levels,
            "captured": self.captured.tolist(),
            **({"lamps": self.lamps} if self.lamps else {}),
        }


class BundleRows(NamedTuple):
    """Splats in a bundle. matrix: (4, 4) scene_from_splat. kept: (N,) mask of those that may be glossy. order: (N,)
    rows of the source, in the order of the bundle. lamps: the number of the term of each lamp, its emitters, and the
    Frame that they are in."""

    matrix: "Matrix4"
    kept: NDArray[np.bool_]
    order: NDArray[np.int64]
    lamps: "Sequence[tuple[int, Emitters, Frame]]" = ()

    @property
    def rotation(self) -> NDArray[np.float64]:
        """(3, 3) from the frame of the splat into the scene's."""
        linear = self.matrix[:3, :3]
        return np.asarray(linear / np.cbrt(np.linalg.det(linear)), np.float64)


def shine_of(
    binding: "Binding",
    gloss: "Gloss",
    captured: "Coefficients",  # (K, 3) of the light of the capture, our basis, frame of the scene
    colors: "Radiance",  # (V, 3) captured colours, linear
    at: BundleRows,
) -> Shine | None:
    """The Shine of the splats that are bound to glossy surfaces; None without any."""
    places = binding.places
    held = gloss.glossy[places.columns] * places.weights
    lit = np.flatnonzero(binding.lit)
    chosen = (held.sum(axis=1) > MOSTLY) & (places.far < MOSTLY) & at.kept[lit]
    if not chosen.any():
        return None
    columns, weights, held = places.columns[chosen], places.weights[chosen], held[chosen]
    kinds = columns[np.arange(len(columns)), held.argmax(axis=1)]  # the node that gives a splat its material
    materials, levels, number = _materials(gloss, kinds)
    nodes, row = np.unique(columns, return_inverse=True)
    of_nodes = binding.surface.of_vertices(np.asarray(colors, np.float32))
    seen, hidden = openness(binding.surface, nodes, of_nodes, at.rotation)
    row = row.reshape(columns.shape)
    visible = np.einsum("nk,nkc->nc", weights, seen[row])
    color = np.einsum("nk,nkc->nc", weights, hidden[row])
    lamps, shining = _shining(binding, nodes, at)
    peaks = np.maximum(np.percentile(np.abs(visible), 99.9, axis=0), 1e-6)
    rows = np.zeros((len(binding.lit), ROW + len(lamps)), np.uint8)
    packed = np.zeros((len(columns), ROW + len(lamps)), np.uint8)
    packed[:, 0] = 1 + number
    packed[:, 1:4] = bytes_from_unit(srgb_from_linear(np.clip(color, 0.0, 1.0)))
    packed[:, 4:ROW] = np.clip(np.rint(visible / peaks * 127.0), -127, 127).astype(np.int8).view(np.uint8)
    for place, (lamp, light) in enumerate(zip(lamps, shining, strict=True)):
        packed[:, ROW + place] = as_bytes(np.einsum("nk,nk->n", weights, light[row]), lamp["peak"], LAMP_STEPS)
    rows[lit[chosen]] = packed
    rows = rows[at.order]
    runs = runs_of(rows[:, 0] > 0)
    about = about_y(np.asarray(captured, np.float64)[: BANDS**2])
    return Shine(runs, rows[rows_of(runs)], peaks.tolist(), materials, levels, about, lamps)


def _shining(
    binding: "Binding", nodes: "Indices", at: BundleRows
) -> tuple[list[dict[str, Any]], list[NDArray[np.float32]]]:
    """The entries of the lamps that shine most on some nodes, and the light of each on them."""
    found: list[tuple[dict[str, Any], NDArray[np.float32]]] = []
    for term, emitters, frame in at.lamps:
        lamp = facing(binding.surface, nodes, emitters, frame, at.matrix)
        if lamp is not None:
            peak = float(lamp.light.max())
            entry = {"term": term, "place": lamp.place.tolist(), "reach": lamp.reach, "peak": peak, "steps": LAMP_STEPS}
            found.append((entry, lamp.light))
    found.sort(key=lambda each: -each[0]["peak"])
    kept = sorted(found[:MOST_SHINING], key=lambda each: each[0]["term"])
    return [entry for entry, _ in kept], [light for _, light in kept]


def _materials(
    gloss: "Gloss", nodes: NDArray[np.int32]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], NDArray[np.int64]]:
    """The materials and the levels of roughness of some nodes, and the number of each one's material: at most one for
    each patch, so a byte names it."""
    alpha = np.maximum(gloss.alpha[nodes], np.float32(LEAST_ALPHA)).astype(np.float64).round(6)
    rows = np.column_stack([gloss.reflectance[nodes].astype(np.float64), alpha, gloss.flat[nodes]])
    distinct, number = np.unique(rows, axis=0, return_inverse=True)
    alphas = np.unique(distinct[:, 3])
    levels = [{"alpha": float(each), "factors": zonal_factors(float(each), BANDS).tolist()} for each in alphas]
    materials = [
        {"reflectance": row[:3].tolist(), "level": int(np.searchsorted(alphas, row[3])), "metal": bool(row[4])}
        for row in distinct
    ]
    return materials, levels, number.reshape(-1)
