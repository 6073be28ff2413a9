"""What a splat, its cameras or a layout hold and what would become of them, in seconds."""

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from .base.errors import DataWarning, InputError
from .base.inputs import check_special, read_json, reading
from .capture import is_place, standing_of
from .layout import is_layout, read_layout
from .options import ConvertOptions
from .render.view import View
from .splats.cleaning import REASONS, usable
from .splats.foreground import far_background
from .splats.formats import parts_of, read_splats
from .splats.formats.register import BY_KIND, kind_of_file
from .splats.splats import MIN_SPLATS, Splats
from .views.cameras import KINDS as CAMERA_KINDS
from .views.cameras import read_cameras
from .views.colmap import colmap_models, is_colmap
from .views.located import located_views
from .views.upright import upright
from .views.viewpoints import thinned

LOOKED_AT = 200_000
"""Splats from which up and the kind of the capture are found; of more a sample, widened to cover as much."""

HOLDS = {"outside": "an object", "inside": "a room", "both": "a place in the open"}


def info_of(path: str | os.PathLike[str], options: ConvertOptions | None = None) -> dict[str, Any]:
    """Describe a file or folder of splats or cameras, or a layout.

    options: `lod`, `cameras` and `up` count. It is JSON-clean. `what` is splats, cameras or layout; `warnings` are
    those of reading. Raises InputError for what is missing, broken, or of no known kind.
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
        return _cameras if _holds_cameras(path) else _splats
    if suffix == ".json" and is_layout(path):
        return _layout if _is_layout_of_splats(path) else _cameras
    return _cameras if suffix in (".txt", ".bin") and is_colmap(path.parent) else _splats


def _holds_cameras(folder: Path) -> bool:
    """Whether a folder holds cameras and no splats."""
    try:
        parts_of(folder)
        return False
    except InputError:
        files = ("transforms.json", "cameras.json")
        return bool(colmap_models(folder)) or any((folder / name).is_file() for name in files)


def _is_layout_of_splats(path: Path) -> bool:
    try:
        content = read_json(path)
    except InputError:
        return True
    return isinstance(content, dict) and "frames" not in content


def _splats(path: Path, asked: ConvertOptions) -> dict[str, Any]:
    parts = parts_of(path, asked.lod)
    kind = kind_of_file(parts.tiles[0])
    splats = read_splats(path, asked.lod)
    keep, counts = usable(splats)
    facts, form = splats.facts, BY_KIND[kind]
    found: dict[str, Any] = {
        "what": "splats",
        "format": form.title,
        "files": [os.fspath(tile) for tile in parts.tiles[:1]] if len(parts.tiles) == 1 else len(parts.tiles),
        "splats": len(splats),
        "dropped": {REASONS[name]: count for name, count in counts.items() if count},
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
    some = thinned(kept, np.random.default_rng(0), LOOKED_AT)
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
