"""Distant light all around the scene: an HDR image in, radiance by direction and spherical harmonics out; and suns."""

import copy
import math
import os
import warnings
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Coefficients, Directions, Floats, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.inputs import reading
from splat2mesh.base.specs import vector
from splat2mesh.scene.color import luminance

from ..sh import harmonics, latlong, rotors
from . import MOST_RADIANCE, projections, skies
from .environment_files import read_light

_ANGLE_DIGITS = 9  # 1e-9 degrees: drops the rounding error of the reduction modulo 360


def turned_about_y(coefficients: Coefficients, angle_deg: float) -> NDArray[np.float64]:
    """Radiance coefficients (K, 3) float64 turned by an active rotation about +y: +z goes towards +x."""
    return rotors.rotate(coefficients, rotors.from_axis_angle([0.0, 1.0, 0.0], math.radians(angle_deg)))


@dataclass(frozen=True, eq=False)
class Suns:
    """Light from S single directions, in a fixed order.

    directions: (S, 3) float64 unit vectors toward the light, scene frame.
    weights: (S, 3) float64 linear, radiance times solid angle: the irradiance of a surface that faces the sun.
    """

    directions: NDArray[np.float64]
    weights: NDArray[np.float64]

    @classmethod
    def none(cls) -> "Suns":
        """No sun at all."""
        return cls(np.zeros((0, 3)), np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.directions)

    def rotated(self, angle_deg: float) -> "Suns":
        """Return these suns turned by an active rotation about +y, as `Environment.rotated` turns."""
        angle = math.radians(angle_deg)
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        return Suns(self.directions @ turn.T, self.weights)

    def sh(self, bands: int) -> NDArray[np.float64]:
        """Radiance coefficients (B^2, 3) float64 of the suns as points."""
        return harmonics.evaluate(self.directions, bands).T @ self.weights


