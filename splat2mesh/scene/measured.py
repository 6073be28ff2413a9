"""Measurements of splats beyond their surface: the captured sky, and the parts that are volumes.

Kept beside scene.json in one compressed file, `measured.npz`.
"""

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrayfiles import load_arrays
from ..base.errors import InputError
from ..base.inputs import GIB
from ..base.sphere import row_solid_angles
from .optical_depth import OpticalDepth

FILE = "measured.npz"

SKY_HEIGHT = 64
SKY_WIDTH = 2 * SKY_HEIGHT
"""Texels of 2.8 degrees: the light of a scene needs no finer ones, except for suns, and those are clipped."""

THICKET = 0.4
"""Mean volume of the vertices from which a scene without a sky is taken to have foliage; a rock in grass has 0.6."""


class CapturedSky(NamedTuple):
    """A lat-long picture of a captured sky, scene frame, laid out as environments are: row 0 is +y.

    radiance: (H, W, 3) float32, linear, unit of the captured colours: mean over the part of a texel that binds. bound:
    (H, W, 3) float32, the part of a texel that was seen and not clipped, by colour. clipped: (H, W, 3) float32, the
    part that was seen and clipped: at least 1 came from there.
    """

    radiance: np.ndarray
    bound: np.ndarray
    clipped: np.ndarray

    @property
    def coverage(self) -> float:
        """Part of the sphere that was seen, in [0, 1]."""
        height, width = self.bound.shape[:2]
        return float(((self.bound + self.clipped).mean(axis=2) * row_solid_angles(height, width)).sum() / (4.0 * np.pi))

    @property
    def clipped_share(self) -> float:
        """Part of what was seen that was clipped, in [0, 1]."""
        areas = row_solid_angles(*self.bound.shape[:2])
        seen = ((self.bound + self.clipped).mean(axis=2) * areas).sum()
        return float((self.clipped.mean(axis=2) * areas).sum() / max(seen, 1e-12))


class Measured(NamedTuple):
    """Measurements on the splats of a scene.

    splat_volume: (S,) float32, in [0, 1], volume share of each row of the source (foliage, grass, hair), 0 where it was
    not measured. vertex_volume: (V,) float32, the same for the vertices of the scene, chunk after chunk. depth: of a
    scene with foliage.
    """

    sky: CapturedSky | None
    splat_volume: np.ndarray
    vertex_volume: np.ndarray
    depth: OpticalDepth | None = None

    @property
    def foliage(self) -> NDArray[np.float32]:
        """(V,) float32: how far each vertex is of leaves or grass. All 0 for a scene that has no sky and is no thicket:
        splats of an object's contacts and gloss lie as leaves do, and a tabletop has a mean volume of 0.29."""
        thicket = len(self.vertex_volume) and self.vertex_volume.mean() > THICKET
        return self.vertex_volume if self.sky is not None or thicket else np.zeros_like(self.vertex_volume)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as one file; the same contents give the same bytes."""
        arrays: dict[str, Any] = {
            "splat_volume": _bytes(self.splat_volume),
            "vertex_volume": _bytes(self.vertex_volume),
        }
        if self.sky is not None:
            arrays["sky_radiance"] = self.sky.radiance.astype(np.float16)
            arrays |= {"sky_bound": _bytes(self.sky.bound), "sky_clipped": _bytes(self.sky.clipped)}
        if self.depth is not None:
            arrays |= self.depth.arrays()
        with open(path, "wb") as file:
            np.savez_compressed(file, **arrays)

    def described(self) -> dict[str, Any]:
        """Return its entry in scene.json. Returns the file and the figures of what is in it."""
        found: dict[str, Any] = {"file": FILE, "sky": None}
        found["volume_share"] = round(float(self.vertex_volume.mean()), 4) if len(self.vertex_volume) else 0.0
        if self.sky is not None:
            coverage, clipped = self.sky.coverage, self.sky.clipped_share
            found["sky"] = {"coverage": round(coverage, 4), "clipped_share": round(clipped, 4)}
        return found

    @classmethod
    def load(cls, path: str | os.PathLike[str], vertices: int) -> "Measured":
        """Read what `save` wrote. vertices: of the scene. Raises InputError for a file that is damaged, or of another
        number of vertices."""
        try:
            arrays = load_arrays(path, GIB)
            sky = None
            if "sky_radiance" in arrays:
                parts = arrays["sky_bound"], arrays["sky_clipped"]
                sky = CapturedSky(arrays["sky_radiance"].astype(np.float32), *map(_shares, parts))
                if not sky.radiance.shape == sky.bound.shape == sky.clipped.shape:
                    raise ValueError("the parts of its sky differ in size")
            depth = OpticalDepth.restored(arrays)
            found = cls(sky, _shares(arrays["splat_volume"]), _shares(arrays["vertex_volume"]), depth)
            if len(found.vertex_volume) != vertices:
                raise ValueError(f"it is of {len(found.vertex_volume)} vertices, the scene has {vertices}")
            return found
        except (KeyError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path}: damaged ({error}); convert the splat again") from error


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def _shares(values: NDArray[Any]) -> NDArray[np.float32]:
    return values.astype(np.float32) / np.float32(255.0)
