"""The first look at a capture in a new light: its splats, relit by coarse places, and a picture of them.

The captured light is estimated as for a mesh (`albedo.posterior`), of places without bounces of their own.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.capture import Capture
from splat2mesh.pipeline import PICTURED
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import bytes_from_unit, luminance, srgb_from_linear
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.captured_sky import captured_sky
from splat2mesh.surface.carried import NEAREST
from splat2mesh.views.cameras import spread_out
from splat2mesh.views.picture import place_view
from splat2mesh.views.viewpoints import bounds_of, near_plane, picture_view

from ..albedo import natural, posterior
from ..albedo.captured import LEAST_OPEN
from ..albedo.evidence import Evidence
from ..albedo.fitted import FITTED
from ..albedo.refined import refined
from ..albedo.said import Said
from ..albedo.samples import MIN_VISIBLE, SAMPLES
from ..albedo.skylight import LEAST_VISIBLE, exposure_of, seen_sky, visible_part
from ..engine.exposure import exposure_as_captured
from ..light.environment import Environment
from ..light.tonemap import auto_exposure, compress_highlights
from ..options import PICTURE_SIZE
from ..splats.light_ratio import log_gain, relit_sh
from .coarse import LEAST_PLACES, CoarseSurface, coarse_surface, near_splats

FIRST_EYES = 8
"""Standpoints, those that show most, among which that of the picture is chosen."""


class FirstLook(NamedTuple):
    """splats: every row of the file, relit. picture: (H, W, 3) uint8 sRGB. exposure: display units per radiance."""

    splats: Splats
    picture: NDArray[np.uint8]
    exposure: float


class CapturedDay(NamedTuple):
    """A capture and the light it stood in, ready for any new one. before: (N, 3) light at places, in units of the
    colours. brightness: mean luminance of the light. nearest, weights: (S, k) places of each Gaussian."""

    capture: Capture
    surface: CoarseSurface
    before: NDArray[np.float64]
    brightness: float
    nearest: NDArray[np.int64]
    weights: NDArray[np.float64]
    view: View

    @classmethod
    def of(cls, capture: Capture, said: Said, known: Environment | None = None, seed: int = 0) -> "CapturedDay":
        """Estimate the light of a Capture. said: what a person says of it. known: the light itself, but for its
        exposure. Raises InputError for a capture without a first look."""
        surface = coarse_surface(capture, seed)
        if surface.visible.mean() < LEAST_OPEN:
            raise InputError("it is closed, and its light comes through windows, which its mesh shows")
        witnesses = np.flatnonzero(surface.visible > MIN_VISIBLE)
        if len(witnesses) < LEAST_PLACES:
            raise InputError("too little of it sees the sky")
        some = witnesses[:: -(-len(witnesses) // SAMPLES)]
        light = _captured_light(capture, _taken(surface, some), said, known)
        before = surface.turned_light(light) + surface.bounced
        brightness = float(luminance(light.mean(axis=0)))
        nearest, weights = _beside(capture, surface)
        return cls(capture, surface, before, brightness, nearest, weights, _view(capture, surface))

    def under(self, light: Environment, exposure: float | None = None) -> FirstLook:
        """The capture in a new light, at an exposure or at that of the capture's camera."""
        surface, capture = self.surface, self.capture
        radiance = _around(light, surface.directions)
        direct = surface.turned_light(radiance)
        albedo = np.clip(surface.captured / np.maximum(self.before, 1e-6), 0.02, 0.95)
        hidden = 1.0 - np.minimum(surface.visible, 1.0)
        after = direct + hidden[:, None] * (albedo * direct).mean(axis=0)
        if exposure is None:
            exposure = exposure_as_captured(self.brightness, surface.captured, light, auto_exposure(albedo * after))
        logs, mean = log_gain(surface.captured, self.before, after * exposure)
        changed = np.tile(mean, (len(capture.loaded), 1))
        rows = capture.rows[~capture.far]
        changed[rows] = np.einsum("sk,skc->sc", self.weights, logs[self.nearest])
        relit = replace(capture.loaded, sh=relit_sh(capture.loaded.sh, changed, mean))
        return FirstLook(relit, self._picture(relit.take(rows), light, exposure), exposure)

    def _picture(self, relit: Splats, light: Environment, exposure: float) -> NDArray[np.uint8]:
        seen = rasterize(relit, self.view, near_plane(bounds_of(self.capture.foreground)))
        ways = self.view.ray_directions().reshape(-1, 3) @ self.capture.rotation[:3, :3].T
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        sky = srgb_from_linear(compress_highlights(light.lookup(ways) * np.float32(exposure)))
        image = np.clip(seen.color, 0.0, 1.0) + (1.0 - seen.alpha[..., None]) * sky.reshape(seen.color.shape)
        return bytes_from_unit(image.astype(np.float32))


