"""Two methods from a splat and views of it to a raw surface, behind one function.

field   depth maps at a level of the opacity field, fused into a signed distance field: the default, more accurate.
sugar   points on a level of the density field, Poisson: the method of the SuGaR paper, kept for comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from ..base.arrays import Faces, Floats, Points
from ..base.calibration import NOT_RECORDED, Provenance
from ..base.errors import InputError
from ..base.progress import Stages
from ..render.footprints import DILATION as TRAINING_DILATION
from ..render.opacityfield import FieldDepth
from ..render.opacitygrid import SCALES_PER_PIXEL
from ..render.rasterize import rasterize
from ..render.view import View
from ..splats.merging import merged
from ..splats.splats import Splats
from ..views.viewpoints import bounds_of, near_plane
from .adaptive import SLABS, fuse_adaptively
from .album import Album
from .sight import SHARP as SHARP_IN_PLACE
from .sight import FusionSight, Sighting
from .sugar import DensityField, SurfacePoints, poisson, surface_points


@dataclass(frozen=True)
class LevelCalibration:
    """The opacity at which the surface of an object lies, by the median thickness of its surfaces. thicknesses: in
    training pixels. levels: the opacity at each; between them it is interpolated, outside held."""

    provenance: ClassVar = Provenance(
        script="scripts/bench surface",
        fitted_on="spot and tabletop, two trained scenes with true meshes (docs/surface.md)",
        held_out=NOT_RECORDED,
    )

    thicknesses: tuple[float, float] = (0.7, 1.5)
    levels: tuple[float, float] = (0.38, 0.5)


LEVEL = LevelCalibration()

PROBES, PROBE_PIXELS = 12, 128
"""Views, and their pixels, in which the thickness is measured."""

FINEST_CELL = 0.7
"""Least side of a cell in training pixels: there is nothing finer in a splat."""

SHARP = 0.5
"""Spread of an object's surface, over the typical thickness at its distance, at which its weight is halved."""

ENOUGH_WEIGHT = 0.03
"""Sum of weights that its surface needs: with less, undersides that no camera saw come too; with more, dark gloss
becomes a sieve."""

SPARE_VERTICES = 1.3
"""Vertices of a raw surface over those wanted, where it is made again for a larger mesh."""


PER_PIXEL, SIDES_SEEN = 0.5, 3.0
"""Gaussians for each pixel of the surface in views of it, beyond which they are merged; and pixels of a surface in all,
over those of one view."""


@dataclass(frozen=True)
class Effort:
    """The amount of work for a surface. views: rendered views, of `pixels` along the longer side. depth: octree levels
    (sugar). points: surface points aimed at (sugar)."""

    views: int
    pixels: int
    depth: int
    points: int


