"""The cameras of a capture: found, read in any format, and checked against the splat."""

import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..base.arrays import Points
from ..base.errors import DataWarning, InputError
from ..base.inputs import read_json, reading
from ..render.view import View
from ..splats.splats import Splats
from .cameras_json import views_of_cameras_json
from .colmap import is_colmap, read_colmap
from .nerfstudio import candidates_of_transforms

INSIDE = ("0", "sparse/0", "colmap/sparse/0", "sparse")
"""Where the COLMAP model of a capture lies in the folders that people name instead."""

KINDS = "a COLMAP folder such as sparse/0, a cameras.json of INRIA, or a transforms.json of nerfstudio"

NONE = "none"
"""For `cameras`: virtual views, even where cameras would be found."""

SOLID = 0.3
"""Opacity above which a splat counts as solid here."""

LOOKED_AT = 20_000
"""Number of solid splats that check cameras."""

SEES = 0.001
"""Share of the solid splats that a camera must have in its picture to see the capture: one room of many is 1%."""

JUDGES, JUDGE_PIXELS, SKETCH_SPLATS = 16, 64, 40_000
"""Views, their longer side and the splats in them, for the choice among several frames."""

CLEARLY = 0.95
"""Share of the sharpest frame's sharpness from which a likelier frame is taken: wrong ones reach .37 to .94 of it
around places and a table, but around a single object nothing distinguishes them."""

SHARP = 0.02
"""Thickness of a surface, in distances to it, up to which it looks sharp to such a view."""


def trained_views(
    given: str | os.PathLike[str] | None, splat_path: str | os.PathLike[str], splats: Splats
) -> list[View]:
    """The cameras of a capture: a list of View in the frame of the splat, empty where there are none.

    given: path of a camera file or folder, one of KINDS; None: those that lie beside the splat; NONE: no cameras.
    splat_path: of the splat. splats: cleaned Splats of it.
    Raises InputError when they cannot be read, and when none of them sees the splat; warns with a DataWarning about
    those that were dropped.
    """
    if given is not None and str(given) == NONE:
        return []
    path = cameras_beside(splat_path) if given is None else Path(given)
    if path is None:
        return []
    with reading(path), np.errstate(all="ignore"):
        candidates = read_cameras(path, splat_path)
    solid = _solid(splats)
    frames = [(views, [view for view in views if view is not None and _sees(view, solid)]) for views in candidates]
    most = max(len(seeing) for _, seeing in frames)
    if most == 0:
        advice = "`cameras` none does without" if given is None else "give those of this capture"
        raise InputError(
            f"{path}: none of its {len(frames[0][0])} cameras sees a solid splat of {splat_path}: "
            f"they belong to another scene, or the splat was moved; {advice}"
        )
    likely = [frame for frame in frames if len(frame[1]) > most / 2]
    if len(likely) > 1:
        sharpness = [_sharpness(seeing, splats) for _, seeing in likely]
        likely = [frame for frame, sharp in zip(likely, sharpness, strict=True) if sharp > CLEARLY * max(sharpness)]
    views, seeing = likely[0]
    if len(seeing) < len(views):
        lost = sum(view is None for view in views)
        reasons = {"have no finite pose": lost, "see no solid splat": len(views) - lost - len(seeing)}
        text = " and ".join(f"{count} that {reason}" for reason, count in reasons.items() if count)
        warnings.warn(f"{path}: dropped, of {len(views)} cameras, {text}", DataWarning, stacklevel=2)
    return seeing


def read_cameras(path: str | os.PathLike[str], splat_path: str | os.PathLike[str] = ".") -> list[list[View | None]]:
    """The cameras of a path, in every frame that the splat may be in: a list of lists of View or None (no finite pose).

    path: a file or folder, recognised by its content. splat_path: of the splat that they belong to. Raises InputError
    for any other, and for one without cameras.
    """
    path = Path(path)
    if path.is_dir():
        if is_colmap(path):
            return [list(read_colmap(path))]
        inside = [path / name for name in ("transforms.json", "cameras.json") if (path / name).is_file()]
        models = [path / name for name in INSIDE if is_colmap(path / name)]
        if models and not inside:
            return [list(read_colmap(models[0]))]
        if not inside:
            raise InputError(f"{path}: no COLMAP model lies in this folder; expected {KINDS}")
        path = inside[0]
    try:
        content = read_json(path)
    except InputError as error:
        raise InputError(f"{error}; expected {KINDS}") from error
    except ValueError as error:
        raise InputError(f"{path} is not JSON ({error}); expected {KINDS}") from error
    if isinstance(content, list) and all(isinstance(entry, dict) for entry in content):
        found = [views_of_cameras_json(path, content)]
    elif isinstance(content, dict) and isinstance(content.get("frames"), list):
        found = candidates_of_transforms(path, content, splat_path)
    else:
        raise InputError(f"{path} holds no cameras; expected {KINDS}")
    if not found[0]:
        raise InputError(f"{path} holds no cameras: its list is empty")
    return found


def cameras_beside(splat_path: str | os.PathLike[str]) -> Path | None:
    """The cameras.json that INRIA's training keeps two folders above point_cloud/iteration_N, or None."""
    path = Path(os.path.abspath(splat_path))
    folder = path if path.is_dir() else path.parent
    if not folder.name.startswith("iteration_") or folder.parent.name != "point_cloud":
        return None
    file = folder.parent.parent / "cameras.json"
    return file if file.is_file() else None


def spread_out(views: Sequence[View], count: int) -> list[View]:
    """Choose the `count` views that differ most in position and direction (farthest-point choice, first view first)."""
    if len(views) <= count:
        return list(views)
    centers = np.stack([view.center for view in views])
    extent = max(float(np.linalg.norm(centers.std(axis=0))), 1e-12)
    features = np.hstack([centers / extent, np.stack([view.forward for view in views])])
    chosen, distance = [0], np.linalg.norm(features - features[0], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return [views[index] for index in sorted(chosen)]


def _sees(view: View, points: Points) -> bool:
    """Whether a camera has points in its picture, SEES of them at least: (N, 3) world."""
    pixels, depth = view.project(points)
    with np.errstate(invalid="ignore"):
        inside = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
    return bool(np.count_nonzero(inside) >= max(1, SEES * len(points)))


def _solid(splats: Splats) -> Points:
    """Centres of solid splats, evenly picked where there are many: (N, 3)."""
    rows = np.flatnonzero(splats.opacities > SOLID)
    rows = rows if len(rows) else np.arange(len(splats))
    return splats.means[rows[:: 1 + len(rows) // LOOKED_AT]]


def _sharpness(views: Sequence[View], splats: Splats) -> float:
    """Mean over pictures of how much sharp surface they show, 0 to 1: cameras in the right frame show most."""
    from ..render.opacityfield import field_depth
    from .viewpoints import bounds_of, near_plane

    near, step = near_plane(bounds_of(splats)), 1 + len(splats) // SKETCH_SPLATS
    sketch = splats.take(slice(None, None, step))
    sketch = replace(sketch, scales=sketch.scales * np.float32(np.sqrt(step)))  # so that they cover the same area
    shown = []
    for view in spread_out(views, JUDGES):
        surface = field_depth(sketch, view.resized(JUDGE_PIXELS), near)
        seen = np.isfinite(surface.depth)
        blur = surface.spread[seen] / surface.depth[seen] / SHARP
        shown.append(np.sum(1 / (1 + blur**2)) / seen.size)
    return float(np.mean(shown))
