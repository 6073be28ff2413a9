"""The likeliest lights of a capture in the folder of its scene, and the one that a person chose.

`captured_light.json`: {"schema_version": 1, "chosen": null or an entry, "candidates": [entry, ...]}, the likeliest
first. An entry has the fields of `LikelyLight`. The environments lie beside it.
"""

import hashlib
import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from splat2mesh.base.arrayfiles import load_arrays
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import GIB, inside, read_json, reading
from splat2mesh.base.outputs import staged_file

from . import ANEW

if TYPE_CHECKING:
    from .environment import Environment

NAME = "captured_light.json"
"""In the folder of a scene."""

SCHEMA_VERSION = 1

_ENVIRONMENTS = "captured_light-{}.npz"  # by a digest of the content, so that a chosen light keeps its file

_PACKED = ".npz"


@dataclass(frozen=True)
class LikelySun:
    """The sun of a likely light.

    azimuth_deg: from -z of the scene frame, clockwise seen from above (-z is north, unless turned). height_deg: above
    the horizon. irradiance: RGB on a surface that faces it, unit of the captured colours.
    """

    azimuth_deg: float
    height_deg: float
    irradiance: tuple[float, float, float]


@dataclass(frozen=True)
class LikelyLight:
    """A light that may have lit a capture.

    name: for people. share: its posterior probability, in [0, 1]. sun: LikelySun, or None without one. environment:
    name of the file of the whole light, sun included, relative to the folder: `.npz` of `offer`, `.exr` or `.hdr`.
    brightness, tint (RGB), sun_strength, sky_to_sun: factors by which that file differs from the estimate; 1 as
    estimated. by_hand: whether a person set it, so that its brightness and colour are taken as they are.
    """

    name: str
    share: float
    sun: LikelySun | None
    environment: str
    brightness: float = 1.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    sun_strength: float = 1.0
    sky_to_sun: float = 1.0
    by_hand: bool = False


class LightFile(NamedTuple):
    """A file of light, its name for people, and whether a person set it."""

    path: Path
    name: str
    by_hand: bool = False


@dataclass(frozen=True)
class CapturedLights:
    """candidates: LikelyLights, the likeliest first. chosen: the one that is used from now on, or None."""

    candidates: tuple[LikelyLight, ...] = ()
    chosen: LikelyLight | None = None

    @property
    def listed(self) -> list[LikelyLight]:
        """All of them."""
        return [*self.candidates, *([self.chosen] if self.chosen else [])]


def read_lights(path: str | os.PathLike[str]) -> CapturedLights:
    """Read a `captured_light.json`. Raises InputError for what is missing, damaged or of a newer version."""
    content = read_json(path)
    if not isinstance(content, dict) or not isinstance(content.get("candidates"), list):
        raise InputError(f'{path}: expected {{"schema_version": 1, "chosen": ..., "candidates": [...]}}')
    version = content.get("schema_version")
    if version != SCHEMA_VERSION:
        raise InputError(f"{path}: schema version {version}, expected {SCHEMA_VERSION}; update the tool")
    candidates = [_entry(each, f"{path}: candidate {k}") for k, each in enumerate(content["candidates"], 1)]
    chosen = content.get("chosen")
    return CapturedLights(tuple(candidates), None if chosen is None else _entry(chosen, f"{path}: chosen"))


def write_lights(folder: str | os.PathLike[str], lights: CapturedLights) -> Path:
    """Write `captured_light.json` into a folder, under a temporary name first; returns its path.

    Environments of `offer` that nothing refers to any more are removed.

    Raises InputError for entries that cannot be read back, whose environment is not there, and for a folder that cannot
    be written.
    """
    path = Path(folder) / NAME
    for each in lights.listed:
        _entry(asdict(each), f"{path}: {each.name}")
        if not inside(folder, each.environment, path).is_file():
            raise InputError(f"{path}: {each.name}: no file {each.environment} beside it")
    chosen = None if lights.chosen is None else _written(lights.chosen)
    content = {"schema_version": SCHEMA_VERSION, "chosen": chosen, "candidates": list(map(_written, lights.candidates))}
    try:
        with staged_file(path) as partial:
            partial.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from None
    kept = {each.environment for each in lights.listed}
    for file in Path(folder).glob(_ENVIRONMENTS.format("*")):
        if file.name not in kept:
            file.unlink(missing_ok=True)
    return path


