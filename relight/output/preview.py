"""Render a relit scene in front of its environment, off screen, by ray casting on the CPU."""

import copy
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import GOLDEN_TURN
from splat2mesh.render.raycaster import RayCaster, corner_weights
from splat2mesh.render.view import View
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.views.viewpoints import OUTER_FOV_DEG, picture_elevation

from ..light.tonemap import compress_highlights
from ..transfer.occluder import BATCH_RAYS
from .mesh_files import check_radiance

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene
    from splat2mesh.texture.atlas import Atlas

    from ..light.environment import Environment


_AZIMUTH = np.radians(30.0)  # three-quarter view: from +z, turned towards +x
NOWHERE = 1e10
"""Depth of rays without a hit: far beyond any scene, and a number that all programs read."""


class Preview:
    """A camera in front of a scene. Its rays are cast once, for pictures under any number of lights.

    The scene shows its vertices' radiance on both sides of a face; where a ray misses it, the environment shows, sharp
    and at the same exposure. `camera`, a dict of eye, target, up ((3,) scene frame) and horizontal fov_deg, is the one
    in use: the given one, the scene's or `default_camera`. `view` is it as a View, `caster` the RayCaster of the scene.
    Raises InputError for an impossible camera or picture size.
    """

    def __init__(
        self, scene: "Scene", camera: dict | None = None, width: int = 960, height: int = 720, samples: int = 4
    ) -> None:
        if min(width, height, samples) < 1:
            raise InputError(
                f"a picture needs at least 1 x 1 pixels and 1 sample; found {width} x {height} and {samples}"
            )
        self.camera = camera or scene.preview_camera or default_camera(scene, width / height)
        self._scene, self._faces = scene, scene.faces
        self.view, self._samples = _view(self.camera, width, height), samples

    @cached_property
    def caster(self) -> RayCaster:
        """The RayCaster of the scene."""
        return RayCaster(self._scene.vertices, self._faces)

    @cached_property
    def _passes(self) -> list[tuple]:
        """For bands of rows at each sample position: rows, View, the rays that hit, (H * W,) bool, and for these
        P the face, (P,) int32, and the barycentric weights of its corners, (P, 3) float32."""
        found = []
        for rows, view in _split(self.view, self._samples):
            directions = _directions(view)
            rays = np.empty((len(directions), 6), np.float32)
            rays[:, :3], rays[:, 3:] = view.center, directions
            hits = self.caster.first_hits(rays)
            hit = hits.faces >= 0
            found.append((rows, view, hit, hits.faces[hit], corner_weights(hits.uv[hit])))
        return found

    def render(self, radiance: NDArray, environment: "Environment", exposure: float = 1.0) -> NDArray:
        """The picture under one light: (H, W, 3) uint8 sRGB.

        radiance: (V, 3) linear. environment: what shows behind. exposure: display value per unit of
        radiance. Samples are averaged after their highlights are compressed: edges before a sun stay smooth.
        """
        radiance = check_radiance(self._scene, radiance) * np.float32(exposure)
        image = np.zeros((self.view.height, self.view.width, 3), np.float32)
        for rows, view, hit, faces, weights in self._passes:
            color = np.empty((len(hit), 3), np.float32)
            color[hit] = np.einsum("pk,pkc->pc", weights, radiance[self._faces[faces]])
            color[~hit] = environment.lookup(_directions(view)[~hit]) * np.float32(exposure)
            image[rows] += compress_highlights(color).reshape(image[rows].shape)
        return bytes_from_unit(srgb_from_linear(image / self._samples))

    def at(self, view: View) -> "Preview":
        """The same scene seen by another View in its frame; what the camera does not change is shared."""
        other = copy.copy(self)
        vars(other).pop("_passes", None)
        other.view = view
        other.caster = self.caster
        return other

    def values(self, of_vertices: NDArray) -> tuple[NDArray, NDArray]:
        """Values of vertices (V, 3) as a picture, (H, W, 3) float32, premultiplied, and how much of each pixel the
        scene covers, (H, W) float32."""
        values = np.asarray(of_vertices, np.float32)
        return self._layer(lambda faces, weights: np.einsum("pk,pkc->pc", weights, values[self._faces[faces]]))

    def depth(self) -> NDArray[np.float32]:
        """Camera z of the nearest point of each pixel, (H, W) float32, unit of the scene; NOWHERE where none is."""
        image = np.full((self.view.height, self.view.width), NOWHERE, np.float32)
        origin, forward = self.view.center, self.view.forward
        for rows, _, hit, faces, weights in self._passes:
            found = np.full(len(hit), NOWHERE, np.float32)
            points = np.einsum("pk,pkc->pc", weights, self._scene.vertices[self._faces[faces]]) - origin
            found[hit] = points @ forward
            image[rows] = np.minimum(image[rows], found.reshape(image[rows].shape))
        return image

    def layer(self, radiance: NDArray, exposure: float = 1.0) -> tuple[NDArray, NDArray]:
        """The scene alone: display-linear colour (H, W, 3) float32, premultiplied, and how much of each pixel it
        covers, (H, W) float32."""
        shown = compress_highlights(check_radiance(self._scene, radiance) * np.float32(exposure))
        return self._layer(lambda faces, weights: np.einsum("pk,pkc->pc", weights, shown[self._faces[faces]]))

    def texture_layer(self, atlas: "Atlas", image: NDArray) -> tuple[NDArray, NDArray]:
        """The same of the scene in its texture: image (size, size, 3) uint8 sRGB, as `Baked.relit` makes it."""
        texels = linear_from_srgb(image.astype(np.float32) / np.float32(255.0))

        def color(faces: NDArray, weights: NDArray) -> NDArray:
            uv = np.einsum("pk,pkc->pc", weights, atlas.uv[atlas.faces[faces]])
            return bilinear(texels, uv * np.float32(atlas.size) - np.float32(0.5))

        return self._layer(color)

    def _layer(self, color: Callable[[NDArray, NDArray], NDArray]) -> tuple[NDArray, NDArray]:
        """A layer of what the rays hit: `color` of faces (P,) at barycentric weights (P, 3), (P, 3) linear."""
        image = np.zeros((self.view.height, self.view.width, 4), np.float32)
        for rows, _, hit, faces, weights in self._passes:
            layer = np.zeros((len(hit), 4), np.float32)
            layer[hit, :3] = color(faces, weights)
            layer[hit, 3] = 1.0
            image[rows] += layer.reshape(image[rows].shape)
        image /= np.float32(self._samples)
        return image[..., :3], image[..., 3]


