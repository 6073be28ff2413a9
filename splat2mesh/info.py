"""What a file is and what would become of it, in seconds: splats, cameras, lights, layouts, meshes, scenes."""

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .base.errors import DataWarning, InputError
from .base.inputs import check_special, file_size, reading
from .capture import is_place, standing_of
from .layout import is_layout, read_layout
from .options import ConvertOptions
from .render.view import View
from .scene.folder import META
from .splats.cleaning import usable
from .splats.formats import parts_of, read_splats
from .splats.formats.folders import FramesError
from .splats.formats.register import BY_KIND, kind_of_file, looks_like_splat
from .splats.splats import MIN_SPLATS, Splats
from .surface.background import far_background
from .views.cameras import KINDS as CAMERA_KINDS
from .views.cameras import read_cameras
from .views.colmap import is_colmap
from .views.located import located_views
from .views.upright import upright

LOOKED_AT = 200_000
"""Splats from which up and the kind of the capture are found; of more an even share, widened to cover as much."""

HOLDS = {"outside": "an object", "inside": "a room", "both": "a place in the open"}

_REASONS = {
    "non_finite": "a NaN or infinite value",
    "absurd": "a position or scale out of any useful range",
    "zero_quaternion": "a zero quaternion",
    "invisible": "an opacity below 1/255",
}
_LIGHTS = ".exr", ".hdr", ".pic"
_MESHES = ".obj", ".stl", ".off", ".glb", ".gltf", ".ply"
_HEADER_BYTES = 1 << 20


def info_of(path: str | os.PathLike[str], options: ConvertOptions | None = None) -> dict[str, Any]:
    """Describe a file or folder of any kind that the commands read.

    options: `lod`, `cameras` and `up` count. It is JSON-clean. `what` is splats, cameras, light, layout, mesh or
    scene; `warnings` are those of reading. Raises InputError for what is missing, broken, or of no known kind.
    """
    path, asked = Path(path), options or ConvertOptions()
    if not os.path.lexists(path):
        raise InputError(f"{path}: no such file")
    check_special(path)
    with reading(path), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = _describer(path)(path, asked)
    said = [str(each.message) for each in caught if issubclass(each.category, DataWarning)]
    return {"path": os.fspath(path), **found, "warnings": list(dict.fromkeys(said))}


def _describer(path: Path) -> Callable[[Path, ConvertOptions], dict[str, Any]]:
    suffix = path.suffix.lower()
    if path.is_dir():
        if (path / META).is_file():
            return _scene
        return _cameras if _holds_cameras(path) else _splats
    if suffix in _LIGHTS:
        return _light
    if suffix == ".json" and is_layout(path):
        return _layout if _is_layout_of_splats(path) else _cameras
    if suffix in _MESHES and not looks_like_splat(path):
        return _mesh if suffix != ".ply" or _has_faces(path) else _splats
    return _cameras if suffix in (".txt", ".bin") and is_colmap(path.parent) else _splats


def _has_faces(path: Path) -> bool:
    with open(path, "rb") as file:
        return b"\nelement face" in file.read(_HEADER_BYTES)


def _holds_cameras(folder: Path) -> bool:
    """Whether a folder holds cameras and no splats."""
    try:
        parts_of(folder)
        return False
    except InputError:
        places = (folder, folder / "0", folder / "sparse" / "0", folder / "sparse", folder / "colmap" / "sparse" / "0")
        files = ("transforms.json", "cameras.json")
        return any(map(is_colmap, places)) or any((folder / name).is_file() for name in files)


def _is_layout_of_splats(path: Path) -> bool:
    from .base.inputs import read_json

    try:
        content = read_json(path)
    except ValueError:  # an InputError is one
        return True
    return isinstance(content, dict) and "frames" not in content


