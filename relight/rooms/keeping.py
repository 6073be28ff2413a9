"""A Room as arrays for a cache, beside those of an estimate of the capture's light, and back."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance

from ..albedo import Prior
from ..light.environment import Environment
from .room import Room

ARRAYS = "by_lamps", "glow", "lamp_light", "lamp_of"


def as_arrays(room: Room, reason: str) -> dict[str, NDArray[Any]]:
    """A Room as arrays; those that estimates of open scenes have too keep their names.

    reason: why its light is not known, for the report and the warning.
    """
    coefficients = room.environment.sh(2)
    mean = coefficients[0] / math.sqrt(4.0 * math.pi)
    bright = max(float(luminance(mean)), 1e-12)
    y, z, x = luminance(coefficients[1:4]) * math.sqrt(4.0 * math.pi / 3.0) / (4.0 * math.pi)
    length = float(np.linalg.norm([x, y, z]))
    direction = np.array([x, y, z]) / length if length > 1e-6 * bright else np.array([0.0, 1.0, 0.0])
    emitters = [*room.report["lamps"], *([room.report["windows"]] if room.report["windows"] else [])]
    kept: dict[str, Any] = {
        "albedo": room.albedo,
        "irradiance": room.irradiance,
        "separable": True,
        "reason": reason,
        "evidence": max(each["evidence"] for each in emitters),
        "direction": direction,
        "concentration": min(length / bright, 1.0),
        "color": mean / bright if bright > 1e-12 else np.ones(3),
        "brightness": room.brightness,
        "self_relight_db": room.report["self_relight_db"],
        "trust": room.trust,
        "under_sky": False,
        "closed": True,
        "room_environment": room.environment.radiance,
        "light_turn": room.environment.rotation_deg,
        "room_told": json.dumps(room.report),
    }
    kept |= {f"room_{name}": getattr(room, name) for name in ARRAYS}
    kept |= {f"prior_{name}": value for name, value in room.prior._asdict().items()}
    return {name: np.asarray(value) for name, value in kept.items()}


def room_from(kept: Mapping[str, NDArray[Any]]) -> Room | None:
    """The Room that `as_arrays` described; None for arrays that describe no room."""
    if "room_told" not in kept:
        return None
    report = json.loads(str(kept["room_told"]))
    prior = Prior(*(kept[f"prior_{name}"] for name in Prior._fields))
    environment = Environment(kept["room_environment"], "windows", float(kept.get("light_turn", 0.0)))
    arrays = {name: kept[f"room_{name}"] for name in ARRAYS}
    brightness = float(kept["brightness"])
    return Room(
        kept["albedo"],
        kept["irradiance"],
        **arrays,
        environment=environment,
        brightness=brightness,
        prior=prior,
        trust=kept["trust"],
        report=report,
    )