def bilinear(image: NDArray, places: NDArray) -> NDArray:
    """Values (P, C) of an image (H, W, C) at places (P, 2), column and row; pixel centres are whole numbers."""
    height, width = image.shape[:2]
    column, row = np.clip(places, 0.0, [width - 1, height - 1]).astype(np.float32).T
    left, top = np.minimum(column.astype(np.int32), width - 2), np.minimum(row.astype(np.int32), height - 2)
    right, low = (column - left)[:, None], (row - top)[:, None]
    above = image[top, left] * (1.0 - right) + image[top, left + 1] * right
    below = image[top + 1, left] * (1.0 - right) + image[top + 1, left + 1] * right
    return above * (1.0 - low) + below * low


def default_camera(scene: "Scene", aspect: float = 4 / 3) -> dict:
    """A three-quarter view from slightly above, on the +z side, that just holds every vertex of the scene.

    aspect: width / height of the picture. Returns a dict of eye, target, up (lists, scene frame) and fov_deg.
    """
    elevation = picture_elevation(scene.vertices, np.array([0.0, 1.0, 0.0]))
    level = np.cos(elevation)
    backward = [np.sin(_AZIMUTH) * level, np.sin(elevation), np.cos(_AZIMUTH) * level]
    way = View.look_at(backward, np.zeros(3), [0.0, 1.0, 0.0], OUTER_FOV_DEG, 1200, round(1200 / aspect))
    view = way.holding(scene.vertices)
    return {
        "eye": view.center.tolist(),
        "target": (view.center + view.forward * scene.diagonal).tolist(),
        "up": [0.0, 1.0, 0.0],
        "fov_deg": OUTER_FOV_DEG,
    }


def _view(camera: dict[str, Any], width: int, height: int) -> View:
    try:
        eye, target, up = (np.array(camera[name], np.float64).reshape(3) for name in ("eye", "target", "up"))
        fov_deg = float(camera["fov_deg"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"a camera needs eye, target, up (3 numbers each) and fov_deg; found {camera}") from error
    finite = np.isfinite([eye, target, up]).all()
    if not (finite and np.any(eye != target) and np.any(up) and 0.0 < fov_deg < 180.0):
        raise InputError(f"a camera needs eye apart from target, an up and fov_deg between 0 and 180; found {camera}")
    return View.look_at(eye, target, up, fov_deg, width, height)


def _split(view: View, samples: int) -> Iterator[tuple[slice, View]]:
    """Yield (rows, View) for bands of rows, once for each sample position within the pixel.

    The positions are a Kronecker lattice: whatever their number, no two share a column or a row, and their
    mean is the pixel's centre.
    """
    step = np.arange(samples) - 0.5 * (samples - 1)
    offsets = np.stack([step / samples, (step * GOLDEN_TURN + 0.5) % 1.0 - 0.5], axis=1)
    band = max(1, BATCH_RAYS // view.width)
    for top in range(0, view.height, band):
        rows = slice(top, min(top + band, view.height))
        for dx, dy in offsets:
            yield rows, replace(view, height=rows.stop - top, cx=view.cx - dx, cy=view.cy - top - dy)


def _directions(view: View) -> NDArray[np.float32]:
    """Unit directions through the pixel centres of a View: (H * W, 3) float32."""
    directions = view.ray_directions().reshape(-1, 3).astype(np.float32)
    return directions / np.sqrt(np.einsum("ij,ij->i", directions, directions))[:, None]
