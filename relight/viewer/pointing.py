"""What the tools under the mouse share: the surface at a pixel, and a change that may be refused."""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

if TYPE_CHECKING:
    from .sources import HandSource, LampSource, PartSource
    from .window_view import WindowView


def surface_at(
    window: "WindowView", source: "LampSource | HandSource | PartSource", x: float, y: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """The surface point at a pixel, from the lower left, and its unit normal towards the eye; None without one."""
    eye, direction = window.orbit.ray(x, y, window.size)
    hits = source.first_hits(np.concatenate([eye, direction])[None].astype(np.float32))
    distance = float(hits.distance[0])
    if not math.isfinite(distance):
        return None
    normal = hits.normals[0].astype(np.float64)
    return eye + distance * direction, normal if normal @ direction < 0.0 else -normal


def tried(window: "WindowView", change: Callable[[], object]) -> None:
    """Make a change; show a message if it is refused."""
    try:
        change()
    except (OSError, InputError) as error:
        window.note = str(error)
