"""Earlier results in the folder of a call: the same settings add to them, others need permission.

A report keeps the settings that its results depend on. Formats are not among them: a second call with another format
finds the same settings and adds its files.
"""

import hashlib
import json
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.outputs import check_output
from splat2mesh.base.strictjson import text_of
from splat2mesh.base.version import VERSION
from splat2mesh.scene.folder import sha256_of
from splat2mesh.scene.foreign import as_scene

from ..insert.asked import asked_inserts
from ..lamps.spec import asked_lamps, in_brief
from ..light.captured_light import light_file
from ..light.environment import Environment
from ..light.skies import BUILTIN
from ..splats.lit_part import fields_of

if TYPE_CHECKING:
    from ..request import AnyLight, RelightRequest

REPORT = "report.json"
"""In every folder of results; it distinguishes them from other folders."""

FIRST_LOOK = "first look"
"""State in the report of results that come before a scene is meshed, which the final ones replace."""

_SCENE = "scene.json"  # as of `splat2mesh.scene.folder`

_ARRAYS = "vertices", "normals", "faces", "colors_srgb"  # of a Scene: what light on it depends on


def settings_of(
    request: "RelightRequest", env: "AnyLight", angle_deg: float, lights: "Sequence[AnyLight]" = ()
) -> dict[str, Any]:
    """Return what the results of one light depend on, JSON-clean.

    Parameters
    ----------
    request : RelightRequest
    env : Environment, path or name
        One light of the request.
    angle_deg : float
        The angle at which the results show it, its own rotation included.
    lights : sequence
        All that a page holds.

    Notes
    -----
    Files count by their content, since a path says nothing about it. Settings that only some files depend on appear
    where these are requested, and are compared where both calls have them.
    """
    found: dict[str, Any] = {
        "version": VERSION,
        "scene": _described_scene(request.scene),
        "env": _described(env),
        "angle_deg": _reduced(angle_deg),
        "angles_deg": sorted({_reduced(angle) for angle in request.angles_deg}),  # which share plan and exposure
        "albedo": _described(request.albedo),
        "capture_env": _described(request.capture_env),
        "white_at": request.white_at,
        "exposure_ev": request.exposure_ev,
        "sky": request.sky,
        "only": _described(request.only),
        "keep": _described(request.keep),
        "shadow_of_parts": request.shadow_of_parts,
        "parts": [_described(_as_told(fields_of(each))) for each in request.parts],
    }
    lighting = request.lighting
    found.update({each.name: getattr(lighting, each.name) for each in fields(lighting)})
    found["captured_sky"] = _described(lighting.captured_sky)
    found["captured_light"] = _described_capture(request)
    found["placed"] = [{**_described(each), "name": in_brief(each.shape)} for each in asked_lamps(lighting.placed)]
    found["inserted"] = _described(asked_inserts(request.inserted))
    if not isinstance(found["effects"], str):
        found["effects"] = sorted(found["effects"])
    formats = set(request.formats or ())
    if request.baked:
        found["texture_size"] = request.texture_size
    if "albedo-splat" in formats:
        found["harmonics"] = request.harmonics
    if "passes" in formats:
        found["color_space"] = request.color_space
        found["cameras"] = None if request.cameras is None else os.fspath(request.cameras)
    if formats & {"live", "web"}:
        found["lights"] = [each for each in map(_described, lights) if each != found["env"]]
    return dict(json.loads(text_of(found)))  # as a reader of the report finds it


def _as_told(part: dict[str, Any]) -> dict[str, Any]:
    """The words of a lit part in one order, with numbers as a command tells them: those of a kept one are numbers."""
    words = {name: str(each) if isinstance(each, (int, float)) else each for name, each in sorted(part.items())}
    return {"part": words.pop("part"), **words}


def _described_capture(request: "RelightRequest") -> Any:
    """The known light of the capture, also where it was chosen in the folder of the scene; its file by its content."""
    choice, scene = request.lighting.captured_light, request.scene
    estimated = request.albedo is None or (isinstance(request.albedo, str) and request.albedo == "estimated")
    if request.capture_env is not None or not estimated or hasattr(choice, "radiance"):
        return _described(choice)
    found = light_file(choice, scene if isinstance(scene, (str, os.PathLike)) else getattr(scene, "path", None))
    return None if found is None else {**_described(found[0]), "name": found[1]}


def check_heeded(request: "RelightRequest", heeded: str, problem: str) -> None:
    """Raise InputError for fields of a request that are neither heeded, which are words of one line, nor as usual."""
    for each in fields(request):
        if each.name not in heeded.split() and getattr(request, each.name) != each.default:
            raise InputError(f"`{each.name}`: {problem}")


def is_results(folder: str | os.PathLike[str]) -> bool:
    """Whether a folder holds results."""
    return (Path(folder) / REPORT).is_file()


def is_first_look(folder: str | os.PathLike[str]) -> bool:
    """Whether a folder holds a first look, in place of final results."""
    return is_results(folder) and _read(Path(folder) / REPORT).get("state") == FIRST_LOOK


