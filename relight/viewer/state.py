"""The settings of a session: names, ranges, and the available lights."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..albedo.by_hand import RANGES as HAND_RANGES
from ..light import skies
from ..light.environment import Environment
from ..options import DEFAULT_TOLERANCE, LightingOptions
from ..transfer.settings import EFFECTS

RANGES = {
    "angle_deg": (0.0, 360.0),
    "exposure_ev": (-6.0, 6.0),
    "tolerance": (0.003, 0.10),
    "split_at": (0.0, 1.0),
    "lamps": (0.0, 10.0),
    "captured": (0.0, 1.0),
    "lamp_ev": (-4.0, 10.0),
    "part_reach": (0.01, 1.0),
    "part_exposure_ev": HAND_RANGES["brightness_ev"],
    "part_warmth": HAND_RANGES["warmth"],
    **{f"hand_{name}": limits for name, limits in HAND_RANGES.items()},
}
"""Ranges of the sliders. Angles wrap around, other values are clipped."""


MODES = {
    "relit": "Relit: under the light",
    "albedo": "Albedo: the surface colour, without light",
    "normals": "Normals: red to the right, green up, blue to the front",
}
"""What the surface shows: its name, and a title and a text for the help."""


@dataclass(frozen=True)
class State:
    """All settings of the user except the camera.

    environment, albedo, mode, method: names. angle_deg: of the light, in [0, 360). exposure_ev: stops over the
    session's own exposure. effects: those switched on. split: the captured colours show left of a line at `split_at`,
    0..1 over the width. sky: the light shows behind the scene. turning: the light turns by itself. mesh: the mesh
    shows where there is a splat. lamps: factor on the light of captured lamps. tool: what the mouse acts on. "lamps":
    clicks put them in. "objects": drags move them. "hand": the captured light is being set, and the surface shows its
    albedo. "parts": clicks make a part of the capture, which the surface shows. "": the view.
    """

    environment: str
    albedo: str
    mode: str = "relit"
    angle_deg: float = 0.0
    exposure_ev: float = 0.0
    tolerance: float = DEFAULT_TOLERANCE
    effects: frozenset = frozenset(EFFECTS)
    split: bool = False
    split_at: float = 0.5
    sky: bool = True
    help: bool = False
    panel: bool = True
    turning: bool = False
    mesh: bool = False
    lamps: float = 1.0
    tool: str = ""
    method: str = "auto"


def first_state(
    options: LightingOptions, environments: Mapping[str, Any], albedos: Mapping[str, NDArray | None]
) -> State:
    """The State that a session starts with. Raises InputError for a tolerance beyond those of sessions."""
    tolerance = options.accepted_error
    low, high = RANGES["tolerance"]
    if not low <= tolerance <= high:
        raise InputError(f"the `tolerance` of a session must be from {low:g} to {high:g}, found {tolerance:g}")
    first, albedo = next(iter(environments)), next(iter(albedos))
    angle = getattr(environments[first], "rotation_deg", 0.0)
    effects = frozenset(options.chosen_effects)
    return State(first, albedo, angle_deg=angle, tolerance=tolerance, effects=effects, method=options.method)


def methods_of(options: LightingOptions) -> list[str]:
    """The methods that a session can choose from, where neither a method nor effects are given."""
    free = options.method == "auto" and options.fixed_effects is None
    return ["auto", "neural-gash", "analytic"] if free else [options.method]


def check_field(name: str, value: Any, choices: Mapping[str, Sequence[str]]) -> Any:
    """The value that a field of the State takes when `value` is requested. choices: dict of field -> its names.

    Raises InputError for an unknown name and for a number that is not finite.
    """
    if name in choices and value not in choices[name]:
        raise InputError(f"{name} {value!r}: expected one of {', '.join(choices[name])}")
    if name not in RANGES:
        return frozenset(value) if name == "effects" else value
    low, high = RANGES[name]
    if not np.isfinite(value):
        raise InputError(f"{name} must be a finite number, found {value}")
    if name == "angle_deg":
        return float(value) % high
    value = float(min(max(value, low), high))
    return float(f"{value:.2g}") if name == "tolerance" else value  # each tolerance is a plan of its own


def choices_of(environment: Any, folder: str | os.PathLike[str] | None = None) -> dict[str, Any]:
    """The lights of a session: a dict of name -> Environment or path, the given one first.

    environment: an Environment, or an argument of `Environment.load`; a dict of them is the complete list. folder: its
    .exr and .hdr files follow; the built-in lights come last. Raises InputError for an environment that cannot be read
    and for a missing folder.
    """
    if isinstance(environment, Mapping):
        return dict(environment)
    if not isinstance(environment, Environment):
        environment = Environment.load(environment)
    choices = {environment.name: environment}
    if folder is not None:
        if not Path(folder).is_dir():
            raise InputError(f"{folder}: expected a folder of .exr and .hdr files; no such folder")
        files = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in (".exr", ".hdr"))
        if not files:
            raise InputError(f"{folder}: holds no .exr or .hdr file")
        for path in files:
            choices.setdefault(path.stem, path)
    for name in skies.BUILTIN:
        choices.setdefault(name, name)
    return choices
