"""The colours of the surface in each mode of the session."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..sh.normals import unit_normals
from .quick import display_bytes

if TYPE_CHECKING:
    from .session import Session

PLAIN = 96
"""Grey of a surface while its colours are computed."""

DARKEST = 0.01
"""Part of the root mean square of the reference that is added to the denominator of an error, which keeps the error of
black vertices small."""


class ColorMode(NamedTuple):
    """One way to colour. title: on screen. text: for the help. colors: of a Session, (V, 3) uint8.

    lights: whether it depends on the light. scale: of a Session, the end of its scalar bar.
    """

    title: str
    text: str
    colors: Callable[["Session"], NDArray]
    lights: bool = False
    scale: Callable[["Session"], float] | None = None


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


def _error(session: "Session") -> NDArray:
    errors = vertex_errors(session)
    if errors is None:
        return np.full((len(session.scene.vertices), 3), PLAIN, np.uint8)
    return map_colors(errors / error_scale(session))


MODES = {
    "relit": ColorMode("Relit", "under the light", _relit, True),
    "albedo": ColorMode("Albedo", "the surface colour, without light", _albedo),
    "normals": ColorMode("Normals", "red to the right, green up, blue to the front", _normals),
    "error": ColorMode(
        "Error", "difference of each vertex from converged light", _error, True, lambda s: error_scale(s)
    ),
}


def surface_colors(session: "Session") -> NDArray:
    """The colours of the surface in the present mode, (V, 3) uint8 sRGB: the captured ones before the first light."""
    mode, state, hand = MODES[session.state.mode], session.state, session.hand
    if hand is not None and state.by_hand:
        return hand.colors(lambda: session.scene.colors_srgb)
    if session.parts is not None and state.parts:
        return session.parts.tinted(mode.colors(session))
    if mode.lights:
        return mode.colors(session)
    return session.remembered("colors", (state.mode, state.albedo), lambda: mode.colors(session))


def vertex_errors(session: "Session") -> NDArray | None:
    """The error of the picture against the reference, (V,) float32: the difference over the reference's length and
    `DARKEST`, or None while there is no reference."""
    reference, shown = session.answers.reference, session.radiance()
    if reference is None or shown is None:
        return None
    return session.remembered(
        "errors", None, lambda: _relative(shown, _with_all_parts(session, reference.radiance)), reference, shown
    )


def error_scale(session: "Session") -> float:
    """The end of the error scale: 1, 2 or 5 times a power of ten that few of the present errors exceed, 1 at most."""
    errors = vertex_errors(session)
    if errors is None:
        return 1.0
    bright = session.remembered("scale", None, lambda: float(np.percentile(errors, 98.0)), errors)
    decade = 10.0 ** math.floor(math.log10(max(bright, 1e-3)))
    return min(next(step * decade for step in (1, 2, 5, 10) if bright <= step * decade), 1.0)


def map_colors(
    values: NDArray,  # (N,) 0..1, clipped
) -> NDArray:
    """Colours of the error scale, (N, 3) uint8: red, then green, then blue rise from a grey above the backdrop. They
    follow the square root: most errors are small."""
    place = 3.0 * np.sqrt(np.clip(values, 0.0, 1.0))[:, None]
    return bytes_from_unit(0.2 + 0.8 * np.clip(place - np.arange(3), 0.0, 1.0))


def _with_all_parts(session: "Session", radiance: NDArray) -> NDArray:
    """Radiance (V, 3) of an environment, all lamps, the captured light and objects."""
    found, mixture, inserted = session.beside_lamps(radiance), session.mixture, session.inserted
    found = found if mixture is None else mixture.with_environment(found)
    return found if inserted is None else found * inserted.ratio


def _relative(shown: NDArray, reference: NDArray) -> NDArray:
    length = np.linalg.norm(reference, axis=1)
    least = DARKEST * np.sqrt(np.mean(np.square(reference)) * 3.0)
    return np.linalg.norm(shown - reference, axis=1) / np.maximum(length + least, 1e-30)
