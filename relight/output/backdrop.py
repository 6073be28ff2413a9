"""The background of a picture: the light of the scene, only as sharp as it is known."""

from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.threads import in_batches

from ..light import skies

if TYPE_CHECKING:
    from ..light.environment import Environment

COARSE = 2.0
"""Pixels that a texel may cover before it shows as a square: wider ones are shown out of focus."""

DEFOCUS = 1.2
"""Standard deviation of the blur of such an image, in texels: the grain is gone, its subject is still recognisable."""

PADDING = 8  # texels repeated across the seam, more than a cubic spline or the blur's centre reaches

EDGE, NEAR_SUN = 20.0, np.radians(3.0)
"""Pixels from the horizon, and the angle from a sun, within which a built-in sky takes several samples a pixel."""

GLARE = ((0.8, np.radians(0.6)), (0.25, np.radians(3.0)))
"""Display values at a sun's rim, and the angle at which 1/e is left: eyes and lenses spread what is too bright."""


def behind(
    environment: "Environment",
    directions: NDArray,  # (N, 3) unit, scene frame
    pixel: float,  # angle that a pixel of the picture covers, radians
    exposure: float,  # display value per unit of radiance
) -> NDArray:
    """Exposed linear radiance (N, 3) float32 that the picture shows in these directions, unbounded.

    A built-in sky is drawn by its formula, with its horizon and its sun; an image whose texels are much wider than a
    pixel is shown out of focus, any other as it is.
    """
    if environment.formula is not None:
        return _sky(environment.formula, directions, environment.rotation_deg, exposure)
    if is_soft(environment, pixel):
        return _soft_lookup(environment, directions) * np.float32(exposure)
    return environment.lookup(directions) * np.float32(exposure)


def is_soft(environment: "Environment", pixel: float) -> bool:
    """Whether it is shown out of focus where a pixel covers this angle."""
    return environment.formula is None and np.pi / environment.radiance.shape[0] > COARSE * pixel


def is_even(environment: "Environment", directions: NDArray, pixel: float) -> NDArray[np.bool_]:
    """(N,) bool, where a built-in sky changes so little that the middle of a pixel shows it: not at horizon or sun."""
    sun = None if environment.formula is None else skies.sun_of(environment.formula)
    if environment.formula is None:
        return np.zeros(len(directions), bool)
    even = np.abs(directions[:, 1]) > EDGE * pixel
    if sun is not None:
        even &= _unturned(directions, environment.rotation_deg) @ sun[0] < np.cos(NEAR_SUN)
    return even


def _sky(name: str, directions: NDArray, turn_deg: float, exposure: float) -> NDArray[np.float32]:
    shown = np.empty(directions.shape, np.float32)
    skies.seen(name, directions[:1])  # what is found once, by one thread

    def work(part: slice) -> None:
        shown[part] = _part_of_sky(name, _unturned(directions[part], turn_deg), exposure)

    in_batches(work, len(directions))
    return shown


def _part_of_sky(name: str, directions: NDArray, exposure: float) -> NDArray[np.float32]:
    shown = skies.seen(name, directions) * np.float32(exposure)
    sun = skies.sun_of(name)
    if sun is not None:
        center, color = sun
        away = np.arccos(np.clip(directions @ center, -1.0, 1.0))
        glare = sum(peak * np.exp(-away / width) for peak, width in GLARE)
        glare = np.where(directions[:, 1] > 0.0, glare, glare * np.exp(directions[:, 1] / 0.01))
        shown += (glare[:, None] * (color / color.max())).astype(np.float32)
    return shown


def _unturned(directions: NDArray, angle_deg: float) -> NDArray[np.float64]:
    """Directions (N, 3) in the frame of the environment's image."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = np.asarray(directions, np.float64).T
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


def _soft_lookup(environment: "Environment", directions: NDArray) -> NDArray[np.float32]:
    splines = environment.derived("out of focus", lambda: _out_of_focus(environment.radiance))
    height = splines.shape[0]
    width = splines.shape[1] - 2 * PADDING
    x, y, z = _unturned(directions, environment.rotation_deg).T
    column = (0.5 - np.arctan2(x, z) / (2.0 * np.pi)) * width - 0.5 + PADDING
    row = np.clip((0.5 - np.arctan2(y, np.hypot(x, z)) / np.pi) * height - 0.5, 0.0, height - 1.0)
    found = [
        scipy.ndimage.map_coordinates(splines[..., channel], (row, column), order=3, prefilter=False, mode="nearest")
        for channel in range(3)
    ]
    return np.maximum(np.stack(found, axis=-1), 0.0).astype(np.float32)


def _out_of_focus(radiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Cubic spline coefficients (H, W + 2 PADDING, 3) float32 of the blurred image, repeated across its seam."""
    soft = scipy.ndimage.gaussian_filter1d(radiance, DEFOCUS, axis=0, mode="nearest")
    height = len(soft)
    for row in range(height):  # as wide on the sphere in every row
        wide = DEFOCUS / max(np.sin(np.pi * (row + 0.5) / height), 4.0 * DEFOCUS / soft.shape[1])
        soft[row] = scipy.ndimage.gaussian_filter1d(soft[row], wide, axis=0, mode="wrap")
    soft = np.concatenate([soft[:, -PADDING:], soft, soft[:, :PADDING]], axis=1)
    return np.stack([scipy.ndimage.spline_filter(soft[..., channel], 3) for channel in range(3)], axis=-1).astype(
        np.float32
    )
