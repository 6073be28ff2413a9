"""Inserted objects of the bundle under its first light: a lit mesh, and its effect on the splats around it."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices
from splat2mesh.splats.splats import SH_C0, Splats

from ..splats.light_ratio import CURVE_OFFSET
from .movable import FILE as MOVABLE_FILE
from .movable import Movable

FILE, MESH = "objects.bin", "inserted.glb"

UNIT = 1024
"""Range of a gain of 16 bits, as on the page."""

LEAST = 0.01
"""A gain acts on a display colour plus .055 (docs/live.md). A colour with less than LEAST in both has no gain."""


class LiveObjects(NamedTuple):
    """glb: bytes of the lit mesh, scene frame; none if all objects are splats. angle_deg: of their light, the first of
    the bundle. rows: (M,) uint32 of the splats that they change, ascending. gains: (M, 3) uint16. movable: each object,
    for the page to move."""

    glb: bytes
    angle_deg: float
    rows: NDArray[np.uint32]
    gains: NDArray[np.uint16]
    movable: Sequence[Movable] = ()

    def in_order(self, order: Indices) -> "LiveObjects":
        """The same for reordered splats. order: (N,) their present rows."""
        back = np.full(int(order.max()) + 1, -1, np.int64)
        back[order] = np.arange(len(order))
        known = self.rows <= order.max()
        rows = np.where(known, back[np.where(known, self.rows, 0)], -1)
        kept = np.flatnonzero(rows >= 0)
        kept = kept[np.argsort(rows[kept])]
        return self._replace(rows=rows[kept].astype(np.uint32), gains=self.gains[kept])

    def tobytes(self) -> bytes:
        """Content of FILE: rows, then gains."""
        return self.rows.astype("<u4").tobytes() + self.gains.astype("<u2").tobytes()

    def described(self) -> dict[str, Any]:
        """Its entry in live.json."""
        mesh = {"mesh": MESH} if self.glb else {}
        entry = {"file": FILE, "rows": len(self.rows), "unit": UNIT, "light": 0, "angle_deg": self.angle_deg, **mesh}
        if self.movable:
            entry["moving"] = MOVABLE_FILE
            entry["movable"] = [each.described(number) for number, each in enumerate(self.movable)]
        return entry


def objects_of(
    without: Splats, shadowed: Splats, glb: bytes, angle_deg: float, movable: Sequence[Movable] = ()
) -> LiveObjects:
    """The LiveObjects of splats under their first light, given without and with the objects, in the same order."""
    before, after = (SH_C0 * np.asarray(each.sh[:, 0], np.float64) + 0.5 + CURVE_OFFSET for each in (without, shadowed))
    gain = np.where(before > LEAST, np.maximum(after, 0.0) / np.maximum(before, LEAST), 1.0)
    packed = np.minimum(np.rint(gain * UNIT), 2**16 - 1).astype(np.uint16)
    rows = np.flatnonzero((packed != UNIT).any(axis=1))
    return LiveObjects(glb, float(angle_deg), rows.astype(np.uint32), packed[rows], movable)