def offer(folder: str | os.PathLike[str], lights: Sequence[tuple[LikelyLight, "Environment"]]) -> CapturedLights:
    """Write the likeliest lights with their environments into a scene folder. A choice made before stays.

    The entries get the names of the files written. Raises InputError for a folder that cannot be written.
    """
    found = CapturedLights(tuple(_with_file(folder, *each) for each in lights), _lights_of(folder).chosen)
    write_lights(folder, found)
    return found


def choose_new(folder: str | os.PathLike[str], entry: LikelyLight, environment: "Environment") -> LikelyLight:
    """Write a light with its environment into a scene folder, as the one that commands use from now on; returns its
    entry, with the name of the file.

    The candidates stay; one chosen before goes. Raises InputError for a damaged file, and for a folder that cannot be
    written.
    """
    chosen = _with_file(folder, entry, environment)
    found = replace(_lights_of(folder), chosen=chosen)
    write_lights(folder, found)
    return chosen


def _lights_of(folder: str | os.PathLike[str]) -> CapturedLights:
    """The lights of a scene folder; none where there is no file."""
    path = Path(folder) / NAME
    return read_lights(path) if path.exists() else CapturedLights()


def _with_file(folder: str | os.PathLike[str], entry: LikelyLight, environment: "Environment") -> LikelyLight:
    """The entry with the name of the file of its environment, which is written unless it is there."""
    import numpy as np

    turn = np.float64(environment.rotation_deg)
    digest = hashlib.sha256(environment.radiance.tobytes() + turn.tobytes()).hexdigest()[:16]
    file = Path(folder) / _ENVIRONMENTS.format(digest)
    if not file.exists():
        try:
            with staged_file(file) as partial:
                np.savez_compressed(partial, radiance=environment.radiance, rotation_deg=turn)
        except OSError as error:
            raise InputError(f"cannot write {file}: {error.strerror or error}") from None
    return replace(entry, environment=file.name)


def known_light(choice: Any, folder: str | os.PathLike[str] | None) -> "Environment | None":
    """Return the captured light that a request names, or else the one chosen in the folder of its scene; None where it
    is to be estimated.

    choice: None takes the chosen light; "auto" ignores it; a number is that of a candidate, from 1; a path is a
    `captured_light.json`, whose chosen or else likeliest light counts, or an environment; an Environment is itself.
    Raises InputError for a number that no candidate has, and for what is missing or damaged.
    """
    if hasattr(choice, "radiance"):
        return choice
    found = light_file(choice, folder)
    if found is None:
        return None
    environment = read_environment(found.path, found.name)
    environment.exposed = found.by_hand
    return environment


def light_file(choice: Any, folder: str | os.PathLike[str] | None) -> LightFile | None:
    """Return the file of the environment that `known_light` reads; None without one."""
    if choice == ANEW:
        return None
    if choice is None or isinstance(choice, int):
        return _numbered(choice, folder)
    path = Path(choice)
    if not os.path.lexists(path):
        raise InputError(f"`captured_light` {path}: no such file; expected {NAME}, an environment, a number, or {ANEW}")
    if path.suffix.lower() != ".json":
        return LightFile(path, path.stem)
    lights = read_lights(path)
    entry = lights.chosen or next(iter(lights.candidates), None)
    if entry is None:
        raise InputError(f"`captured_light` {path}: it holds no light")
    return _file_of(entry, path)


