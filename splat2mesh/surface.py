"""Two ways from a splat and views of it to a raw surface, behind one door.

field   depth maps at a level of the opacity field, fused into a signed distance field: the default, more accurate.
sugar   points on a level of the density field, Poisson: the way of the SuGaR paper, kept for comparison.
"""

from dataclasses import dataclass, replace

import numpy as np

from .coloring import Picture
from .errors import InputError
from .viewpoints import bounds_of, near_plane

WAYS = ("field", "sugar")

TRAINING_DILATION = 0.3
"""Variance in square pixels that training added to every Gaussian on screen (Kerbl et al. 2023)."""

SCALES_PER_PIXEL = 1.4
"""The smallest tenth of the solid Gaussians' largest scales, in training pixels: what training lets shrink."""


@dataclass(frozen=True)
class Effort:
    """How much work goes into a surface.

    views: rendered views, of `pixels` along the longer side. cells: voxels along the scene's diagonal (field).
    depth: octree levels (sugar). points: surface points aimed at (sugar).
    """

    views: int
    pixels: int
    cells: int
    depth: int
    points: int


EFFORTS = {
    "draft": Effort(views=32, pixels=256, cells=224, depth=8, points=200_000),
    "normal": Effort(views=64, pixels=320, cells=320, depth=9, points=500_000),
    "fine": Effort(views=128, pixels=448, cells=448, depth=10, points=1_500_000),
}


def training_pixel(splats, views=None):
    """Size of a training pixel at the surface, in the splat's unit.

    views: the trained cameras at their own resolution, where known; else it is read off the smallest Gaussians.
    """
    if views:
        center = bounds_of(splats).mean(axis=0)
        return float(np.median([np.linalg.norm(view.center - center) / view.fx for view in views]))
    solid = splats.opacities > 0.5 if (splats.opacities > 0.5).any() else slice(None)
    return float(np.percentile(splats.scales.max(axis=1)[solid], 10)) / SCALES_PER_PIXEL


def dilated(splats, pixel):
    """The splats as training saw them: every Gaussian widened by the dilation of a training pixel.

    Training fitted the dilated envelope to the photos, so that is where the surface is, not at the bare Gaussians.
    """
    scales = np.sqrt(splats.scales**2 + np.float32(TRAINING_DILATION * pixel**2))
    return replace(splats, scales=scales.astype(np.float32))


def extract(way, splats, views, effort, stages):
    """The raw surface of `splats` (already dilated) as seen in `views`: an open3d TriangleMesh and a list of Picture.

    way: one of WAYS. effort: Effort. stages: Stages. Raises InputError when hardly any surface is found.
    """
    return (_field if way == "field" else _sugar)(splats, views, effort, stages)


def _field(splats, views, effort, stages):
    from .fusion import DepthMap, fuse
    from .opacityfield import field_depth

    bounds = bounds_of(splats)
    near, diagonal = near_plane(bounds), float(np.linalg.norm(np.ptp(bounds, axis=0)))
    maps, pictures = [], []
    with stages.stage("depth maps", total=len(views)) as advance:
        for view in views:
            seen = field_depth(splats, view, near)
            maps.append(DepthMap.of(view, seen.depth, seen.normal, seen.spread, diagonal / 2))
            pictures.append(Picture.of(view, seen.color, seen.depth))
            advance()
    _require_surface(sum(int(np.isfinite(picture.depth).sum()) for picture in pictures))
    with stages.stage("fusion", total=len(views)) as advance:
        return fuse(maps, diagonal / effort.cells, advance), pictures


def _sugar(splats, views, effort, stages):
    from .rasterize import rasterize
    from .sugar import DensityField, SurfacePoints, poisson, surface_points

    near, field = near_plane(bounds_of(splats)), DensityField(splats)
    found, pictures = [], []
    with stages.stage("surface points", total=len(views)) as advance:
        for view in views:
            rendering = rasterize(splats, view, near)
            covered = np.isfinite(rendering.depth_median).sum() * len(views)
            found.append(surface_points(field, view, rendering, max(1, int(np.sqrt(covered / effort.points)))))
            color = rendering.color / np.maximum(rendering.alpha, 1e-3)[..., None]
            pictures.append(Picture.of(view, color, rendering.depth_median))
            advance()
    points, normals = (np.concatenate([getattr(part, name) for part in found]) for name in ("points", "normals"))
    _require_surface(len(points))
    with stages.stage("Poisson"):
        return poisson(SurfacePoints(points, normals), effort.depth), pictures


def _require_surface(points):
    if points < 100:
        raise InputError(f"only {points} surface points were found: is this a splat of a solid object?")
