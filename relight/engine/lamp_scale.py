"""The length of a metre in a scene and the brightness of its captured light: units for lamps."""

import numpy as np

from splat2mesh.scene.color import luminance
from splat2mesh.scene.scene import Scene

from ..lamps.asked import LampScale
from ..transfer.occluder import Occluder
from .appearance import Appearance

EYE_M = 1.25
"""Height of cameras above the floor or table below them: two trained places whose unit is a metre have 1.04
and 1.52 in the median."""

OBJECT_M = 1.0
"""Assumed diagonal of an object, whose size is unknown."""


ROOM_LUX, OUTDOOR_LUX = 200.0, 10_000.0
"""Assumed illuminance of the median light of a capture, for lamps in lumens or candela: a lit or daylit
room has 100 to 500 lx, an overcast day 5,000 to 20,000. A photograph does not show it."""


def lamp_scale(scene: Scene, look: Appearance, occluder: Occluder, metre: float | None = None) -> LampScale:
    """Return the LampScale of a scene: splat units per metre, the median irradiance of the capture, and what a candela
    is beside it.

    The height of the capture above the floor determines a metre. Without one it is `metre`, in splat units; without
    that either, the scene counts as an object, whose size is unknown.
    """
    light = luminance(look.irradiance)
    inside = bool(look.capture and "room" in look.capture)
    lit = light[light > 0.0]
    irradiance = np.pi * float(np.median(lit)) if len(lit) else np.pi
    motion = np.asarray(scene.scene_from_splat, np.float64)[:3, :3]
    scale = float(np.cbrt(abs(np.linalg.det(motion)))) or 1.0  # scene units per splat unit
    height = _eye_height(scene, occluder)
    if height is not None:
        metre = height / EYE_M / scale
    elif metre is None:
        metre = scene.diagonal / OBJECT_M / scale
    return LampScale(metre, irradiance, irradiance / (ROOM_LUX if inside else OUTDOOR_LUX))


def _eye_height(scene: Scene, occluder: Occluder) -> float | None:
    """Median height of the capture's standpoints above the surface below, scene units; None without standpoints."""
    eyes = np.asarray(scene.capture.get("eyes", ()), np.float64).reshape(-1, 3)
    if not len(eyes):
        return None
    frame = occluder.frame
    down = np.broadcast_to(np.array([0.0, -1.0, 0.0]), eyes.shape)
    hits = occluder.first_hits(np.hstack([frame.unit(eyes), down]).astype(np.float32))
    below = hits.distance[np.isfinite(hits.distance)]
    return float(np.median(below)) * frame.diagonal if len(below) else None
