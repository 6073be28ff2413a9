"""The view for a picture of a place: from a visitor's position, towards the most closely captured part."""

from collections.abc import Callable, Sequence

import numpy as np

from ..base.arrays import Floats, Integers, Points, Vector
from ..base.sphere import level_directions
from ..render.beside import WIDTH
from ..render.opacitygrid import BEFORE
from ..render.raycaster import RayCaster
from ..render.view import View
from .eyes import Eye
from .viewpoints import CANDIDATE_PIXELS, ELEVATIONS_DEG, PICTURE_ASPECT, SKETCH_SPLATS, TURNS

FOV_DEG = 70.0
"""Horizontal angle of the picture."""

ROOMY = 0.35
"""Distance, in units of the typical one, that the nearest twentieth of a good picture has at least."""


def place_view(
    vertices: Points,
    depth_in: Callable[[View], Floats],
    eyes: Sequence[Eye],
    trained: Sequence[View],
    up: Vector,
) -> View:
    """The View that shows most of a place, from a sufficient distance.

    vertices: (V, 3) of its surface, in the splat's frame. depth_in: gives the camera z (H, W) of what a view shows.
    eyes: list of standpoints.Eye. trained: list of View, the cameras of the capture, if there are any. up: (3,) unit. A
    candidate's worth is the share of vertices that it shows, times how far away its nearest surfaces are.
    """
    rng = np.random.default_rng(0)
    points = vertices[rng.choice(len(vertices), min(SKETCH_SPLATS, len(vertices)), replace=False)].astype(np.float64)
    views = _candidates(eyes, trained, np.asarray(up, np.float64))
    depths = [depth_in(view) for view in views]
    met = np.concatenate([depth[np.isfinite(depth)] for depth in depths])
    typical = float(np.median(met)) if len(met) else 1.0
    worth = [_worth(view, depth, points, typical) for view, depth in zip(views, depths, strict=True)]
    best = views[int(np.argmax(worth))]
    return View.look_at(best.center, best.center + best.forward, up, FOV_DEG, WIDTH, round(WIDTH / PICTURE_ASPECT))


def _candidates(eyes: Sequence[Eye], trained: Sequence[View], up: Vector) -> list[View]:
    looks = [(view.center, view.forward) for view in trained]
    for eye in eyes:
        for level in level_directions(up, TURNS):
            looks += [(eye.center, level - np.tan(np.radians(down)) * up) for down in ELEVATIONS_DEG]
    rows = round(CANDIDATE_PIXELS / PICTURE_ASPECT)
    return [View.look_at(center, center + forward, up, FOV_DEG, CANDIDATE_PIXELS, rows) for center, forward in looks]


def mesh_depth(vertices: Points, faces: Integers) -> Callable[[View], Floats]:
    """A function that gives the camera z (H, W) float32 of a mesh's first surface in a view; infinite without one."""
    caster = RayCaster(vertices, faces)

    def depth(view: View) -> Floats:
        directions = view.ray_directions()
        origins = np.broadcast_to(view.center, directions.shape)
        return caster.first_hits(np.concatenate([origins, directions], axis=-1)).distance

    return depth


def _worth(view: View, depth: Floats, points: Points, typical: float) -> float:
    _, pixel, z = view.shown(points)
    shown = (BEFORE * z < depth[tuple(pixel)]).sum() / len(points)
    met = depth[np.isfinite(depth)]
    near = float(np.percentile(met, 5)) if len(met) else 0.0
    return shown * min(near / (ROOMY * typical), 1.0) * (0.3 + 0.7 * len(met) / depth.size)
