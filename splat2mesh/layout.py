"""A scene of several splats: a JSON layout gives the pose of each.

{"objects": [{"splat": "guitar.ply", "position": [1, 0, 0], "rotation_deg": 30, "scale": 0.5}, ...]}

Each object is turned y-up as if it were alone, then scaled, turned and moved, in the scene frame.
"""

import json
import math
import os
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from .base.arrays import Matrix3, Matrix4
from .base.choices import DEFAULT_VERTICES
from .base.errors import DataWarning, InputError
from .base.gltf import MOST_NODES
from .base.inputs import read_json, reading
from .base.progress import Stages
from .options import LEAST_VERTICES, ConvertOptions
from .pipeline import converted, planned
from .proxy import add_proxy, check_proxy
from .scene.mesh import Mesh
from .scene.scene import Scene
from .scene.sources import describe
from .splats.formats.parts import METAS
from .splats.placing import placed_mesh, similarity
from .views.upright import UP_CHOICES

_KEYS = ("splat", "name", "position", "rotation_deg", "quat_wxyz", "scale", "up", "vertices", "cameras", "lod")
_OWN_SETTINGS = ("vertices", "up", "cameras", "lod", "up_from")
LARGEST = 1e6
"""Largest positions and scales: float32 vertices that far out are still exact to a tenth of a unit."""


@dataclass(frozen=True, eq=False)
class Placement:
    """One object of a layout.

    name: its own within the layout. splat, cameras: absolute paths; no cameras: None.
    scene_from_upright: (4, 4) float64 similarity, from the frame of the object's own scene to that of the layout.
    up, vertices: as for `convert`, or None for what all objects get. lod: as for `read_splats`.
    """

    name: str
    splat: Path
    scene_from_upright: Matrix4
    up: str | None
    vertices: int | None
    cameras: Path | None
    lod: int | str


def is_layout(path: str | os.PathLike[str]) -> bool:
    """Whether a path is meant as a layout: a .json file that does not describe a SOG."""
    path = Path(path)
    if path.suffix.lower() != ".json" or path.name in METAS or not path.is_file():
        return False
    try:
        content = read_json(path)
    except InputError:
        return True
    return not (isinstance(content, dict) and ("means" in content or "lodLevels" in content))


def converted_layout(path: str | os.PathLike[str], shared: ConvertOptions, stages: Stages) -> Scene:
    """Make one scene, not yet saved, of the splats that a layout places: each is converted as if alone, then placed.

    path: JSON file. shared: for each object that does not give its own; `cameras` and `lod` are refused here, objects
    have theirs. Returns Scene: its chunks are those of object after object, its `scene_from_splat` is the identity, and
    `source["objects"]` says what stands where. Raises InputError for a layout, or a splat in it, that cannot be used.
    """
    check_proxy(shared.proxy)
    if isinstance(shared.texture, int):
        raise InputError(f"`texture` {shared.texture}: a layout of several splats gets no texture; leave it out")
    placements = _placements(path, shared)
    # All are checked before the first takes minutes.
    each_asked = [_own_options(placement, shared) for placement in placements]
    made: dict[tuple[Path, ConvertOptions], Scene] = {}
    chunks: list[Mesh] = []
    hull: list[int] = []
    cards: list[Mesh] = []
    objects: list[dict[str, Any]] = []
    object_settings: dict[str, dict[str, Any]] = {}
    statistics: Counter[str] = Counter()
    for placement, asked in zip(placements, each_asked, strict=True):
        key = (placement.splat, asked)
        if key not in made:  # the same splat may stand in several places
            with _about(placement.name):
                scene = converted(placement.splat, asked, stages)
            made[key] = scene
        alone = made[key]
        first = len(chunks)
        hull += [first + number for number in alone.hull]
        cards += [placed_mesh(mesh, placement.scene_from_upright) for mesh in alone.cards]
        chunks += [placed_mesh(chunk, placement.scene_from_upright) for chunk in alone.chunks]
        matrix = placement.scene_from_upright @ alone.scene_from_splat
        place = {"scene_from_splat": matrix.tolist(), "chunks": [first, len(chunks)]}
        objects.append({"name": placement.name, **alone.source, **place})
        object_settings[placement.name] = {name: alone.settings[name] for name in _OWN_SETTINGS}
        statistics.update(alone.statistics)
    common = {name: value for name, value in alone.settings.items() if name not in object_settings[placement.name]}
    scene = Scene(
        chunks,
        source={**describe(path), "objects": objects},
        settings={**common, "objects": object_settings},
        statistics=dict(statistics),
        hull=tuple(hull),
        cards=cards,
    )
    if shared.proxy:
        with stages.stage("proxy"):
            add_proxy(scene, shared.proxy, shared.seed)
    return scene


