"""The cameras of a capture: found, read in any format, and checked against the splat."""

import os
import warnings
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..base.arrays import Points
from ..base.errors import DataWarning, InputError
from ..base.inputs import read_json, reading
from ..render.view import View
from ..splats.splats import SOLID, Splats
from .cameras_json import views_of_cameras_json
from .colmap import colmap_models, is_colmap, read_colmap
from .nerfstudio import candidates_of_transforms
from .poses import Camera
from .viewpoints import SKETCH_SPLATS

KINDS = "a COLMAP folder such as sparse/0, a cameras.json of INRIA, or a transforms.json of nerfstudio"

NONE = "none"
"""For `cameras`: virtual views, even where cameras would be found."""

SEES = 0.001
"""Share of the solid splats that a camera must have in its picture to see the capture: one room of many is 1%."""

JUDGES = 16
"""Views for the choice among several frames."""

CLEARLY = 0.95
"""Share of the sharpest frame's sharpness from which a likelier frame is taken: wrong ones reach .37 to .94 of it
around places and a table, but around a single object nothing distinguishes them."""


class FramedCameras(NamedTuple):
    """Cameras of a file or folder, in one of the frames that the splat may be in, and those that can be used."""

    source: Path
    cameras: list[Camera]
    usable: list[View]

    @classmethod
    def of(cls, source: Path, cameras: list[Camera]) -> "FramedCameras":
        return cls(source, cameras, [camera for camera in cameras if isinstance(camera, View)])

    def seeing(self, points: Points) -> "FramedCameras":
        """The same, of which only the cameras that see points can be used."""
        return self._replace(usable=[view for view in self.usable if _sees(view, points)])


def trained_views(
    given: str | os.PathLike[str] | None, splat_path: str | os.PathLike[str], splats: Splats
) -> list[View]:
    """The cameras of a capture: a list of View in the frame of the splat, empty where there are none.

    given: path of a camera file or folder, one of KINDS; None: those that lie beside the splat; NONE: no cameras.
    splat_path: of the splat. splats: cleaned Splats of it.
    Raises InputError when they cannot be read, and when none of them sees the splat; warns with a DataWarning about
    those that were dropped.
    """
    path = cameras_beside(splat_path) if given is None else Path(given)
    if path is None or (given is not None and str(given) == NONE):
        return []
    with reading(path), np.errstate(all="ignore"):
        frames = _frames(path, splat_path)
    solid = _solid(splats)
    frames = [frame.seeing(solid) for frame in frames]
    if len({frame.source for frame in frames}) > 1:
        frames = [_fullest(path, frames)]
    if not any(frame.usable for frame in frames):
        advice = "`cameras` none does without" if given is None else "give those of this capture"
        raise InputError(
            f"{path}: none of its {len(frames[0].cameras)} cameras sees a solid splat of {splat_path}: "
            f"they belong to another scene, or the splat was moved; {advice}"
        )
    chosen = _sharpest(frames, splats)
    _warn_dropped(path, chosen)
    return chosen.usable


def usable_views(path: str | os.PathLike[str]) -> list[View]:
    """The cameras of a path where no splat checks them: those of its fullest model. Raises InputError for none; warns
    about those that were dropped."""
    fullest = _fullest(Path(path), _frames(Path(path)))
    _warn_dropped(path, fullest)
    return fullest.usable


def read_cameras(path: str | os.PathLike[str], splat_path: str | os.PathLike[str] = ".") -> list[list[Camera]]:
    """The cameras of a path, in every frame that the splat may be in: a list of lists of View, or why one gives none.

    path: a file or folder, recognised by its content. splat_path: of the splat that they belong to. Raises InputError
    for any other, and for one without cameras.
    """
    return [frame.cameras for frame in _frames(Path(path), splat_path)]


def _warn_dropped(path: str | os.PathLike[str], frame: FramedCameras) -> None:
    """One DataWarning about cameras of a file that are left out, why each."""
    reasons = Counter(camera for camera in frame.cameras if isinstance(camera, str))
    reasons["see no solid splat"] = len(frame.cameras) - reasons.total() - len(frame.usable)
    text = " and ".join(f"{number} that {reason}" for reason, number in reasons.items() if number)
    if text:
        warnings.warn(f"{path}: dropped, of {len(frame.cameras)} cameras, {text}", DataWarning, stacklevel=3)


