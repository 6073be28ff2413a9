"""The sky of a relit splat: its far background shows the new environment, stays as it was, or goes.

Far splats are a picture of the light of the capture day. Each takes the radiance that arrives from its direction, as
seen from the middle of the scene, and no longer depends on the view. Lawns, hedges and houses are far away too:
they are no sky, and take the change of light of the mesh's edge.
"""

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from splat2mesh.base.arrays import Indices, Mask, Points, Vector
from splat2mesh.base.errors import InputError
from splat2mesh.base.quantiles import weighted_quantile
from splat2mesh.scene.color import linear_from_srgb, luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

from ..albedo.seen import standing
from ..light import SKIES
from ..light.loading import CapturedLight
from ..light.tonemap import tone_map
from .hanging_sky import VOTES, FromMiddle, hanging_sky
from .light_ratio import CURVE_POWER, LEAST, MOST, relit_sh

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..light.environment import Environment
    from .floor_mirror import FloorMirror

HUE, DIM, DARK = 0.15, 0.8, 0.12
"""Excess of red or green over blue, of the largest of the three in sRGB, and part of the sky's luminance below which a
splat of such a hue is of leaves, soil or bricks, and no sky at evening; and that below which it is a surface whatever
its hue. They follow from two gardens, of one of which true geometry tells what is sky, and eighteen photographed
lights."""

ROUGH = 0.21
"""Spread of brightness, in sRGB, among that many neighbours in direction, above which half of what looks like sky is
none: pale facades with their windows have .26, in the one capture whose background is towers without a sky. Thirteen
skies have up to .16."""


def shown_as_sky(
    splats: Splats, scene: Scene, appearance: "Appearance", mirror: "FloorMirror | None" = None
) -> Indices:
    """Rows (M,) of these Splats of a Scene that show the sky: of the far background, and of what hangs in the air
    before it, also near surfaces where it is known from where the capture looked. In the windows of a closed room, and
    where all stays as captured, all of the background. What lies below a floor that mirrors shows the room."""
    rows = scene.background_splats
    if appearance.room is None and not appearance.as_captured and len(rows):
        rows = sky_rows(splats, rows, scene.scene_from_splat, standing(scene))
    return rows if mirror is None else mirror.spared(rows)


def sky_rows(
    splats: Splats,  # Splats as captured, every row of the source
    rows: Indices,  # (M,) which of them are far background
    scene_from_splat: ArrayLike,  # (4, 4)
    eyes: Points | None = None,  # (E, 3) where the capture stood, scene frame
) -> Indices:
    """Which of the far background is sky and not a surface far away: (K,) of its rows, in their order.

    Where there are eyes, other rows follow that look like sky and hang before it at any distance. There are none where
    most of the background is rough, as facades are.
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
    if eyes is None or not len(eyes):
        return sky
    back = np.linalg.inv(matrix)
    possible = np.flatnonzero(np.isfinite(splats.means).all(axis=1) & _like_sky(splats, backdrop))
    possible = np.setdiff1d(possible, sky)
    seen_from = eyes @ back[:3, :3].T + back[:3, 3]
    return np.concatenate([sky, hanging_sky(splats, rows, sky, possible, backdrop.middle, seen_from)])


class Backdrop(NamedTuple):
    """What identifies sky, in the frame of the splats. middle: (3,) of the scene. up: (3,). level: luminance of what is
    above the horizon, in the mean over its light."""

    middle: Vector
    up: Vector
    level: float


def backdrop_of(some: Splats, middle: Vector, up: Vector) -> Backdrop:
    """The Backdrop of far Splats, or of a sample of them. middle, up: of a Backdrop."""
    off, _, color, size = FromMiddle.of(some, middle)
    bright = luminance(linear_from_srgb(color))
    light = np.where(off @ up > 0.0, bright * size, 0.0)
    return Backdrop(np.asarray(middle), np.asarray(up), float(light @ bright / max(light.sum(), 1e-30)))


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
    off, _, color, _ = FromMiddle.of(some, backdrop.middle)
    part = luminance(linear_from_srgb(color)) / max(backdrop.level, 1e-30)
    earthy = color[:, :2].max(axis=1) - color[:, 2] > HUE * color.max(axis=1)
    return np.asarray((off @ backdrop.up > 0.0) & (part >= np.where(earthy, DIM, DARK)))


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
    choice: str = "new",
) -> FarSplats:
    """The FarSplats of these Splats of a Scene; what a floor mirrors is not among them."""
    far = scene.background_splats if mirror is None else mirror.spared(scene.background_splats)
    rows = shown_as_sky(splats, scene, appearance, mirror)
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
