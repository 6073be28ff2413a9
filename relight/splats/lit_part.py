"""A part of a capture in a light of its own, as a text names it: the part, then what its light is.

    part1 env=sunset rotate=90      the light of another environment, turned about the vertical
    statue.ply exposure=1           the light of the rest, a stop brighter
    box:at=0,1,0,size=2,1,2 tint=3000K

A dictionary has the same names, and the part as `part`. What a part keeps of them in the folder of its scene holds
where the text says nothing else.
"""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import clip, parse_spec, plain

from ..lamps.asked import WHITE, parse_color
from ..light.environment import Environment
from ..light.loading import light_of
from .kept_parts import kept_parts
from .part_spec import PartSpec
from .parts import AskedPart

FIELDS = "env", "rotate", "exposure", "tint"

MOST_EV = 10.0
"""Stops of the light of a part, brighter or darker: as far as lamps go in a session."""


@dataclass(frozen=True, eq=False)
class LitPart:
    """A part and its light. env: an Environment; None for the light of the rest. angle_deg: its turn about +y;
    None for that of the rest. exposure_ev: stops by which it is brighter. tint: linear, luminance 1."""

    part: AskedPart
    env: Environment | None = None
    angle_deg: float | None = None
    exposure_ev: float = 0.0
    tint: Triple = WHITE

    @classmethod
    def parse(cls, given: Any) -> "LitPart":
        """The part of a text or a dictionary, and its light, read. Raises InputError that names the field `parts`."""
        words = fields_of(given)
        part = words.pop("part")
        try:
            light = checked(words)
            if "env" in light:
                light["env"] = light_of(light["env"])
            return cls(AskedPart((PartSpec.parse(part),), "parts"), **light)
        except InputError as error:
            raise InputError(f"`parts` {clip(part)}: {plain(error)}") from None

    @property
    def words(self) -> str:
        """The part in words."""
        return self.part.specs[0].words

    @property
    def has_own(self) -> bool:
        """Whether its light is another one, not only brighter or tinted."""
        return self.env is not None or self.angle_deg is not None


def fields_of(given: Any) -> dict[str, Any]:
    """`part` and the FIELDS that a text or a dictionary names. Raises InputError without a part."""
    if isinstance(given, Mapping):
        fields = dict(given)
    else:
        try:
            head, words = parse_spec(os.fspath(given))
        except InputError as error:
            raise InputError(f"`parts` {clip(given)}: {plain(error)}") from None
        fields = {"part": head, **words}
    if fields.get("part") is None or (isinstance(fields["part"], str) and not fields["part"]):
        raise InputError(f"`parts` {clip(given)}: it begins with a part, as `only` has it")
    return fields


def checked(words: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a LitPart from FIELDS. Raises InputError for others, for none and for values that they cannot have."""
    unknown = next((name for name in words if name not in FIELDS), None)
    if unknown is not None or not words:
        other = clip(unknown) if words else "none"
        raise InputError(f"its light has {', '.join(FIELDS)}, each as name=value; found {other}")
    found: dict[str, Any] = {"env": words["env"]} if "env" in words else {}
    if "rotate" in words:
        found["angle_deg"] = _number("rotate", words["rotate"], math.inf) % 360.0
    if "exposure" in words:
        found["exposure_ev"] = _number("exposure", words["exposure"], MOST_EV)
    if "tint" in words:
        found["tint"] = parse_color(words["tint"])
    return found


def _number(name: str, value: Any, most: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and abs(number) <= most):
        limit = f" from -{most:g} to {most:g}" if math.isfinite(most) else ""
        raise InputError(f"{name} {clip(value)}: expected a number{limit}")
    return number


def with_kept_lights(given: Sequence[Any], folder: str | os.PathLike[str]) -> tuple[dict[str, Any], ...]:
    """Requested parts, of which names of parts of a scene folder are replaced by their masks and what they keep of
    their light."""
    known, found = kept_parts(folder), []
    for each in map(fields_of, given):
        name = each["part"]
        if isinstance(name, str) and name in known and not os.path.exists(name):
            kept = known[name]
            own = dict(kept.light)
            if isinstance(own.get("env"), str) and (Path(folder) / own["env"]).is_file():
                own["env"] = str(Path(folder) / own["env"])
            each = {**own, **each, "part": str(kept.file)}
        found.append(each)
    return tuple(found)
