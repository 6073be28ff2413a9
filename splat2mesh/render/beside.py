"""A splat and the mesh made from it, side by side, to judge a conversion at a glance."""

import numpy as np

from ..base.arrays import ColorsSrgb, Floats
from ..scene.color import bytes_from_unit
from ..scene.mesh import Mesh
from ..splats.splats import Splats
from .rasterize import rasterize
from .raycaster import RayCaster
from .view import View

WIDTH = 640
"""Pixels of each of the two pictures."""

FINE = 2
"""Samples of the mesh along a pixel's side."""

BACKGROUND = 0.2
"""Display value behind both."""


def beside(splats: Splats, mesh: Mesh, view: View, near: float) -> ColorsSrgb:
    """The picture, (H, 2 W, 3) uint8 sRGB: the splats on the left, the colours of the mesh on the right. splats:
    Splats. mesh: Mesh in their frame. view: View. near: camera z of the near plane of the splats."""
    view = view.resized(WIDTH)
    seen = rasterize(splats, view, near)
    left = seen.color + (1.0 - seen.alpha[..., None]) * BACKGROUND
    return bytes_from_unit(np.concatenate([left, _drawn(mesh, view)], axis=1))


def _drawn(mesh: Mesh, view: View) -> Floats:
    """The colours of a mesh, (H, W, 3) float32 sRGB, as vertices have them."""
    fine = view.resized(FINE * WIDTH)
    rays = fine.ray_directions()
    rays = np.concatenate([np.broadcast_to(view.center, rays.shape), rays], axis=-1)
    hits = RayCaster(mesh.vertices, mesh.faces).first_hits(rays)
    hit = hits.faces >= 0
    second, third = hits.uv[hit].T
    weights = np.stack([1.0 - second - third, second, third], axis=1)
    image = np.full((*hit.shape, 3), BACKGROUND, np.float32)
    corners = mesh.colors_srgb[mesh.faces[hits.faces[hit]]].astype(np.float32) / 255.0
    image[hit] = np.einsum("nk,nkc->nc", weights, corners)
    return image.reshape(view.height, FINE, view.width, FINE, 3).mean(axis=(1, 3))
