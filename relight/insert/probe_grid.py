"""Positions of the probes of a grid, and which of them are in open air."""

import math
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import EVENLY, fibonacci_sphere
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Occluder

MOST = 4096
"""Most probes of a grid: each renders a picture."""

MIDDLE = 0.05, 0.95
"""Quantiles of the vertices that bound a grid by default: far background lies beyond."""

BACKS = 0.25
"""Share of directions that meet back faces, and more than front faces, above which a probe is in a wall or ground."""


@dataclass(frozen=True)
class ProbeGrid:
    """Number of probes along x, y, z of the scene frame, or, where counts is None, their largest spacing."""

    counts: tuple[int, int, int] | None
    spacing: float = 0.0

    @classmethod
    def parse(cls, text: str) -> "ProbeGrid":
        """Parse 4x3x4, or a spacing in units of the scene. Raises InputError for anything else."""
        if re.fullmatch(r"\d{1,4}x\d{1,4}x\d{1,4}", text):
            x, y, z = (int(each) for each in text.split("x"))
            if 1 <= x * y * z <= MOST:
                return cls((x, y, z))
            raise InputError(f"`probes` {text}: {x * y * z:,} probes; expected 1 to {MOST:,}")
        try:
            spacing = float(text)
        except ValueError:
            spacing = math.nan
        if math.isfinite(spacing) and spacing > 0.0:
            return cls(None, spacing)
        raise InputError(f"`probes` {text}: expected counts along x, y and z, such as 4x3x4, or a spacing above 0")

    def within(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (N, 3) in a box, from corner to corner, (3,) each; a single one along an axis is in the middle.
        x runs fastest, then y.

        Raises InputError for more than MOST."""
        size = high - low
        counts = np.array(self.counts) if self.counts else np.ceil(size / self.spacing - 1e-9) + 1
        if counts.prod() > MOST:
            found = f"`probes` {self.spacing:g}: {counts.prod():,.0f} probes"
            raise InputError(f"{found}; expected at most {MOST:,}, so a larger spacing")
        counts = counts.astype(np.int64)
        step = np.where(counts > 1, size / np.maximum(counts - 1, 1), 0.0)
        first = np.where(counts > 1, low, (low + high) / 2)
        z, y, x = np.meshgrid(*(np.arange(each) for each in counts[::-1]), indexing="ij")
        return np.asarray(first + np.stack([x, y, z], axis=-1).reshape(-1, 3) * step)


def usual_box(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest corner, (3,) each, of the default box of a grid, scene frame."""
    low, high = np.quantile(scene.vertices.astype(np.float64), MIDDLE, axis=0)
    return low, high


def free(scene: Scene, occluder: Occluder, positions: Points) -> Mask:
    """Mask (N,) bool of the positions (N, 3), scene frame, that are outside walls, bodies and the ground."""
    directions = fibonacci_sphere(EVENLY)
    a, b, c = np.moveaxis(scene.vertices[scene.faces].astype(np.float64), 1, 0)
    normals = np.cross(b - a, c - a)
    result = np.empty(len(positions), bool)
    rays = np.empty((EVENLY, 6), np.float32)
    rays[:, 3:] = directions
    for number, at in enumerate(np.asarray(positions, np.float64)):
        rays[:, :3] = occluder.frame.unit(at[None])
        faces = occluder.first_hits(rays).faces
        met = np.flatnonzero(faces >= 0)
        backs = int(((normals[faces[met]] * directions[met]).sum(axis=1) > 0.0).sum())
        result[number] = not (backs > BACKS * EVENLY and 2 * backs > len(met))
    return result
