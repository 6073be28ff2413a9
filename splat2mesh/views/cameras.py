"""The cameras of a capture: found, read in any format, and checked against the splat."""

import os
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..base.arrays import Points
from ..base.errors import DataWarning, InputError
from ..base.inputs import read_json, reading
from ..render.view import View
from ..splats.splats import Splats
from .cameras_json import views_of_cameras_json
from .colmap import colmap_models, is_colmap, larger_models, read_colmap
from .nerfstudio import candidates_of_transforms
from .poses import Camera

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
        candidates = _candidates(path, splat_path)
    solid = _solid(splats)
    frames = [(views, [view for view in _views(views) if _sees(view, solid)]) for _, views in candidates]
    if len({source for source, _ in candidates}) > 1:
        frames = [_fullest(path, [source for source, _ in candidates], frames)]
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
    blind = ["see no solid splat"] * (len(_views(views)) - len(seeing))
    _warn_dropped(path, len(views), [*(view for view in views if isinstance(view, str)), *blind])
    return seeing


def usable_views(path: str | os.PathLike[str]) -> list[View]:
    """The cameras of a path where no splat checks them: those of its fullest model. Raises InputError for none; warns
    about those that were dropped."""
    candidates = _candidates(Path(path))
    frames = [(views, _views(views)) for _, views in candidates]
    views, usable = _fullest(Path(path), [source for source, _ in candidates], frames)
    _warn_dropped(path, len(views), [view for view in views if isinstance(view, str)])
    return usable


def read_cameras(path: str | os.PathLike[str], splat_path: str | os.PathLike[str] = ".") -> list[list[Camera]]:
    """The cameras of a path, in every frame that the splat may be in: a list of lists of View, or why one gives none.

    path: a file or folder, recognised by its content. splat_path: of the splat that they belong to. Raises InputError
    for any other, and for one without cameras.
    """
    return [views for _, views in _candidates(Path(path), splat_path)]


def _views(cameras: Sequence[Camera]) -> list[View]:
    return [camera for camera in cameras if isinstance(camera, View)]


def _warn_dropped(path: str | os.PathLike[str], count: int, reasons: Sequence[str]) -> None:
    """One DataWarning about cameras of a file that are left out, why each."""
    text = " and ".join(f"{number} that {reason}" for reason, number in Counter(reasons).items())
    if text:
        warnings.warn(f"{path}: dropped, of {count} cameras, {text}", DataWarning, stacklevel=3)


_Frame: TypeAlias = tuple[list[Camera], list[View]]  # cameras in one frame, and those that can be used


def _fullest(path: Path, sources: Sequence[Path], frames: Sequence[_Frame]) -> _Frame:
    """The model with most usable cameras, the first of equal ones; warns, saying which, where they differ."""
    most = max(range(len(frames)), key=lambda index: len(frames[index][1]))
    others = [k for k in range(len(frames)) if k != most and len(frames[k][1]) < len(frames[most][1])]
    if others:
        listed = ", ".join(f"{sources[k].relative_to(path)} {len(frames[k][1])}" for k in others)
        warnings.warn(
            f"{path}: of its {len(frames)} COLMAP models {sources[most].relative_to(path)} is used, the one with most "
            f"usable cameras ({len(frames[most][1])}; {listed})",
            DataWarning,
            stacklevel=3,
        )
    return frames[most]


def _candidates(path: Path, splat_path: str | os.PathLike[str] = ".") -> list[tuple[Path, list[Camera]]]:
    """As `read_cameras`, each with the file or folder that holds it."""
    if path.is_dir():
        if is_colmap(path):
            found = read_colmap(path)
            for other in larger_models(path):
                warnings.warn(
                    f"{path} holds {len(found)} cameras, and {other.name} beside it {len(read_colmap(other))}: "
                    f"give {other} if the splat was trained with those",
                    DataWarning,
                    stacklevel=3,
                )
            return [(path, found)]
        inside = [path / name for name in ("transforms.json", "cameras.json") if (path / name).is_file()]
        models = colmap_models(path)
        if models and not inside:
            return _of_models(path, models)
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
        candidates = [views_of_cameras_json(path, content)]
    elif isinstance(content, dict) and isinstance(content.get("frames"), list):
        candidates = candidates_of_transforms(path, content, splat_path)
    else:
        raise InputError(f"{path} holds no cameras; expected {KINDS}")
    if not candidates[0]:
        raise InputError(f"{path} holds no cameras: its list is empty")
    return [(path, views) for views in candidates]


def _of_models(path: Path, models: Sequence[Path]) -> list[tuple[Path, list[Camera]]]:
    """The cameras of several COLMAP models; those that cannot be read are left out beside one that can."""
    found, errors = [], []
    for model in models:
        try:
            found.append((model, read_colmap(model)))
        except InputError as error:
            errors.append(error)
    if not found:
        raise errors[0]
    if errors:
        message = f"{path}: left out {len(errors)} of {len(models)} COLMAP models: {errors[0]}"
        warnings.warn(message, DataWarning, stacklevel=4)
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