class Environment:
    """Light from infinitely far away, as a lat-long image that can be turned about +y.

    radiance: (H, W, 3) float32 linear, read-only: canonical lat-long, NOT turned by `rotation_deg`.
    name: for file names and reports.
    rotation_deg: active rotation about +y in [0, 360), counter-clockwise seen from +y (+z goes to +x).
    formula: name of the built-in sky that it is, which pictures show in any detail; None for others.
    turned: axis and angle_deg of a turn about another axis that the image has; None without.
    exposed: whether it is in the unit of a capture's colours, which need no exposure to be found.
    repaired: dict of defect -> number of pixels that had it. "NaN", "negative": now 0;
        "infinite": the largest finite value of its channel; "above 1e+12": that.
    """

    def __init__(self, radiance: Radiance, name: str = "environment", rotation_deg: float = 0.0) -> None:
        """Make an environment of an image (H, W, 3). Pixels that hold no radiance are repaired, with one DataWarning.

        Raises InputError for another shape, an image without a finite pixel, and an angle that is not finite.
        """
        radiance = np.asarray(radiance)
        if radiance.ndim != 3 or radiance.shape[2] != 3 or 0 in radiance.shape:
            raise InputError(f"an environment must be an (H, W, 3) image, found shape {radiance.shape}")
        self.name = str(name).encode("utf-8", "replace").decode("utf-8")  # a file's name may be no text, files are
        self.radiance, self.repaired = _repaired(radiance, self.name)
        self.radiance.setflags(write=False)
        self.rotation_deg = _reduced(rotation_deg)
        self.formula: str | None = None
        self.turned: dict[str, Any] | None = None
        self.exposed = False
        self._derived: dict[Hashable, Any] = {}  # of the unrotated image, by key, shared with all rotated copies

    @classmethod
    def load(cls, source: str | os.PathLike[str]) -> "Environment":
        """Read an OpenEXR or Radiance HDR file, or make the built-in sky of a name of `skies.BUILTIN`; return it
        unturned.

        Angular maps and vertical crosses are recognised and resampled; anything else is taken as lat-long. Raises
        InputError for an unknown name, and for a file that is missing, damaged or of another kind.
        """
        builtin = str(source).lower()
        if builtin in skies.BUILTIN and not os.path.lexists(source):
            environment = cls(skies.image_of(builtin), builtin)
            environment.formula = builtin
            return environment
        path = Path(source)
        with reading(path):
            image = read_light(path)
        image, repaired = _repaired(image, path.name)
        projection = projections.recognise(image)
        if projection == "angular map":
            image = projections.latlong_from_angular(image)
        elif projection == "vertical cross":
            image = projections.latlong_from_cross(image)
        elif projection is None:
            height, width = image.shape[:2]
            warnings.warn(
                f"{path.name}: {width} x {height} is neither 2:1, nor an angular map (square, black outside "
                "its circle), nor a vertical cross (3:4): taken as lat-long",
                DataWarning,
                stacklevel=2,
            )
        if not image.any():
            message = f"{path.name} is black everywhere, and so is the scene"
            warnings.warn(message, DataWarning, stacklevel=2)
        environment = cls(image, path.stem)
        environment.repaired = repaired
        return environment

    def rotated(self, angle_deg: float) -> "Environment":
        """Return this environment turned further, with the image shared.

        angle_deg: active, about +y. Angles that differ by whole turns give identical results, to the bit. Raises
        InputError for one that is not finite.
        """
        turned = copy.copy(self)
        turned.rotation_deg = _reduced(self.rotation_deg + _reduced(angle_deg))
        return turned

    def turned_about(self, axis: Sequence[float], angle_deg: float) -> "Environment":
        """Return this environment turned further, right-handed about an axis (3,), scene frame, of any length but 0.

        About the vertical it is as `rotated` gives it, about another axis with an image of its own. Raises InputError
        for an axis of length 0, and for what is not finite.
        """
        x, y, z = vector("axis", axis)
        if x == y == z == 0.0:
            raise InputError("`axis` 0,0,0: expected an axis of some length")
        if x == z == 0.0:
            return self.rotated(math.copysign(angle_deg, angle_deg * y))
        angle_deg = _reduced(angle_deg)
        largest = max(map(abs, (x, y, z)))  # scaled by it, no square overflows
        rotor = rotors.from_axis_angle((x / largest, y / largest, z / largest), math.radians(angle_deg))
        image = projections.latlong_turned(self.radiance, rotor, self.rotation_deg)
        found = Environment(image, f"{self.name}_{angle_deg:g}_about_{x:g},{y:g},{z:g}")
        found.exposed, found.repaired = self.exposed, self.repaired
        found.turned = {"axis": [x, y, z], "angle_deg": angle_deg}
        return found

    def sh(self, bands: int) -> NDArray[np.float64]:
        """Return the radiance coefficients, (B^2, 3) float64 for 1 to 10 bands B, in the scene frame, rotation
        included."""
        unrotated = self.derived(("sh", bands), lambda: latlong.project_latlong(self.radiance, bands))
        return turned_about_y(unrotated, self.rotation_deg)

    def derived(self, key: Hashable, compute: Callable[[], Any]) -> Any:
        """Return the result of `compute`, computed once under this key for the image and all its rotated copies."""
        if key not in self._derived:
            self._derived[key] = compute()
        return self._derived[key]

    def lookup(self, directions: Directions) -> NDArray[np.float32]:
        """Return the radiance, (N, 3) float32 linear, that arrives from directions (N, 3) of any length toward the
        light, scene frame: bilinear, across the seam and the poles."""
        x, y, z = np.asarray(directions, np.float64).T
        height, width = self.radiance.shape[:2]
        longitude = np.arctan2(x, z) - math.radians(self.rotation_deg)
        column = (0.5 - longitude / (2.0 * np.pi)) * width - 0.5
        row = (0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * height - 0.5
        above = np.floor(row)
        share = (row - above)[:, None]
        values = self._along_row(above, column) * (1.0 - share) + self._along_row(above + 1, column) * share
        return values.astype(np.float32)

    @property
    def mean_luminance(self) -> float:
        """Rec. 709 luminance averaged over the sphere by solid angle."""
        return float(luminance(self.sh(1)[0])) / math.sqrt(4.0 * math.pi)

    def _along_row(self, row: NDArray[np.float64], column: NDArray[np.float64]) -> Floats:
        """Linear interpolation along a row. The row beyond a pole is the last one again, half a turn away."""
        height, width = self.radiance.shape[:2]
        column = column + 0.5 * width * ((row < 0) | (row >= height))
        row = np.clip(row, 0, height - 1).astype(np.intp)
        left = np.floor(column)
        share = (column - left)[:, None]
        left = left.astype(np.intp) % width
        return self.radiance[row, left] * (1.0 - share) + self.radiance[row, (left + 1) % width] * share


def _reduced(angle_deg: float) -> float:
    """The angle in [0, 360), so that whole turns give identical results to the bit."""
    if not math.isfinite(angle_deg):
        raise InputError(f"a rotation must be a finite number of degrees, found {angle_deg}")
    return round(float(angle_deg) % 360.0, _ANGLE_DIGITS) % 360.0


def _repaired(image: ArrayLike, name: str) -> tuple[NDArray[np.float32], dict[str, int]]:
    """A float32 copy of the image without NaN, infinite or negative values, and how many pixels had each.

    Raises InputError when no pixel is finite. One DataWarning states the counts.
    """
    with np.errstate(over="ignore"):
        image = np.array(image, np.float32)
    if image.min() >= 0.0 and image.max() <= MOST_RADIANCE:
        return image, {}
    if not np.isfinite(image).all(axis=2).any():
        raise InputError(f"{name}: no pixel of the image is finite; write the file again")
    defects = {"NaN": np.isnan(image), "infinite": image == np.inf, "negative": image < 0.0}
    repaired = {defect: int(mask.any(axis=2).sum()) for defect, mask in defects.items() if mask.any()}
    image[defects["negative"] | defects["NaN"]] = 0.0
    for channel in range(3):
        values = image[..., channel]
        values[defects["infinite"][..., channel]] = values[np.isfinite(values)].max(initial=0.0)
    bright = image > MOST_RADIANCE
    if bright.any():
        image[bright] = MOST_RADIANCE
        repaired[f"above {MOST_RADIANCE:g}"] = int(bright.any(axis=2).sum())
    counts = ", ".join(f"{count} {defect}" for defect, count in repaired.items())
    warnings.warn(f"{name}: repaired invalid pixels: {counts}", DataWarning, stacklevel=3)
    return image, repaired
