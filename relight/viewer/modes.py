"""The colours of the surface in each mode of the session."""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..sh.normals import unit_normals

if TYPE_CHECKING:
    from .session_view import SessionView

PLAIN = 96
"""Grey of a surface while its colours are computed."""

SCALES = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Ends of the error scale; the smallest above the 98th percentile applies."""

DARKEST = 0.01
"""Part of the root mean square of the reference that is added to the denominator of an error, which keeps the error of
black vertices small."""

_MAP = np.array(
    [(44, 47, 72), (66, 52, 112), (104, 54, 128), (148, 58, 116), (203, 79, 92), (240, 122, 62), (252, 185, 72),
     (250, 244, 180)],
    np.float32,
)  # fmt: skip
"""Colours of errors from zero to large, of increasing lightness; that of zero is lighter than the backdrop."""

_CHUNKS = np.array(
    [(108, 142, 191), (214, 152, 92), (122, 168, 116), (196, 110, 112), (148, 126, 178), (158, 134, 112),
     (208, 146, 184), (142, 150, 156), (190, 182, 96), (98, 176, 180)],
    np.float32,
)  # fmt: skip

_LAMP = np.array([0.35, 0.8, 0.48], np.float32)  # gives the flat colours of chunks their shape


class ColorMode(NamedTuple):
    """One way to colour. title: on screen. text: for the help. colors: of a Session, (V, 3) uint8.

    lights: whether it depends on the light. reference: whether it needs converged light at every vertex.
    scale: of a Session, the end of its scalar bar.
    """

    title: str
    text: str
    colors: Callable[["SessionView"], NDArray]
    lights: bool = False
    reference: bool = False
    scale: Callable[["SessionView"], float] | None = None


def _relit(session: "SessionView") -> NDArray:
    return session.shown_bytes()


def _albedo(session: "SessionView") -> NDArray:
    albedo = session.albedos[session.state.albedo]
    if albedo is None:
        return np.full((len(session.scene.vertices), 3), 255, np.uint8)
    return bytes_from_unit(srgb_from_linear(albedo))


def _normals(session: "SessionView") -> NDArray:
    return bytes_from_unit(0.5 + 0.5 * unit_normals(session.scene.normals))


def _chunks(session: "SessionView") -> NDArray:
    sizes = [len(chunk.vertices) for chunk in session.scene.chunks]
    color = _CHUNKS[np.repeat(np.arange(len(sizes)) % len(_CHUNKS), sizes)]
    return bytes_from_unit(color / 255.0 * (0.72 + 0.28 * (unit_normals(session.scene.normals) @ _LAMP))[:, None])


def _error(session: "SessionView") -> NDArray:
    errors = vertex_errors(session)
    if errors is None:
        return np.full((len(session.scene.vertices), 3), PLAIN, np.uint8)
    return map_colors(errors / error_scale(session))


MODES = {
    "relit": ColorMode("Relit", "under the light", _relit, True),
    "albedo": ColorMode("Albedo", "the surface colour, without light", _albedo),
    "normals": ColorMode("Normals", "red to the right, green up, blue to the front", _normals),
    "chunks": ColorMode("Chunks", "the parts of the mesh", _chunks),
    "error": ColorMode(
        "Error", "difference of each vertex from converged light", _error, True, True, lambda s: error_scale(s)
    ),
}


def vertex_errors(session: "SessionView") -> NDArray | None:
    """The error of the picture against the reference, (V,) float32: the difference over the reference's length and
    `DARKEST`, or None while there is no reference."""
    reference, shown = session.reference, session.radiance()
    if reference is None or shown is None:
        return None
    return session.remembered(
        "errors", None, lambda: _relative(shown, session.with_all_parts(reference.radiance)), reference, shown
    )


def error_scale(session: "SessionView") -> float:
    """The end of the error scale for the present errors, of `SCALES`."""
    errors = vertex_errors(session)
    if errors is None:
        return SCALES[-1]
    bright = session.remembered("scale", None, lambda: float(np.percentile(errors, 98.0)), errors)
    return next((end for end in SCALES if bright <= end), SCALES[-1])


def map_colors(
    values: NDArray,  # (N,) 0..1, clipped
) -> NDArray:
    """Colours of the error scale, (N, 3) uint8. They follow the square root: most errors are small."""
    place = np.sqrt(np.clip(values, 0.0, 1.0)) * (len(_MAP) - 1)
    below = np.minimum(place.astype(int), len(_MAP) - 2)
    share = (place - below)[:, None]
    return (_MAP[below] * (1.0 - share) + _MAP[below + 1] * share + 0.5).astype(np.uint8)


def _relative(shown: NDArray, reference: NDArray) -> NDArray:
    length = np.linalg.norm(reference, axis=1)
    least = DARKEST * np.sqrt(np.mean(np.square(reference)) * 3.0)
    return np.linalg.norm(shown - reference, axis=1) / np.maximum(length + least, 1e-30)