def _splats(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    try:
        parts = parts_of(path, asked.lod)
    except FramesError as error:
        first = _splats(error.frames[0], asked)
        warnings.warn(str(error), DataWarning, stacklevel=2)
        return first | {"frames": len(error.frames), "holds": f"a sequence of {len(error.frames)} frames"}
    kind = kind_of_file(parts.tiles[0])
    splats = read_splats(path, asked.lod)
    keep, counts = usable(splats)
    facts, form = splats.facts, BY_KIND[kind]
    found: dict[str, Any] = {
        "what": "splats",
        "format": form.title,
        "files": [os.fspath(tile) for tile in parts.tiles[:1]] if len(parts.tiles) == 1 else len(parts.tiles),
        "splats": len(splats),
        "dropped": {_REASONS[name]: count for name, count in counts.items() if count},
        "sh_degree": splats.degree,
        "axes": facts.frame or form.frame,
        "antialiased": facts.antialiased,
        "metres_per_unit": facts.metres,
        "offset": list(facts.offset) if any(facts.offset) else None,
    }
    if parts.level is not None:
        found |= {"level": parts.level, "splats_by_level": list(parts.level_counts)}
    if splats.environment is not None:
        found["environment"] = int(np.count_nonzero(splats.environment))
    kept = splats.take(np.flatnonzero(keep))
    if len(kept) < MIN_SPLATS:
        return found | {"holds": f"fewer than {MIN_SPLATS} usable splats: nothing to mesh"}
    low, high = np.percentile(kept.means, [1, 99], axis=0)
    width = float(np.median(kept.scales.max(axis=1)))
    found |= {"size": (high - low).tolist(), "middle": np.median(kept.means, axis=0).tolist(), "splat_width": width}
    return found | _capture(path, asked, kept)


def _capture(path: Path, asked: ConvertOptions, kept: Splats) -> dict[str, Any]:
    """Up, cameras, and what the splats show."""
    try:
        views = located_views(asked.cameras, path, asked.lod, kept)
    except InputError as error:
        warnings.warn(str(error), DataWarning, stacklevel=2)
        views = []
    some = _fewer(kept)
    rotation, up_from = upright(asked.up, views, some, lambda: is_place(some))
    far = far_background(some)
    standing = standing_of(some.take(np.flatnonzero(~far)), some, asked, rotation[1, :3])
    return {
        "up": (rotation[1, :3] + 0.0).round(6).tolist(),
        "up_from": up_from,
        "cameras": len(views),
        "holds": HOLDS[standing.kind],
        "far_background": round(float(far.mean()), 4),
    }


def _fewer(splats: Splats) -> Splats:
    """An even share of many splats, widened so that they cover the same area."""
    step = -(-len(splats) // LOOKED_AT)
    if step == 1:
        return splats
    sketch = splats.take(slice(None, None, step))
    return replace(sketch, scales=sketch.scales * np.float32(np.sqrt(step)))


def _cameras(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    views = read_cameras(path)[0]
    whole = [view for view in views if isinstance(view, View)]
    found: dict[str, Any] = {"what": "cameras", "cameras": len(views), "dropped": {}}
    if len(whole) < len(views):
        found["dropped"] = {"no usable pose": len(views) - len(whole)}
    if whole:
        centers = np.stack([view.center for view in whole])
        found |= {"pictures": sorted({f"{view.width} x {view.height}" for view in whole})[:8]}
        found |= {"middle": np.median(centers, axis=0).tolist(), "size": np.ptp(centers, axis=0).tolist()}
    return found


def _layout(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    try:
        objects = read_layout(path)
    except InputError as error:
        raise InputError(f"{error}; a .json may also be cameras: {CAMERA_KINDS}") from error
    return {"what": "layout", "objects": {each.name: os.fspath(each.splat) for each in objects}}


def _mesh(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    from .scene.meshfile import read_mesh

    mesh = read_mesh(path)
    size = np.ptp(mesh.vertices, axis=0).tolist()
    return {"what": "mesh", "vertices": len(mesh.vertices), "faces": len(mesh.faces), "size": size, "for": "relight"}


def _scene(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    from .scene.scene import Scene

    scene = Scene.load(path)
    counts = {"vertices": scene.vertex_count, "faces": len(scene.faces), "chunks": len(scene.chunks)}
    return {"what": "scene", **counts, "made_of": scene.source.get("file"), "for": "relight"}


def _light(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    """An environment by its header alone."""
    file_size(path, "picture")
    with open(path, "rb") as file:
        head = file.read(_HEADER_BYTES)
    found = _exr(path, head) if head.startswith(b"\x76\x2f\x31\x01") else _radiance(path, head)
    width, height = found["width"], found["height"]
    shapes = {(2, 1): "lat-long", (1, 1): "square: an angular map", (3, 4): "a vertical cross"}
    layout = next((name for (w, h), name in shapes.items() if width * h == height * w), "none of those known: lat-long")
    return {"what": "light", **found, "layout": layout, "for": "relight --env"}


def _exr(path: Path, head: bytes) -> dict[str, Any]:
    """Size, channels and primaries of an OpenEXR file. Source: OpenEXR, "File Layout"."""
    attributes: dict[str, bytes] = {}
    at = 8
    try:
        while head[at] and len(attributes) < 1000:
            name_end = head.index(b"\0", at)
            kind_end = head.index(b"\0", name_end + 1)
            size = int.from_bytes(head[kind_end + 1 : kind_end + 5], "little")
            attributes.setdefault(head[at:name_end].decode("latin-1"), head[kind_end + 5 : kind_end + 5 + size])
            at = kind_end + 5 + size
        left, top, right, bottom = np.frombuffer(attributes["displayWindow"], "<i4").tolist()
    except (IndexError, KeyError, ValueError):
        raise InputError(f"{path} is a damaged OpenEXR file: its header does not end") from None
    channels: list[str] = []
    rest = attributes.get("channels", b"")
    while rest and rest[0] and b"\0" in rest:
        name, _, rest = rest.partition(b"\0")
        channels.append(name.decode("latin-1"))
        rest = rest[16:]
    primaries = np.frombuffer(attributes.get("chromaticities", b"")[:32], "<f4").round(4).tolist()
    extent = {"width": right - left + 1, "height": bottom - top + 1}
    return {
        "format": "OpenEXR",
        **extent,
        "channels": channels,
        "chromaticities": primaries or "Rec. 709, as none are given",
    }


def _radiance(path: Path, head: bytes) -> dict[str, Any]:
    """Size and primaries of a Radiance picture. Source: Ward, "Real Pixels" (1991)."""
    lines = head.split(b"\n\n", 1)
    size = lines[1].split(b"\n", 1)[0].split() if len(lines) == 2 else []
    if not head.startswith(b"#?") or len(size) != 4 or not (size[1].isdigit() and size[3].isdigit()):
        raise InputError(f"{path} is no picture of light: expected OpenEXR or Radiance HDR")
    numbers = {size[0][-1:]: int(size[1]), size[2][-1:]: int(size[3])}
    named = [line for line in lines[0].split(b"\n") if line.startswith(b"PRIMARIES=")]
    primaries = named[0].partition(b"=")[2].decode("latin-1").strip() if named else "Rec. 709, as none are given"
    wide = {"width": numbers.get(b"X", 0), "height": numbers.get(b"Y", 0)}
    return {"format": "Radiance HDR", **wide, "channels": ["R", "G", "B"], "chromaticities": primaries}


def lines_of(found: dict[str, Any]) -> list[str]:
    """Return lines of text that say the same as `info_of`."""
    lines = []
    for name, value in found.items():
        if name in ("warnings", "dropped") or value is None:
            continue
        lines.append(f"{name.replace('_', ' '):<18}{_text(value)}")
    for reason, count in found.get("dropped", {}).items():
        lines.append(f"{'dropped':<18}{count:,} with {reason}")
    return lines + [f"{'warning':<18}{warning}" for warning in found["warnings"]]


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        return f"{value:,.0f}" if value.is_integer() else f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{name}: {_text(each)}" for name, each in value.items())
    return ", ".join(map(_text, value)) if isinstance(value, list) else str(value)
