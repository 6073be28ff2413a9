"""The sky of a relit splat: its far background shows the new environment, stays as it was, or goes.

Far splats are a picture of the light of the capture day. Each takes the radiance that arrives from its direction, as
seen from the middle of the scene, and no longer depends on the view. Lawns, hedges and houses are far away too:
they are no sky, and take the change of light of the mesh's edge.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Indices, Mask, Points, Vector
from splat2mesh.base.errors import InputError
from splat2mesh.base.quantiles import weighted_quantile
from splat2mesh.scene.color import linear_from_srgb, luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

from ..albedo.seen import standing
from ..light import SKIES
from ..light.captured import CapturedLight
from ..light.tonemap import tone_map
from ..transfer.store import Cache, array_key
from .attachment import FAR
from .hanging_sky import VOTES, FromMiddle, hanging_sky
from .light_ratio import CURVE_POWER, LEAST, MOST, relit_sh

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..light.environment import Environment
    from .floor_mirror import FloorMirror

BELOW, HIGH = np.sin(np.radians((-3.0, 8.0)))
"""Sine of the elevation below which nothing is sky, and above which far splats show mostly sky: its brightness is read
there. These numbers and those below were chosen by eye on a trained garden and three generated places."""

DARK, LEVEL = 0.12, 0.75
"""Part of the sky's luminance below which a far splat is a surface whatever its hue, and the quantile of the high
splats that gives that luminance: surfaces reflect a part of the light of the sky, and clouds are darker than it, but
not by so much."""

GREEN, GREEN_PART, WARM, WARM_PART = 0.06, 0.8, 0.12, 0.6
"""Excess of green over red and blue, and of red over blue, in sRGB, of leaves and of bricks, and parts of the sky's
luminance below which they are that, and not a sky at evening."""

NEAR_PART = 0.4
"""Share of the sky's usual distance below which a splat is a surface. A sky has no parallax, so training puts it
far."""

ROUGH = 0.21
"""Spread of brightness, in sRGB, among that many neighbours in direction, above which half of what looks like sky is
none: pale facades with their windows have .26, in the one capture whose background is towers without a sky. Thirteen
skies have up to .16."""


def shown_as_sky(
    splats: Splats,
    scene: Scene,
    appearance: "Appearance",
    mirror: "FloorMirror | None" = None,
    cache: Cache | None = None,  # of the scene
) -> Indices:
    """Rows (M,) of these Splats of a Scene that show the sky: of the far background, and of what hangs in the air
    before it, also near surfaces where it is known from where the capture looked. In the windows of a closed room, and
    where all stays as captured, all of the background. What lies below a floor that mirrors shows the room."""
    rows = scene.background_splats
    indoors = appearance.room is not None or appearance.as_captured
    if not indoors and len(rows):
        rows = _kept_rows(splats, rows, scene, Cache() if cache is None else cache)
    return rows if mirror is None else mirror.spared(rows)


def _kept_rows(splats: Splats, rows: Indices, scene: Scene, cache: Cache) -> Indices:
    """`sky_rows` of a Scene, from its Cache where they are known."""
    shown = splats.means, splats.scales, splats.opacities, splats.sh[:, 0]
    eyes = standing(scene)
    key = array_key(*shown, rows, np.asarray(scene.scene_from_splat, np.float64), eyes)

    def restored(kept: Mapping[str, NDArray[Any]]) -> Indices:
        found = kept["rows"]
        if found.dtype != rows.dtype or found.ndim != 1:
            raise InputError("kept rows of the sky are of another kind")
        if len(found) and not 0 <= found.min() <= found.max() < len(splats):
            raise InputError("kept rows of the sky are of other splats")
        return found

    found = cache.restored(restored, "sky", key)
    if found is None:
        found = sky_rows(splats, rows, scene.scene_from_splat, scene.vertices, eyes)
        cache.put("sky", key, rows=found)
    return found


def sky_rows(
    splats: Splats,  # Splats as captured, every row of the source
    rows: Indices,  # (M,) which of them are far background
    scene_from_splat: ArrayLike,  # (4, 4)
    vertices: Points | None = None,  # (V, 3) of the mesh, scene frame
    eyes: Points | None = None,  # (E, 3) where the capture stood, scene frame
) -> Indices:
    """Which of the far background is sky and not a surface far away: (K,) of its rows, in their order.

    Where the mesh is given, rows of other splats follow: those that look like sky, are about as far away, and lie
    nowhere near the mesh. Training leaves some of a sky nearer than the rest. Where there are eyes, those follow that
    hang before it at any distance. There are none where most of the background is rough, as facades are.
    """
    some = splats.take(rows)
    others = np.delete(np.arange(len(splats)), rows)
    others = others[np.isfinite(splats.means[others]).all(axis=1)]
    if not np.isfinite(some.means).all(axis=1).any() or not len(others):
        return rows
    matrix = np.asarray(scene_from_splat, np.float64)
    backdrop = backdrop_of(some, np.median(splats.means[others], axis=0), matrix[1, :3])
    shown = is_sky(some, backdrop)
    if _roughness(some, shown, backdrop) > ROUGH:
        return rows[:0]
    sky = rows[shown]
    if vertices is None or not len(vertices):
        return sky
    colored, distant = _sky_by_hue(splats, others, backdrop)
    strays = others[colored & distant]
    places = splats.means[strays] @ matrix[:3, :3].T + matrix[:3, 3]
    reach = FAR * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    gap = scipy.spatial.cKDTree(vertices).query(places, distance_upper_bound=reach)[0]
    found = np.concatenate([sky, strays[~np.isfinite(gap)]])
    if eyes is None or not len(eyes):
        return found
    back = np.linalg.inv(matrix)
    seen_from = eyes @ back[:3, :3].T + back[:3, 3]
    possible = np.concatenate([rows[_sky_by_hue(splats, rows, backdrop)[0]], others[colored]])
    possible = np.setdiff1d(possible[np.isfinite(splats.means[possible]).all(axis=1)], found)
    return np.concatenate([found, hanging_sky(splats, rows, found, possible, backdrop.middle, seen_from)])


class Backdrop(NamedTuple):
    """What identifies sky, in the frame of the splats. middle: (3,) of the scene. up: (3,). level: luminance of what is
    high up. least: distance from the middle from which the sky begins, inf where there is none."""

    middle: Vector
    up: Vector
    level: float
    least: float


def backdrop_of(some: Splats, middle: Vector, up: Vector) -> Backdrop:
    """The Backdrop of far Splats, or of a sample of them. middle, up: of a Backdrop."""
    off, distance, color, size = FromMiddle.of(some, middle)
    height = _height(off, distance, up)
    bright = luminance(linear_from_srgb(color))
    high = height > min(HIGH, height.max() - 1e-9)
    level = weighted_quantile(bright[high], size[high], LEVEL)
    free = ~_surface(height, color, level)
    least = NEAR_PART * weighted_quantile(distance[free], size[free], 0.5) if free.any() else np.inf
    return Backdrop(np.asarray(middle), np.asarray(up), level, least)


def is_sky(some: Splats, backdrop: Backdrop) -> Mask:
    """Which of far Splats show sky: (N,) bool."""
    off, sky = FromMiddle.of(some, backdrop.middle).off, _like_sky(some, backdrop)
    around = scipy.spatial.cKDTree(off).query(off, min(VOTES, len(off)))[1].reshape(len(off), -1)
    return sky[around].mean(axis=1) > 0.5


def _roughness(some: Splats, shown: Mask, backdrop: Backdrop) -> float:
    """Spread of brightness among neighbours in direction, for half of the area of those far Splats that are shown as
    sky, (N,) bool; 0 for too few."""
    if shown.sum() < VOTES:
        return 0.0
    seen = FromMiddle.of(some, backdrop.middle)
    around = scipy.spatial.cKDTree(seen.directions).query(seen.directions[shown], VOTES)[1]
    return weighted_quantile(seen.colors.mean(axis=1)[around].std(axis=1), seen.sizes[shown], 0.5)


def _like_sky(some: Splats, backdrop: Backdrop) -> Mask:
    """Which of Splats have the place and colour of sky, each by itself: (N,) bool."""
    colored, distant = _sky_by_hue(some, np.arange(len(some)), backdrop)
    return colored & distant


def _sky_by_hue(splats: Splats, rows: Indices, backdrop: Backdrop) -> tuple[Mask, Mask]:
    """Which rows (M,) have the elevation and colour of sky, and which are far enough: (M,) bool each."""
    off, distance, color, _ = FromMiddle.of(splats.take(rows), backdrop.middle)
    return ~_surface(_height(off, distance, backdrop.up), color, backdrop.level), distance >= backdrop.least


def _height(off: Points, distance: Floats, up: Vector) -> Floats:
    """Sines (N,) of the elevation of places (N, 3) so far away, (N,)."""
    return off @ (up / np.linalg.norm(up)) / distance


def _surface(height: Floats, color: Floats, level: float) -> Mask:
    """(N,) bool: splats that are, by position and colour, no sky of such luminance."""
    bright, (red, green, blue) = luminance(linear_from_srgb(color)), color.T
    surface = (height < BELOW) | (bright < DARK * level)
    surface |= (green - np.maximum(red, blue) > GREEN) & (bright < GREEN_PART * level)
    return surface | ((red - blue > WARM) & (bright < WARM_PART * level))


class FarSplats(NamedTuple):
    """What of splats shows the sky. source: as captured, in every row. rows: (M,) that show it. far: (F,) of all of the
    far background. scene_from_splat: (4, 4). choice: of SKIES. eye: (3,) from where they are seen, in the splats'
    frame; the middle of the others without."""

    source: Splats
    rows: Indices
    far: Indices
    scene_from_splat: ArrayLike
    choice: str = "new"
    eye: Vector | None = None

    def under(self, relit: Splats, light: "Environment", factor: float) -> Splats:
        """Relit splats, in every row, with the sky of a light, turned as the scene is lit, of which they show `factor`
        times the radiance, or with opacity 0. The captured light stays as it is, so many times as bright. Raises
        InputError for another choice than of SKIES, and for rows that are not there."""
        if isinstance(light, CapturedLight) and self.choice == "new":  # no lamp reaches that far
            return dimmed(relit, self.source, self.far, factor)
        if self.choice not in SKIES:
            raise InputError(f"the sky must be one of {', '.join(SKIES)}, found {self.choice!r}")
        rows = self.rows
        if self.choice == "keep" or not len(rows):
            return relit
        if not 0 <= rows.min() <= rows.max() < len(relit):
            raise InputError(f"the scene's far background reaches to splat {rows.max()}, there are {len(relit)}")
        if self.choice == "drop":
            opacities = relit.opacities.copy()
            opacities[rows] = 0.0
            return replace(relit, opacities=opacities)
        eye = self.eye
        if eye is None:
            near = np.delete(relit.means, rows, axis=0)
            eye = np.median(near[np.isfinite(near).all(axis=1)], axis=0) if len(near) else np.zeros(3)
        matrix = np.asarray(self.scene_from_splat, np.float64)[:3, :3]
        shown = light.lookup((relit.means[rows] - eye) @ matrix.T) * np.float32(factor)
        sh = relit.sh.copy()
        sh[rows] = 0.0
        sh[rows, 0] = (tone_map(shown) - np.float32(0.5)) / np.float32(SH_C0)
        return replace(relit, sh=sh)


def far_splats(
    splats: Splats,
    scene: Scene,
    appearance: "Appearance",
    mirror: "FloorMirror | None" = None,
    cache: Cache | None = None,  # of the scene
    choice: str = "new",
) -> FarSplats:
    """The FarSplats of these Splats of a Scene; what a floor mirrors is not among them."""
    far = scene.background_splats if mirror is None else mirror.spared(scene.background_splats)
    rows = shown_as_sky(splats, scene, appearance, mirror, cache)
    return FarSplats(splats, rows, far, scene.scene_from_splat, choice)


def dimmed(
    relit: Splats,  # every row of the source
    source: Splats,  # as captured
    rows: Indices,  # (M,) which of them are far background
    factor: float,  # on its light
) -> Splats:
    """The Splats with the far ones as captured, but with so many times the light."""
    if not len(rows):
        return relit
    log_gain = np.full((len(rows), 3), np.log(np.clip(factor, LEAST, MOST)) / CURVE_POWER, np.float32)
    sh = relit.sh.copy()
    sh[rows] = relit_sh(source.sh[rows], log_gain, log_gain[0])
    return replace(relit, sh=sh)