def planned_layout(path: str | os.PathLike[str], shared: ConvertOptions) -> dict[str, Any]:
    """Return what `converted_layout` would do: the number of splats, and each object's own plan by its name."""
    plans = {}
    for placement in _placements(path, shared):
        with _about(placement.name):
            result = planned(placement.splat, _own_options(placement, shared, plan=True))
        result["scene_from_splat"] = (placement.scene_from_upright @ np.array(result["scene_from_splat"])).tolist()
        plans[placement.name] = {"splat": str(placement.splat), **result}
    return {"splats": sum(result["splats"] for result in plans.values()), "objects": plans}


def read_layout(path: str | os.PathLike[str]) -> list[Placement]:
    """Return the objects of a layout file, at least one.

    Paths in it are relative to the file. Keys of an object, all but the first optional: `splat`, its file; `name`,
    by default that of the file; `scale`, a factor; `rotation_deg`, an angle about +y, counter-clockwise from above,
    or `quat_wxyz`, any rotation, of any length; `position`, where its own origin comes to stand; `up`, `vertices`,
    `cameras` and `lod` as on the command line. Raises InputError for anything else.
    """
    path = Path(path)
    content = read_json(path, object_pairs_hook=lambda pairs: _once(path, pairs))
    entries = content.get("objects") if isinstance(content, dict) else None
    if not isinstance(entries, list) or not entries:
        raise InputError(
            f'{path} is not a layout: expected {{"objects": [{{"splat": FILE, "position": [x, y, z]}}, ...]}}'
        )
    unknown = [key for key in content if key != "objects"]
    if unknown:
        raise InputError(f"{path}: unknown key '{unknown[0]}' beside 'objects'")
    if len(entries) > MOST_NODES:
        raise InputError(f"{path}: places {len(entries)} objects, expected at most {MOST_NODES}")
    placements: dict[str, Placement] = {}
    with reading(path):
        for number, entry in enumerate(entries, 1):
            found = _placement(path, f"{path}: object {number}", entry, placements.keys())
            placements[found.name] = found
    return list(placements.values())


def _placements(path: str | os.PathLike[str], shared: ConvertOptions) -> list[Placement]:
    if shared.cameras:
        raise InputError(f'`cameras` {shared.cameras}: in a layout, give each object its own: "cameras": PATH')
    if shared.lod != "auto":
        raise InputError(f'`lod` {shared.lod}: in a layout, give each object its own: "lod": N')
    return read_layout(path)


_PLAIN: dict[str, tuple[Callable[[Any], bool], str]] = {
    "up": (lambda value: value in UP_CHOICES, f"one of {' '.join(UP_CHOICES)}"),
    "vertices": (lambda value: type(value) is int and value >= LEAST_VERTICES, "a whole number of at least 4"),
    "lod": (lambda value: value == "auto" or (type(value) is int and value >= 0), '"auto" or the number of a level'),
    "name": (lambda value: isinstance(value, str) and value != "", "a text"),
}
"""What values of an entry have to be, and how messages say it."""


def _placement(path: Path, where: str, entry: Any, taken: Collection[str]) -> Placement:
    if not isinstance(entry, dict):
        raise InputError(f'{where}: expected {{"splat": FILE, ...}}, found {json.dumps(entry)}')
    unknown = [key for key in entry if key not in _KEYS]
    if unknown:
        raise InputError(f"{where}: unknown key '{unknown[0]}': expected {' '.join(_KEYS)}")
    splat = _file(path, where, entry, "splat")
    if splat is None:
        raise InputError(f"{where}: lacks 'splat', the name of its file")
    for key, (fits, expected) in _PLAIN.items():
        if key in entry and not fits(entry[key]):
            raise InputError(f"{where}: {key} must be {expected}, found {json.dumps(entry[key])}")
    name = entry.get("name", _stem(splat))
    if name in taken and "name" in entry:
        raise InputError(f"{where}: another object is called '{name}' already")
    return Placement(
        name if name not in taken else _numbered(name, taken),
        splat,
        _pose(where, entry),
        entry.get("up"),
        entry.get("vertices"),
        _file(path, where, entry, "cameras"),
        entry.get("lod", "auto"),
    )