def check_results(
    folder: str | os.PathLike[str], overwrite: bool, settings: Callable[[], dict[str, Any]] | None = None
) -> None:
    """Refuse, before any work, a folder that must not be written; see `check_output`.

    settings: returns those of the results to write; without it, no results are added to a folder.
    Raises InputError for a folder that cannot be made or holds something else, and, unless it may be overwritten, for
    one with results of other settings; the message names what differs.
    """
    overwrite = overwrite or is_first_look(folder)
    adds = settings is not None and is_results(folder)
    check_output(folder, overwrite or adds, REPORT)
    if settings is not None and adds and not overwrite:
        Earlier(folder, settings())


class Earlier:
    """The results in a folder, if any; results of other settings are refused or overwritten.

    folder: need not exist. settings: of `settings_of`, of the results to write there.
    Raises InputError where the results are of other settings and may not be overwritten.
    """

    def __init__(self, folder: str | os.PathLike[str], settings: dict[str, Any], overwrite: bool = False) -> None:
        self._folder, self._settings = Path(folder), settings
        self._report = _read(self._folder / REPORT) if is_results(folder) else {}
        if self._report.get("state") == FIRST_LOOK:
            overwrite, self._report = True, {}
        known = self._report.get("settings")
        differing = _differences(known, settings) if isinstance(known, dict) else ["its report names none"]
        self._same = bool(self._report) and not differing
        if is_results(folder) and differing and not overwrite:
            problem = f"{folder} holds results of other settings ({'; '.join(differing)})"
            raise InputError(f"{problem}: choose another `output`, or replace them with `overwrite`")

    @property
    def kept(self) -> dict[str, Any]:
        """The report of earlier results of the same settings; empty without any."""
        return self._report if self._same else {}

    def joined(self, report: dict[str, Any]) -> dict[str, Any]:
        """Return a report of new results together with those that stay, its `files` those of both.

        Files of other settings stay too, but no report names them; a DataWarning does.
        """
        names = self._report.get("files")
        names = [name for name in names if isinstance(name, str)] if isinstance(names, list) else []
        left = [name for name in names if name not in report["files"] and (self._folder / name).is_file()]
        if self._same:
            joined = {**self._report, **report, "settings": {**self._report["settings"], **self._settings}}
            return {**joined, "files": left + list(report["files"])}
        if left:
            message = (
                f"{self._folder}: files of other settings stay there, and the report leaves them out ({len(left)})"
            )
            message = f"{message}: {' '.join(left)}"
            warnings.warn(message, DataWarning, stacklevel=3)
        return {**report, "settings": self._settings}


def _read(path: Path) -> dict[str, Any]:
    """The report in a file; None for any other content."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _differences(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """The differences of two settings, in words."""
    found = []
    for name in (name for name in before if name in now and before[name] != now[name]):
        first, second = _shown(before[name]), _shown(now[name])
        if name == "scene":
            found.append("the scene differs")
        elif first == second:
            found.append(f"`{name}` {first} had other content")
        else:
            found.append(f"`{name}` {first}, now {second}")
    return found


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return str(value.get("name"))
    if isinstance(value, list):
        return " ".join(map(_shown, value)) or "none"
    return f"{value:g}" if isinstance(value, float) else "not given" if value is None else str(value)


def _described(source: Any) -> Any:
    """Anything requested as JSON: what has content by its name and the digest of that, all else by its parts."""
    if source is None or isinstance(source, (bool, int, float)):
        return source
    if isinstance(source, np.ndarray):
        return {"name": "array", "sha256": _digest([source])}
    if isinstance(source, Environment):
        return {"name": source.name, "sha256": _digest([source.radiance])}
    if isinstance(source, Mapping):
        parts = {str(name): _described(each) for name, each in source.items()}
        return {"name": " ".join(_shown(each) for each in parts.values()), **parts}
    if isinstance(source, (list, tuple)):
        return [_described(each) for each in source]
    if is_dataclass(source):
        return {
            "name": getattr(source, "name", ""),
            **{each.name: _described(getattr(source, each.name)) for each in fields(source)},
        }
    if isinstance(source, (str, os.PathLike)) and (os.path.isfile(source) or (Path(source) / _SCENE).is_file()):
        return {"name": Path(source).name, **_described_scene(source)}
    name = str(source)
    return {"name": name.lower() if name.lower() in BUILTIN else name}  # of a sky in any case, of a part in its own


def _described_scene(scene: Any) -> Any:
    if isinstance(scene, (str, os.PathLike)):
        path = Path(scene)
        meta = path / _SCENE
        if meta.is_file():
            return {"sha256": _read(meta).get("sha256") or sha256_of(meta)}
        return {"sha256": sha256_of(path)} if path.is_file() else {}
    scene = as_scene(scene)
    return {"sha256": _digest(np.asarray(getattr(scene, name)) for name in _ARRAYS)}


def _digest(arrays: Iterable[np.ndarray[Any, Any]]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode() + np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _reduced(angle_deg: float) -> float:
    return round(float(angle_deg) % 360.0, 6) % 360.0
