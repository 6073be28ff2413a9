"""The texture of a scene: an atlas that is as fine as the splats at each place, coloured from views."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb
from ..base.progress import Stages
from ..base.threads import ROWS_AT_ONCE
from ..scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from ..scene.scene import Scene
from ..surface.album import TOLERANCE_OBJECT
from ..surface.extract import Look, training_pixel
from ..views.picture import mesh_depth
from .atlas import Atlas, atlas_of, check_size, face_areas, surface_area, welded
from .charts import GUTTER, charts_of
from .density import local_pixel
from .projection import Pictures

SMALLEST_SIZE, LARGEST_SIZE = 256, 4096
"""Sides of a texture that `auto` chooses among, powers of two: 4096 is what every engine takes without asking."""

LEAST_SCALE = 0.8
"""Texels over those wanted, along a length, with which a smaller texture does."""

PIXELS, MOST_PIXELS = (256, 768), 50_000_000
"""Range of the side of a picture, and how many pixels all pictures may have: 7 bytes each."""

FINER = 2.0
"""Pixels of a picture along a texel at the typical distance: most of a place is nearer to some view."""

NEARNESS_PLACE, NEARNESS_OBJECT = 1.0, 0.0
"""How the distance of a view counts: in a place far views are coarse, around an object all are alike. PSNR of a
trained garden and a parlour, at 0, 1, 2, 4, 8: 26.6, 27.8, 27.7, 27.1, 26.6 and 33.3, 32.8, 32.2, 31.1, -. The nearest
view alone is sharper, and further from what other eyes see."""

TOLERANCE_PLACE = 0.03
"""Where a pixel shows something further before or behind a texel, it shows another surface, in units of the distance.
Objects, whose strings and handles stand close to them, have TOLERANCE_OBJECT, in units of the radius."""

COARSE = 3.0
"""Training pixels that the depth of an object may be off at least: that of a pixel is that of the middle of a splat."""


@dataclass(frozen=True)
class Texture:
    """A scene in colours that are finer than its vertices.

    scene: Scene whose chunks the atlas holds, those of the background last. atlas: Atlas. colors: (T, 3) uint8 sRGB of
    its texels. unseen: number of texels that no view shows; they have the colours of the vertices. scale: texels over
    those that the capture asks for, along a length.
    """

    scene: Scene
    atlas: Atlas
    colors: ColorsSrgb
    unseen: int
    scale: float


def with_background(scene: Scene) -> Scene:
    """The Scene whose chunks are all that the capture shows, its background last."""
    return replace(scene, chunks=[*scene.chunks, *scene.background], background=[])


def texture_of(
    scene: Scene,
    looks: Sequence[Look],  # what shows it; without any, texels have the colours of vertices
    size: int | None = None,  # side in texels; None: as fine as the splats, without any a texel for half an edge
    stages: Stages | None = None,
    background: bool = True,
) -> Texture:
    """The Texture of a Scene, with or without its background, from views of its splats. Raises InputError for a size
    out of range and a surface without an area."""
    stages = stages or Stages()
    scene = with_background(scene) if background else replace(scene, background=[])
    with stages.stage("unwrap"):
        mesh = welded(scene)
        surface_area(mesh)  # there is one
        back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
        unit = float(np.cbrt(abs(np.linalg.det(back[:3, :3]))))
        points = mesh.nodes[:, :3] @ back[:3, :3].T + back[:3, 3]
        corners = points[mesh.corners]
        pixel = (
            local_pixel(looks[0].splats, points, mesh.corners) if looks else np.full(len(corners), _edge(corners) / 2)
        )
        if size is not None:  # the charts fill the square
            pixel *= min(1.0, np.sqrt((face_areas(points, mesh.corners) / pixel**2).sum()) / check_size(size))
        charts = charts_of(mesh.nodes[:, :3], mesh.corners, unit / pixel)
        side, packed = SMALLEST_SIZE, None
        while size is None and side < LARGEST_SIZE and packed is None:
            packed = charts.packed(side, LEAST_SCALE)
            side *= 1 if packed else 2
        side = side if size is None else check_size(size)
        uv, scale = packed or charts.packed(side) or (charts.across, 0.0)
        atlas = atlas_of(scene, mesh, uv, charts.faces, side, GUTTER + 0.5)
    if not looks:
        shown = atlas.interpolate(linear_from_srgb(scene.colors_srgb / np.float32(255.0)))
        return Texture(scene, atlas, bytes_from_unit(srgb_from_linear(shown)), 0, scale)
    with stages.stage("texture views"):
        views = [view for look in looks for view in look.views]
        focal = float(np.median([view.fx / max(view.width, view.height) for view in views]))
        wanted = FINER * _typical_depth(scene, views, back) / (focal * atlas.texel_size * unit)
        pixels = int(np.clip(min(wanted, np.sqrt(MOST_PIXELS / len(views))), *PIXELS))
        tolerance, surface = (TOLERANCE_PLACE, 0.0), None
        if not scene.is_place:  # a place would be no faster, and a trained garden lost .6% of its texels
            radius, coarse = 0.5 * scene.diagonal * unit, COARSE * training_pixel(looks[0].splats)
            tolerance = (0.0, max(TOLERANCE_OBJECT * radius, coarse))
            surface = mesh_depth(points, mesh.corners)
        pictures = Pictures.of(looks, pixels, surface, tolerance)
    with stages.stage("texels"):
        colors, unseen = _colors(scene, atlas, pictures, back, tolerance)
    return Texture(scene, atlas, colors, unseen, scale)


def _edge(corners: NDArray[np.float64]) -> float:
    """Median length of an edge of faces (F, 3, 3)."""
    return float(np.median(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)))


def _typical_depth(scene: Scene, views: Sequence, back: NDArray[np.float64]) -> float:
    """Median distance of the surface from the views, in the frame of the splats."""
    points = scene.vertices[:: max(1, len(scene.vertices) // 1000)] @ back[:3, :3].T + back[:3, 3]
    return float(np.median([np.linalg.norm(points - view.center, axis=1) for view in views]))


def _colors(
    scene: Scene, atlas: Atlas, pictures: Pictures, back: NDArray[np.float64], tolerance: tuple[float, float]
) -> tuple[NDArray[np.uint8], int]:
    nearness = NEARNESS_PLACE if scene.is_place else NEARNESS_OBJECT
    points, vertex = scene.vertices @ back[:3, :3].T + back[:3, 3], scene.colors_srgb
    normals = scene.normals @ np.asarray(scene.scene_from_splat, np.float64)[:3, :3]  # by the inverse transpose
    colors, unseen = np.empty((len(atlas.texels), 3), np.uint8), 0
    for start in range(0, len(colors), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        local = atlas.interpolate(normals.astype(np.float32), rows)
        local /= np.maximum(np.linalg.norm(local, axis=1, keepdims=True), 1e-30)
        found, seen = pictures.shown(atlas.interpolate(points.astype(np.float32), rows), local, nearness, tolerance)
        found[~seen] = atlas.interpolate(vertex.astype(np.float32), rows)[~seen]
        colors[rows] = bytes_from_unit(found / np.float32(255.0))
        unseen += int((~seen).sum())
    return colors, unseen
