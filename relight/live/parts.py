"""Parts of a capture that the page lights apart: those that the folder of its scene keeps."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Triple
from splat2mesh.base.errors import InputError

FILE = "parts.bin"

MOST_PARTS = int(np.iinfo(np.uint8).max)
"""Their numbers, from 1, are bytes."""


class LivePart(NamedTuple):
    """A part. shares: (N,) float32 of the splats in it, with a rim. exposure_ev: stops by which its light is brighter
    at the start. tint: of that, linear, luminance 1. kept: its entry in the folder of the scene."""

    name: str
    shares: NDArray[np.float32]
    exposure_ev: float
    tint: Triple
    kept: Mapping[str, Any]


class LiveParts(NamedTuple):
    """members: (N, 2) uint8, the number of the part that each splat is in, and its share of that out of 255. entries:
    of live.json."""

    members: NDArray[np.uint8]
    entries: list[dict[str, Any]]

    @classmethod
    def of(cls, parts: Sequence[LivePart], order: Indices) -> "LiveParts | None":
        """Parts, the last one on top; None without any. order: (N,) rows of the splats. Raises InputError for too
        many."""
        if len(parts) > MOST_PARTS:
            raise InputError(f"`formats` web: the scene keeps {len(parts)} parts, and a page has at most {MOST_PARTS}")
        members = np.zeros((len(order), 2), np.uint8)
        for number, part in enumerate(parts, 1):
            share = np.rint(255.0 * part.shares[order]).astype(np.uint8)
            members[share > 0] = np.stack([np.full_like(share, number), share], axis=1)[share > 0]
        entries = [
            {"name": each.name, "exposure": each.exposure_ev, "tint": list(each.tint), "kept": dict(each.kept)}
            for each in parts
        ]
        return cls(members, entries) if parts else None

    def tobytes(self) -> bytes:
        """Content of FILE."""
        return self.members.tobytes()
