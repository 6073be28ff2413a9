"""The colours of the surface in each mode of the session."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..sh.normals import unit_normals
from .quick import display_bytes

if TYPE_CHECKING:
    from .session import Session


class ColorMode(NamedTuple):
    """One way to colour. title: on screen. text: for the help. colors: of a Session, (V, 3) uint8.

    lights: whether it depends on the light.
    """

    title: str
    text: str
    colors: Callable[["Session"], NDArray]
    lights: bool = False


def _relit(session: "Session") -> NDArray:
    radiance = session.radiance()
    return session.scene.colors_srgb if radiance is None else display_bytes(radiance, session.exposure())


def _albedo(session: "Session") -> NDArray:
    albedo = session.albedos[session.state.albedo]
    if albedo is None:
        return np.full((len(session.scene.vertices), 3), 255, np.uint8)
    return bytes_from_unit(srgb_from_linear(albedo))


def _normals(session: "Session") -> NDArray:
    return bytes_from_unit(0.5 + 0.5 * unit_normals(session.scene.normals))


MODES = {
    "relit": ColorMode("Relit", "under the light", _relit, True),
    "albedo": ColorMode("Albedo", "the surface colour, without light", _albedo),
    "normals": ColorMode("Normals", "red to the right, green up, blue to the front", _normals),
}


def surface_colors(session: "Session") -> NDArray:
    """The colours of the surface in the present mode, (V, 3) uint8 sRGB: the captured ones before the first light."""
    mode, state, hand = MODES[session.state.mode], session.state, session.hand
    if hand is not None and state.tool == "hand":
        return hand.colors(lambda: session.scene.colors_srgb)
    if session.parts is not None and state.tool == "parts":
        return session.parts.tinted(mode.colors(session))
    if mode.lights:
        return mode.colors(session)
    return session.remembered("colors", (state.mode, state.albedo), lambda: mode.colors(session))