def _captured_light(
    capture: Capture, surface: CoarseSurface, said: Said, known: Environment | None
) -> NDArray[np.float64]:
    """Radiance (K, 3) of the captured light."""
    eyes = [eye.center for eye in capture.standing.eyes] or [view.center for view in capture.trained]
    sky = captured_sky(capture.splats, capture.far, capture.rotation, np.mean(eyes, axis=0) if eyes else None)
    if sky is not None and visible_part(sky) < LEAST_VISIBLE:
        sky = None
    evidence = Evidence(surface.lit, None if sky is None else seen_sky(sky, surface.directions), FITTED)
    if known is not None:
        radiance = np.maximum(_around(known, surface.directions), 1e-9)
        measured = None if sky is None or known.exposed else exposure_of(sky, known)
        factor = 1.0 if known.exposed else measured or np.exp(evidence.lacking(np.log(radiance)))
        return np.asarray(factor * radiance)
    kind = said.sky if isinstance(said.sky, str) else None
    lights = posterior.lights_of(evidence, natural.natural_light(kind), said.sun)
    return posterior.mean_radiance(refined(evidence, lights), surface.directions)


def _taken(surface: CoarseSurface, rows: NDArray[np.int64]) -> CoarseSurface:
    """Some of the places."""
    of_places = ("points", "normals", "captured", "sky", "bounced")
    return surface._replace(**{name: getattr(surface, name)[rows] for name in of_places})


def _around(light: Environment, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(K, 3) mean radiance around each of the directions, which share the sphere: suns lose nothing."""
    height = 256
    texels = texel_directions(height, 2 * height).reshape(-1, 3)
    areas = np.repeat(row_solid_angles(height, 2 * height).ravel(), 2 * height)
    owner = scipy.spatial.cKDTree(directions).query(texels, workers=-1)[1]
    radiance = light.lookup(texels).astype(np.float64)
    sums = [np.bincount(owner, areas * column, len(directions)) for column in radiance.T]
    return np.stack(sums, axis=1) / np.bincount(owner, areas, len(directions))[:, None]


def _beside(capture: Capture, surface: CoarseSurface) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places near each Gaussian that is not far, (S, k), and their weights, which sum to 1."""
    near = near_splats(capture)
    distance, nearest = scipy.spatial.cKDTree(surface.points).query(near.means, NEAREST, workers=-1)
    shortest = near.scales.argmin(axis=1)
    axes = np.take_along_axis(near.rotation_matrices(), shortest[:, None, None], axis=2)[:, :, 0]
    agree = np.abs(
        np.einsum("sc,skc->sk", axes, (surface.normals @ capture.rotation[:3, :3])[nearest].astype(np.float32))
    )
    weights = np.exp(-((distance / np.maximum(distance[:, 2:3], 1e-12)) ** 2)) * (0.05 + agree**2)
    return nearest, weights / weights.sum(axis=1, keepdims=True)


def _view(capture: Capture, surface: CoarseSurface) -> View:
    """The camera of the picture: where the final one is likely to stand."""
    up, standing = capture.rotation[1, :3], capture.standing
    if standing.kind == "outside":
        return picture_view(capture.foreground, up).resized(PICTURE_SIZE[0])
    trained = spread_out(capture.trained, PICTURED)
    eyes = standing.eyes[:FIRST_EYES]
    return place_view(surface.points, lambda view: _depth(surface, view), eyes, trained, up).resized(PICTURE_SIZE[0])


def _depth(surface: CoarseSurface, view: View) -> Floats:
    """Camera z of what stops rays of a view, (H, W) float32; infinite where nothing does."""
    ways = view.ray_directions().reshape(-1, 3)
    length = np.linalg.norm(ways, axis=1)
    distance = surface.grid.march(view.center[None], ways / length[:, None])[0][0]
    return (distance / length).reshape(view.height, view.width)