def _numbered(number: int | None, folder: str | os.PathLike[str] | None) -> LightFile | None:
    """The file of a candidate in a folder, counted from 1; without a number that of the chosen light, or None."""
    path = Path(folder or "") / NAME
    if folder is None or not path.exists():
        if number is None:
            return None
        where = f"{folder or 'a scene in memory'} holds no {NAME}"
        raise InputError(f"`captured_light` {number}: {where}, which an estimate of its light writes")
    try:
        lights = read_lights(path)
    except InputError as error:
        raise InputError(f"{error}; or ignore it with `captured_light` {ANEW}") from None
    if number is not None and number > len(lights.candidates):
        raise InputError(f"`captured_light` {number}: {path} holds {len(lights.candidates)} candidates")
    entry = lights.chosen if number is None else lights.candidates[number - 1]
    return None if entry is None else _file_of(entry, path)


def _file_of(entry: LikelyLight, path: Path) -> LightFile:
    """The file of an entry of the JSON at a path."""
    return LightFile(inside(path.parent, entry.environment, path), entry.name, entry.by_hand)


def read_environment(path: str | os.PathLike[str], name: str) -> "Environment":
    """Read an environment: an `.npz` of `offer`, or what `Environment.load` reads. Raises InputError."""
    import numpy as np

    from .environment import Environment

    if Path(path).suffix.lower() != _PACKED:
        found = Environment.load(path)
        return Environment(found.radiance, name, found.rotation_deg)
    with reading(path):
        arrays = load_arrays(path, GIB, ("radiance", "rotation_deg"))
        if arrays["radiance"].dtype.kind != "f" or np.size(arrays["rotation_deg"]) != 1:
            raise ValueError("expected a float image and an angle")
        return Environment(arrays["radiance"], name, float(arrays["rotation_deg"]))


def _entry(content: Any, where: str) -> LikelyLight:
    """A LikelyLight of JSON. Raises InputError, which begins with `where`."""
    if not isinstance(content, dict):
        raise InputError(f"{where}: expected an object, found {str(content)[:40]}")
    name, sun = content.get("name"), content.get("sun")
    if not isinstance(name, str) or not name.strip():
        raise InputError(f"{where}: name: expected a text")
    inside("", content.get("environment"), where)
    share = _number(content.get("share"), f"{where}: share", 1.0)
    scales = "brightness", "sun_strength", "sky_to_sun"
    factors = {each: _number(content.get(each, 1.0), f"{where}: {each}") for each in scales}
    tint = _color(content.get("tint", [1.0, 1.0, 1.0]), f"{where}: tint")
    if sun is not None:
        if not isinstance(sun, dict):
            raise InputError(f"{where}: sun: expected null or an object")
        azimuth = _number(sun.get("azimuth_deg"), f"{where}: sun: azimuth_deg", signed=True)
        height = _number(sun.get("height_deg"), f"{where}: sun: height_deg", 90.0)
        sun = LikelySun(azimuth, height, _color(sun.get("irradiance"), f"{where}: sun: irradiance"))
    by_hand = content.get("by_hand", False)
    if not isinstance(by_hand, bool):
        raise InputError(f"{where}: by_hand: expected true or false, found {str(by_hand)[:40]}")
    return LikelyLight(name, share, sun, content["environment"], tint=tint, by_hand=by_hand, **factors)


def _written(entry: LikelyLight) -> dict[str, Any]:
    """An entry as JSON: an estimated one has no `by_hand`."""
    found = asdict(entry)
    return found if entry.by_hand else {name: value for name, value in found.items() if name != "by_hand"}


def _number(value: Any, where: str, most: float = math.inf, signed: bool = False) -> float:
    plain = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if not plain or not (signed or value >= 0.0) or value > most:
        limits = "" if signed else " from 0" + (f" to {most:g}" if most < math.inf else " up")
        raise InputError(f"{where}: expected a number{limits}, found {str(value)[:40]}")
    return float(value)


def _color(value: Any, where: str) -> tuple[float, float, float]:
    if not isinstance(value, (list, tuple)) or len(value) != 3:
        raise InputError(f"{where}: expected three numbers, found {str(value)[:40]}")
    red, green, blue = (_number(each, where) for each in value)
    return red, green, blue
