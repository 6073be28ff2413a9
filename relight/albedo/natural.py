"""Natural light as a prior: mean and covariance of the log radiance of photographed lights.

A light map may be turned by any angle about the vertical, so that spherical harmonics of different orders are
uncorrelated, and only those of order 0 have a mean: skies are brighter than the ground. Source: the statistics of
natural illumination (Dror, Willsky and Adelson, 2004), here of the lights named in `natural_light.npz`.
"""

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrayfiles import load_arrays
from splat2mesh.base.arrays import Directions, Radiance
from splat2mesh.base.inputs import GIB
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.color import luminance

from ..sh import harmonics

BANDS = 5
"""Of the log radiance: 25 numbers for each axis of colour. Narrower light is a sun."""

AXES = np.array([luminance(np.eye(3)), [1.0, 0.0, -1.0], [-0.5, 1.0, -0.5]])
"""(3, 3) log colour to log luminance, red over blue, green over both: rows of axes on which lights vary apart."""

FLOOR = 1e-3
"""Of the mean luminance: darker texels of a light map are noise of the camera."""

FREE_LEVEL = 4.0
"""Spread of the log brightness of a light, which says nothing: captures are exposed."""

RIDGE = 0.02
"""Part of the mean variance that is added to every coefficient, so no direction of the prior is infinitely stiff."""

KINDS = {
    "clear": ("clear sun", "partly"),
    "hazy": ("partly", "overcast"),
    "overcast": ("overcast",),
    "shade": ("forest", "urban"),
    "night": ("night",),
}
"""Names of skies that a user may know, as the kinds of lights in the file."""

FILE = Path(__file__).parent / "data" / "natural_light.npz"


class NaturalLight(NamedTuple):
    """A Gaussian over log radiance in harmonics. mean: (K, 3) RGB. precision: (3 K, 3 K), colours outermost."""

    mean: NDArray[np.float64]
    precision: NDArray[np.float64]

    @property
    def bands(self) -> int:
        """Of the log radiance."""
        return harmonics.bands_of(self.mean)


def log_harmonics(radiance: Radiance) -> NDArray[np.float64]:
    """(K, 3) coefficients of log luminance, red over blue, and green over both, of a light map (H, W, 3)."""
    height, width = radiance.shape[:2]
    directions = texel_directions(height, width).reshape(-1, 3)
    area = np.repeat(row_solid_angles(height, width).ravel(), width)
    colors = np.asarray(radiance, np.float64).reshape(-1, 3)
    mean = float(area @ luminance(colors)) / (4.0 * np.pi)
    logs = np.log(np.maximum(colors, FLOOR * max(mean, 1e-30))) @ AXES.T
    return np.asarray((harmonics.evaluate(directions, BANDS) * area[:, None]).T @ logs)


def gaussian_of(
    coefficients: NDArray[np.floating],  # (L, K, 3) of `log_harmonics`
    centered: NDArray[np.floating] | None = None,  # (L', K, 3) lights whose spread counts; the same by default
) -> NaturalLight:
    """The NaturalLight of a list of lights: their mean, and their covariance about it."""
    logs, around = np.array(coefficients, np.float64), np.array(coefficients if centered is None else centered)
    logs[:, 0, 0] = 0.0
    around[:, 0, 0] = 0.0
    _, order = harmonics.degrees_and_orders(BANDS)
    mean = logs.mean(axis=0) * (order == 0)[:, None]
    off = around - around.mean(axis=0) * (order == 0)[:, None]
    count = len(order)
    precision = np.zeros((3, count, 3, count))
    for axis in range(3):
        covariance = np.zeros((count, count))
        for number in range(BANDS):
            sides = [np.flatnonzero(order == number), np.flatnonzero(order == -number)][: 1 + (number > 0)]
            block = np.mean([off[:, rows, axis].T @ off[:, rows, axis] for rows in sides], axis=0) / len(off)
            for rows in sides:
                covariance[np.ix_(rows, rows)] = block
        covariance += RIDGE * np.trace(covariance) / count * np.eye(count)
        if axis == 0:
            covariance[0, 0] += 4.0 * np.pi * FREE_LEVEL**2
        precision += np.einsum("a,b,ij->aibj", AXES[axis], AXES[axis], np.linalg.inv(covariance))
    return NaturalLight(mean @ np.linalg.inv(AXES).T, precision.reshape(3 * count, 3 * count))


@lru_cache(maxsize=8)
def natural_light(kind: str | None = None) -> NaturalLight:
    """The NaturalLight of all lights of the file; of one of KINDS, its mean with the spread of all."""
    file = load_arrays(FILE, GIB)
    logs, kinds = file["coefficients"].astype(np.float64), file["kinds"]
    rows = np.isin(kinds, KINDS[kind]) if kind else np.ones(len(logs), bool)
    return gaussian_of(logs[rows], logs)


def log_radiance(coefficients: NDArray[np.float64], directions: Directions) -> NDArray[np.float64]:
    """(D, 3) log radiance of coefficients (K, 3) at directions (D, 3)."""
    return harmonics.evaluate(directions, harmonics.bands_of(coefficients)) @ coefficients
