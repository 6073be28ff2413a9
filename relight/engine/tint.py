"""The colour of the captured light, where a surface is known to be white.

Each colour of the light from outside gets a factor; light between surfaces stays as seen. The luminance stays.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import BLACK, luminance

from ..albedo.captured import described_light
from ..albedo.division import Prior, albedo_of
from ..light.environment import Environment

if TYPE_CHECKING:
    from .appearance import Appearance

LEAST_COLOR = 0.02
"""Least value of each colour of the light, at luminance 1: a light without a colour does not show the albedo in it."""

WHITE_RADIUS = 0.01
"""Radius, in diagonals of the scene, over which colours around a white position are averaged."""


def retinted(look: "Appearance", color: NDArray[np.float64], bounced: NDArray[np.float32]) -> "Appearance":
    """Return the Appearance under a captured light of another colour.

    color: (3,) linear Rec. 709, luminance 1, of the mean radiance of that light. bounced: (V, 3) float32, the part of
    the irradiance that other surfaces send, in the unit of the captured colours.
    """
    assert look.capture is not None and look.environment is not None and look.prior is not None
    factor = (np.maximum(color, LEAST_COLOR) / np.asarray(look.capture["color"])).astype(np.float32)
    bounced = np.minimum(bounced, look.irradiance)
    irradiance = bounced + (look.irradiance - bounced) * factor
    lit = look.irradiance.min(axis=1) > 0.0
    change = np.median(irradiance[lit] / look.irradiance[lit], axis=0) if lit.any() else factor
    usual = np.clip(look.prior.albedo / change, 0.0, 1.0).astype(np.float32)
    prior = Prior(usual, (look.prior.irradiance * change).astype(np.float32))
    own = look.environment
    environment = Environment(own.radiance * factor, own.name, own.rotation_deg)
    names = "direction", "concentration", "color", "brightness"
    values = [np.asarray(each).tolist() for each in described_light(environment)]
    capture = look.capture | dict(zip(names, values, strict=True))
    albedo = albedo_of(look.captured, irradiance, prior)
    return look._replace(albedo=albedo, irradiance=irradiance, prior=prior, environment=environment, capture=capture)


def color_where_white(
    look: "Appearance",
    bounced: NDArray[np.float32],
    vertices: NDArray[np.float32],  # (V, 3)
    diagonal: float,
    place: Sequence[float],  # (3,) in their frame
) -> NDArray[np.float64]:
    """(3,) the colour of the captured light, luminance 1, under which the surface at a place is neutral.

    Raises InputError where no surface is near, and where it was black or dark.
    """
    assert look.capture is not None
    apart = np.linalg.norm(vertices - np.asarray(place, np.float32), axis=1)
    if apart.min() > WHITE_RADIUS * diagonal:
        raise InputError(f"`white_at`: no surface is there, the nearest is {apart.min() / diagonal:.1%} away")
    near = apart <= WHITE_RADIUS * diagonal
    parts = look.captured, look.irradiance, np.minimum(bounced, look.irradiance)
    own, received, others = (np.median(each[near].astype(np.float64), axis=0) for each in parts)
    direct = received - others
    if own.min() <= 0.0 or direct.min() <= BLACK:
        raise InputError("`white_at`: the surface there is too dark to show the colour of its light")
    neutral = own * (luminance(received) / luminance(own))  # irradiance that makes it grey, as bright as estimated
    color = np.maximum(neutral - others, LEAST_COLOR * direct) / direct * np.asarray(look.capture["color"])
    return np.asarray(color / luminance(color))