EFFORTS = {
    "draft": Effort(views=32, pixels=256, depth=8, points=200_000),
    "normal": Effort(views=64, pixels=320, depth=9, points=500_000),
    "fine": Effort(views=96, pixels=448, depth=10, points=1_500_000),
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


class Probed(NamedTuple):
    """What a few views show of surfaces. thickness: their median one, world units. fog: the median of that over their
    distance. distance: their median one."""

    thickness: float
    fog: float
    distance: float

    @classmethod
    def of(cls, look: Look) -> "Probed":
        """By PROBES of the views, spread evenly: several may stand at one place and look another way each. Raises
        InputError for hardly any surface."""
        views, near = look.views, look.near
        rows = np.unique(np.arange(PROBES) * len(views) // PROBES)[: len(views)]
        shots = [Sighting.taken(look.splats, views[row].resized(PROBE_PIXELS), near[row]) for row in rows]
        thickness = np.concatenate([[], *(shot.thickness.ravel() for shot in shots)])
        depth = np.concatenate([[], *(shot.seen.depth.ravel() for shot in shots)])
        thickness, depth = thickness[np.isfinite(thickness)], depth[np.isfinite(thickness)]
        require_surface(len(depth))
        return cls(*(float(np.median(each)) for each in (thickness, thickness / depth, depth)))


def surface_level(probed: Probed, pixel: float) -> float:
    """The opacity at which the surface of a splat lies, by how thick its surfaces are in training pixels.

    The Gaussians of a thin surface reach in front of it and are crossed early; where they pile up loosely, the surface
    lies nearer to their middle. Calibrated on trained scenes with true meshes: see docs/surface.md.
    """
    return float(np.interp(probed.thickness / pixel, LEVEL.thicknesses, LEVEL.levels))


def extract(way: str, look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Points, Faces, Album]:
    """The raw surface of what a Look shows: points (V, 3) float64, faces (F, 3) int32, and the pictures of its views.

    way: one of WAYS. effort: Effort. vertices: size of the mesh that is wanted in the end. stages: Stages.
    Raises InputError when hardly any surface is found.
    """
    return (_field if way == "field" else _sugar)(look, effort, vertices, stages)


def _field(look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Points, Faces, Album]:
    with stages.stage("merge"):
        look = merged_look(look)
    probed, finest, views = Probed.of(look), FINEST_CELL * look.pixel, look.views
    sights, album = developed(look, probed, surface_level(probed, look.pixel), stages, SHARP * probed.fog)
    middle = np.mean([view.center for view in views], axis=0)
    with stages.stage("fusion", total=SLABS) as advance:
        points, faces, _ = fuse_adaptively(sights, middle, advance, ENOUGH_WEIGHT)
    if len(points) < vertices:
        # Larger meshes need smaller cells, as far as the splat itself resolves them.
        smaller = np.float32(np.sqrt(len(points) / (SPARE_VERTICES * vertices)))
        sights = [replace(each, step=np.maximum(smaller * each.step, np.float32(finest))) for each in sights]
        with stages.stage("finer fusion", total=SLABS) as advance:
            points, faces, _ = fuse_adaptively(sights, middle, advance, ENOUGH_WEIGHT)
    return points, faces, album


def developed(
    look: Look, probed: Probed, level: float, stages: Stages, sharp: float = SHARP_IN_PLACE
) -> tuple[list[FusionSight], Album]:
    """What the views of a Look show at a level of opacity, for fusion and as pictures. sharp: as of `FusionSight.of`.
    Raises InputError for hardly any surface."""
    sights, pictures = [], []
    with stages.stage("depth maps", total=len(look.views)) as advance:
        for view, plane in zip(look.views, look.near, strict=True):
            shot = Sighting.taken(look.splats, view, plane, level)
            sights.append(FusionSight.of(shot, probed.distance, FINEST_CELL * look.pixel, probed.fog, sharp))
            pictures.append(Album.of([shot]))
            advance()
    album = Album.joined(pictures)
    require_surface(int(np.isfinite(album.depth).sum()))
    return sights, album


def merged_look(look: Look) -> Look:
    """The same with Gaussians that are finer than its views merged, so the work follows what is seen. A surface is seen
    in a third of the views or so, so its pixels are about three times those of one view."""
    seen = SIDES_SEEN * max((view.width * view.height for view in look.views), default=0)
    together = int(len(look.splats) / (PER_PIXEL * seen)) if seen else 1
    if together < 2:
        return look
    return look._replace(splats=merged(look.splats.in_spatial_order(), together))


def _sugar(look: Look, effort: Effort, vertices: int, stages: Stages) -> tuple[Points, Faces, Album]:
    splats, pixel, views, near = look
    field = DensityField(splats)
    found, pictures = [], []
    with stages.stage("surface points", total=len(views)) as advance:
        for view in views:
            rendering = rasterize(splats, view, float(near[0]))
            covered = np.isfinite(rendering.depth_median).sum() * len(views)
            found.append(surface_points(field, view, rendering, max(1, int(np.sqrt(covered / effort.points)))))
            color = rendering.color / np.maximum(rendering.alpha, 1e-3)[..., None]
            depth = rendering.depth_median
            thickness = np.where(np.isfinite(depth), np.float32(pixel), np.float32(np.nan))  # unknown: alike everywhere
            seen = FieldDepth(depth, np.zeros_like(color), thickness, color.astype(np.float32), rendering.alpha)
            pictures.append(Album.of([Sighting(view, seen, thickness)]))
            advance()
    points, normals = (np.concatenate([getattr(part, name) for part in found]) for name in ("points", "normals"))
    require_surface(len(points))
    with stages.stage("Poisson"):
        mesh = poisson(SurfacePoints(points, normals), effort.depth)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int32), Album.joined(pictures)


def require_surface(points: int) -> None:
    """Raises InputError for hardly any points of a surface."""
    if points < 100:
        raise InputError(f"only {points} surface points were found: is this a splat of something solid?")