def _fullest(path: Path, frames: Sequence[FramedCameras]) -> FramedCameras:
    """The model with most usable cameras, the first of equal ones; warns, saying which, where they differ."""
    best = max(frames, key=lambda frame: len(frame.usable))
    others = [frame for frame in frames if len(frame.usable) < len(best.usable)]
    if others:
        listed = ", ".join(f"{frame.source.relative_to(path)} {len(frame.usable)}" for frame in others)
        warnings.warn(
            f"{path}: of its {len(frames)} COLMAP models {best.source.relative_to(path)} is used, the one with most "
            f"usable cameras ({len(best.usable)}; {listed})",
            DataWarning,
            stacklevel=3,
        )
    return best


def _sharpest(frames: Sequence[FramedCameras], splats: Splats) -> FramedCameras:
    """Of the frames in which most cameras see the splat the likeliest, the first, that shows it nearly as sharp as
    any."""
    most = max(len(frame.usable) for frame in frames)
    likely = [frame for frame in frames if len(frame.usable) > most / 2]
    if len(likely) == 1:
        return likely[0]
    sharpness = [_sharpness(frame.usable, splats) for frame in likely]
    return next(frame for frame, sharp in zip(likely, sharpness, strict=True) if sharp > CLEARLY * max(sharpness))


def _frames(path: Path, splat_path: str | os.PathLike[str] = ".") -> list[FramedCameras]:
    """The cameras of a path in every frame that the splat may be in, or of each of its COLMAP models."""
    if not path.is_dir():
        return _of_json(path, splat_path)
    if is_colmap(path):
        return [FramedCameras.of(path, read_colmap(path))]
    inside = [path / name for name in ("transforms.json", "cameras.json") if (path / name).is_file()]
    if inside:
        return _of_json(inside[0], splat_path)
    models = colmap_models(path)
    if not models:
        raise InputError(f"{path}: no COLMAP model lies in this folder; expected {KINDS}")
    return _of_models(path, models)


def _of_json(path: Path, splat_path: str | os.PathLike[str]) -> list[FramedCameras]:
    """The cameras of a JSON file of either kind, in every frame that the splat may be in."""
    try:
        content = read_json(path)
    except InputError as error:
        raise InputError(f"{error}; expected {KINDS}") from error
    if isinstance(content, list) and all(isinstance(entry, dict) for entry in content):
        found = [views_of_cameras_json(path, content)]
    elif isinstance(content, dict) and isinstance(content.get("frames"), list):
        found = candidates_of_transforms(path, content, splat_path)
    else:
        raise InputError(f"{path} holds no cameras; expected {KINDS}")
    if not found[0]:
        raise InputError(f"{path} holds no cameras: its list is empty")
    return [FramedCameras.of(path, cameras) for cameras in found]


def _of_models(path: Path, models: Sequence[Path]) -> list[FramedCameras]:
    """The cameras of several COLMAP models; those that cannot be read are left out beside one that can."""
    found, errors = [], []
    for model in models:
        try:
            found.append(FramedCameras.of(model, read_colmap(model)))
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
    return len(view.shown(points)[0]) >= max(1, SEES * len(points))


def _solid(splats: Splats) -> Points:
    """Centres of solid splats, evenly picked where there are many: (N, 3)."""
    rows = np.flatnonzero(splats.opacities > SOLID)
    rows = rows if len(rows) else np.arange(len(splats))
    return splats.means[rows[:: 1 + len(rows) // SKETCH_SPLATS]]


def _sharpness(views: Sequence[View], splats: Splats) -> float:
    """Mean over pictures of how much sharp surface they show, 0 to 1: cameras in the right frame show most."""
    from ..render.opacityfield import field_depth
    from .viewpoints import CANDIDATE_PIXELS, bounds_of, near_plane, thinned

    near, sketch = near_plane(bounds_of(splats)), thinned(splats, np.random.default_rng(0))
    shown = []
    for view in spread_out(views, JUDGES):
        surface = field_depth(sketch, view.resized(CANDIDATE_PIXELS), near)
        seen = np.isfinite(surface.depth)
        shown.append(np.sum(surface.sharpness()[seen]) / seen.size)
    return float(np.mean(shown))