def _pose(where: str, entry: dict[str, Any]) -> Matrix4:
    """From the frame of an object's own scene to that of the layout."""
    if "rotation_deg" in entry and "quat_wxyz" in entry:
        raise InputError(f"{where}: give rotation_deg or quat_wxyz, not both")
    (scale,) = _numbers(where, "scale", [entry.get("scale", 1.0)], 1)
    if not 1 / LARGEST <= scale <= LARGEST:
        raise InputError(f"{where}: scale must be a positive factor, {1 / LARGEST:g} to {LARGEST:g}, found {scale:g}")
    position = _numbers(where, "position", entry.get("position", [0, 0, 0]), 3)
    if max(map(abs, position)) > LARGEST:
        raise InputError(f"{where}: position must be within +-{LARGEST:g}, found {position}")
    return similarity(scale, _rotation(where, entry), position)


def _rotation(where: str, entry: dict[str, Any]) -> Matrix3:
    if "quat_wxyz" in entry:
        quat = np.array(_numbers(where, "quat_wxyz", entry["quat_wxyz"], 4))
        if np.abs(quat).max() == 0:
            raise InputError(f"{where}: quat_wxyz must not be all zero")
        return scipy.spatial.transform.Rotation.from_quat((quat / np.abs(quat).max())[[1, 2, 3, 0]]).as_matrix()
    (angle,) = _numbers(where, "rotation_deg", [entry.get("rotation_deg", 0.0)], 1)
    quarters, rest = divmod(angle % 360, 90)  # quarter turns come out exactly
    cosine, sine = math.cos(math.radians(rest)), math.sin(math.radians(rest))
    for _ in range(int(quarters)):
        cosine, sine = -sine, cosine
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def _numbers(where: str, key: str, values: Any, count: int) -> list[float]:
    """`count` finite floats, or InputError."""
    plain = isinstance(values, list) and len(values) == count
    if not plain or not all(type(value) in (int, float) and abs(value) <= sys.float_info.max for value in values):
        expected = "a finite number" if key in ("scale", "rotation_deg") else f"[{count} finite numbers]"
        found = values[0] if expected == "a finite number" else values
        raise InputError(f"{where}: {key} must be {expected}, found {json.dumps(found)}")
    return [float(value) for value in values]


def _file(path: Path, where: str, entry: dict[str, Any], key: str) -> Path | None:
    """The absolute path of an entry's file or folder, or None."""
    name = entry.get(key)
    if name is None:
        return None
    if not isinstance(name, str) or not name:
        raise InputError(f"{where}: {key} must be the name of a file, found {json.dumps(name)}")
    found = Path(path).absolute().parent / Path(name).expanduser()
    if not found.exists():
        raise InputError(f"{where}: {found} does not exist: paths are relative to the layout")
    return found


def _stem(splat: Path) -> str:
    splat = splat.parent if splat.name in METAS else splat
    return splat.name.split(".")[0] or splat.name


def _numbered(name: str, taken: Collection[str]) -> str:
    number = 2
    while f"{name}-{number}" in taken:
        number += 1
    return f"{name}-{number}"


def _once(path: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    twice = [key for key, count in Counter(key for key, _ in pairs).items() if count > 1]
    if twice:
        raise InputError(f"{path}: key '{twice[0]}' appears twice in one object")
    return dict(pairs)


def _own_options(placement: Placement, shared: ConvertOptions, plan: bool = False) -> ConvertOptions:
    """The ConvertOptions of one object; the proxy is of the whole layout."""
    vertices = DEFAULT_VERTICES if shared.vertices is None else shared.vertices
    return replace(
        shared,
        vertices=shared.vertices if plan else placement.vertices or vertices,
        up=placement.up or shared.up,
        cameras=placement.cameras,
        lod=placement.lod,
        proxy=None,
        texture="none",
    )


@contextmanager
def _about(name: str) -> Iterator[None]:
    """Within it, errors and DataWarnings say which object they are about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", DataWarning)
        try:
            yield
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    for warning in caught:
        warnings.warn(f"{name}: {warning.message}", DataWarning, stacklevel=3)
