"""Two methods from a splat and views of it to a raw surface, behind one function.

field   depth maps at a level of the opacity field, fused into a signed distance field: the default, more accurate.
sugar   points on a level of the density field, Poisson: the method of the SuGaR paper, kept for comparison.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..base.arrays import Floats
from ..base.errors import InputError
from ..base.progress import Stages
from ..render.footprints import DILATION as TRAINING_DILATION
from ..render.opacitygrid import SCALES_PER_PIXEL
from ..render.rasterize import rasterize
from ..render.view import View
from ..splats.merging import merged
from ..splats.splats import Splats
from ..views.viewpoints import bounds_of, near_plane
from .album import RenderedPicture
from .fusion import PlaneMap, fuse
from .sight import Sighting
from .sugar import DensityField, SurfacePoints, poisson, surface_points

LEVEL = 0.5
"""Opacity at which the surface of an object lies: half. A level by how thick surfaces look, .38 to .5, was fitted to
two scenes, and was worse on a third (docs/surface.md)."""

PROBES, PROBE_PIXELS = 8, 128
"""Views, and their pixels, in which the thickness is measured."""

LEAST_POINTS = 100
"""Points without which there is no surface."""

FINEST_CELL = 0.7
"""Least side of a voxel, or of a cell of a place, in training pixels: there is nothing finer in a splat."""

SPARE_VERTICES = 1.3
"""Vertices of a raw surface over those wanted, where it is made again for a larger mesh: without spare ones ceramics
lose .014 of F.25."""

PER_PIXEL = 1.5
"""Gaussians for each pixel of a view, beyond which they are merged: half a one for each pixel of the surface, which a
third of the views or so show."""


@dataclass(frozen=True)
class Effort:
    """The amount of work for a surface. views: rendered views, of `pixels` along the longer side. cells: voxels along
    the scene's diagonal (field), of which the octree (sugar) has as many or more."""

    views: int
    pixels: int
    cells: int

    @property
    def depth(self) -> int:
        """Levels of the octree (sugar)."""
        return math.ceil(math.log2(self.cells))

    @property
    def points(self) -> int:
        """Surface points aimed at (sugar): two for each cell of a side of the octree's cube."""
        return 2 * (2**self.depth) ** 2


EFFORTS = {
    "draft": Effort(views=32, pixels=256, cells=224),
    "normal": Effort(views=64, pixels=320, cells=320),
    "fine": Effort(views=96, pixels=448, cells=320),
}


def training_pixel(splats: Splats) -> float:
    """Size of a training pixel at the surface, in the splat's unit, read off the smallest solid Gaussians. Trained
    cameras would give it directly, but the surface is no better for it (docs/surface.md)."""
    solid = splats.opacities > 0.5 if (splats.opacities > 0.5).any() else slice(None)
    return float(np.percentile(splats.scales.max(axis=1)[solid], 10)) / SCALES_PER_PIXEL


def dilated(splats: Splats, pixel: float) -> Splats:
    """The splats as training saw them: every Gaussian widened by the dilation of a training pixel. Training fitted the
    dilated envelope to the photos, so that is where the surface is, not at the bare Gaussians."""
    scales = np.sqrt(splats.scales**2 + np.float32(TRAINING_DILATION * pixel**2))
    return replace(splats, scales=scales.astype(np.float32))


def as_trained(splats: Splats) -> tuple[Splats, float]:
    """The splats of a file, dilated for the pixel estimated from them, and that pixel."""
    pixel = training_pixel(splats)
    return dilated(splats, pixel), pixel


class Look(NamedTuple):
    """Splats, dilated; the size of a training pixel in their unit; views that show them, and near planes, (M,)."""

    splats: Splats
    pixel: float
    views: Sequence[View]
    near: Floats

    @classmethod
    def around(cls, splats: Splats, pixel: float, views: Sequence[View]) -> "Look":
        """One whose near planes follow from the size of what is seen."""
        return cls(splats, pixel, views, np.full(len(views), near_plane(bounds_of(splats))))


def extract(way: str, look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Any, list[RenderedPicture]]:
    """The raw surface of what a Look shows: an open3d TriangleMesh and a picture of each view.

    way: one of WAYS. effort: Effort. vertices: size of the mesh that is wanted in the end. stages: Stages.
    Raises InputError when hardly any surface is found.
    """
    return (_field if way == "field" else _sugar)(look, effort, vertices, stages)


def _field(look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Any, list[RenderedPicture]]:
    with stages.stage("merge"):
        look = merged_look(look)
    splats, pixel, views, near = look
    diagonal = float(np.linalg.norm(np.ptp(bounds_of(splats), axis=0)))
    maps, pictures = [], []
    with stages.stage("depth maps", total=len(views)) as advance:
        for view in views:
            shot = Sighting.taken(splats, view, near[0], LEVEL)
            seen = shot.seen
            maps.append(PlaneMap.from_depth(view, seen.depth, seen.normal, seen.spread, diagonal / 2))
            pictures.append(RenderedPicture.from_render(view, seen.color, seen.depth, shot.thickness))
            advance()
    _require_surface(sum(int(np.isfinite(picture.depth).sum()) for picture in pictures))
    voxel = diagonal / effort.cells
    with stages.stage("fusion", total=len(views)) as advance:
        mesh = fuse(maps, voxel, advance)
    found, finest = len(mesh.vertices), FINEST_CELL * pixel
    if found < vertices and finest < voxel:
        # Larger meshes need smaller voxels, as far as the splat itself resolves them.
        with stages.stage("finer fusion", total=len(views)) as advance:
            mesh = fuse(maps, max(finest, voxel * np.sqrt(found / (SPARE_VERTICES * vertices))), advance)
    return mesh, pictures


def merged_look(look: Look) -> Look:
    """The same with Gaussians that are finer than its views merged, so the work follows what is seen."""
    together = merged_count(len(look.splats), max((view.width * view.height for view in look.views), default=0))
    if together < 2:
        return look
    return look._replace(splats=merged(look.splats.in_spatial_order(), together))


def merged_count(splats: int, pixels: int) -> int:
    """How many of so many splats become one in views of so many pixels."""
    return max(1, int(splats / (PER_PIXEL * pixels))) if pixels else 1


def _sugar(look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Any, list[RenderedPicture]]:
    splats, pixel, views, near = look
    field = DensityField(splats)
    found, pictures = [], []
    with stages.stage("surface points", total=len(views)) as advance:
        for view in views:
            rendering = rasterize(splats, view, float(near[0]))
            covered = np.isfinite(rendering.depth_median).sum() * len(views)
            found.append(surface_points(field, view, rendering, max(1, int(np.sqrt(covered / effort.points)))))
            color = rendering.color / np.maximum(rendering.alpha, 1e-3)[..., None]
            thickness = np.where(np.isfinite(rendering.depth_median), pixel, np.nan)  # unknown: alike everywhere
            pictures.append(RenderedPicture.from_render(view, color, rendering.depth_median, thickness))
            advance()
    points, normals = (np.concatenate([getattr(part, name) for part in found]) for name in ("points", "normals"))
    _require_surface(len(points))
    with stages.stage("Poisson"):
        return poisson(SurfacePoints(points, normals), effort.depth), pictures


def _require_surface(points: int) -> None:
    if points < LEAST_POINTS:
        raise InputError(f"only {points} surface points were found: is this a splat of a solid object?")
