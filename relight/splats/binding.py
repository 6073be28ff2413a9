"""Splats bound to the mesh made of them: do what depends on geometry once, then relight under any number of lights."""

import warnings

import numpy as np

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.splats import ABSURD_LENGTH, INVISIBLE_OPACITY, MIN_SPLATS, SH_C0, Splats

from .attachment import Places, Surface
from .backproject import backproject
from .light_ratio import CURVE_OFFSET, log_gain, relit_sh
from .wide import Neighborhoods

VIEWS, PIXELS = 32, 256
"""Virtual views of the fit and their longer side. 24 or 48 views or 320 pixels differ by less than 0.1 dB; 192
pixels lost 0.2 on a tabletop."""

ROUNDS = 2
"""Of the fit. One gains 0.3 dB on an object and 0.5 to 0.9 on a tabletop, the second less than 0.1."""

DEPTH_TOLERANCE = 0.03
"""Of the diagonal: where mesh and splats are further apart in a view, the picture tells nothing of the mesh's light."""

OBJECT_DISTANCE = 0.5
"""Diagonals from which a view sees a scene at least: what is nearer lets mesh and splats be apart by as much less, so
that within a place nothing bleeds over jumps of depth."""

EYES, EYE_PIXELS = 8, 256
"""Of a place: the places to stand from which the fit looks all around, and the side of its views, six from each."""

MIN_ALPHA = 0.5
"""Of a pixel that takes part in the fit."""

CAUTION = 0.5
"""Pixels added to those that a Gaussian's correction is a mean of: who is hardly seen is hardly corrected."""


class Binding:
    """N Gaussians bound to a Scene.

    places: Places of those that can be lit, which are `shown`. lit: (N,) bool; the others keep their colour: a
    position, scale, rotation, opacity or colour that is not finite or out of any range, or a zero quaternion.
    """

    def __init__(
        self,
        splats,  # Splats, as read, in their own frame
        scene,  # Scene made of them; its vertex colours are the captured ones
        views=None,  # list of View in the frame of the splats, for the fit; chosen by default, () for no fit
        seed=0,  # of the choice
        advance=lambda count: None,  # called with the number of views looked at
    ):
        """Bind them. Warns with a DataWarning of Gaussians that cannot be lit."""
        self._splats, self.lit = splats, usable(splats)
        unlit = len(splats) - int(self.lit.sum())
        if unlit:
            warnings.warn(
                f"{unlit} of {len(splats)} splats are damaged: they keep their place and colour, unlit",
                DataWarning,
                stacklevel=2,
            )
        self._captured = linear_from_srgb(scene.colors_srgb.astype(np.float32) / np.float32(255.0))
        self.surface = Surface(scene)
        self.shown = shown = splats if not unlit else splats.take(self.lit)
        self.places = Places(self.surface, shown)
        self._wide = Neighborhoods(self.surface.points, self.surface.of_vertices(scene.foliage[:, None])[:, 0])
        self._near = 0.005 * self.surface.diagonal
        # Far Gaussians stand between the scene and virtual eyes that no camera of the capture had.
        self._drawn = (self.places.far < 0.5) & (shown.opacities >= INVISIBLE_OPACITY)
        # Without what depends on the view: a third of the memory and time, the same fit.
        self._sketch = _diffuse(shown, self._drawn)
        up = np.asarray(scene.scene_from_splat, np.float64)[1, :3]
        self._looks = []
        for view in self._chosen(scene, up, seed) if views is None else views:
            self._looks.append(self._look(view))
            advance(1)

    def relit(self, before, after, exposure=1.0, rounds=ROUNDS):
        """The splats in a new light: Splats, in order, of which only `sh` differs.

        before: (V, 3) irradiance of the scene's vertices in the light of the capture, unit of the captured colours.
        after: (V, 3) the same in the new light. exposure: shown = radiance * exposure. rounds: of the fit in views.
        Where before and after are equal at all vertices, no bit changes.
        Raises InputError for arrays or an exposure that do not fit.
        """
        if not (np.isfinite(exposure) and exposure > 0.0):
            raise InputError(f"the exposure must be a positive number, found {exposure}")
        after = np.asarray(after, np.float64) * exposure
        if np.shape(before) != self._captured.shape:
            raise InputError(
                f"the irradiance must be {self._captured.shape}, one for each vertex, found {np.shape(before)}"
            )
        shares = (self.surface.areas / np.bincount(self.surface.node))[self.surface.node]
        of_vertices, mean = log_gain(self._captured, before, after, shares)
        of_nodes = self._wide.shared(self.surface.of_vertices(of_vertices))
        logs = self.places.interpolate(of_nodes)
        correction = self._fit(of_nodes, logs, mean, rounds) if len(self._looks) else 0.0
        s = self._splats
        sh = relit_sh(s.sh if self.lit.all() else s.sh[self.lit], logs, mean)
        sh[:, 0] += correction
        if not self.lit.all():
            sh, relit_rows = s.sh.copy(), sh
            sh[self.lit] = relit_rows
        return Splats(s.means, s.scales, s.quats_wxyz, s.opacities, sh)

    def spread(self, of_vertices):
        """Values (V, C) float32 of the scene's vertices as values (N, C) of the splats that are lit."""
        return self.places.interpolate(self._wide.shared(self.surface.of_vertices(of_vertices)))

    def _fit(self, of_nodes, logs, mean, rounds):
        """Corrections (N, 3) float32 to add to the constant coefficients, so that pictures of the relit splats agree
        with pictures of the captured ones times the light ratio of the mesh.

        Gaussians lie before and behind the surface, so that their blend shows the light of neither place. Each round
        renders all views and moves each Gaussian's colour by the mean error of the pixels it contributes to.
        Source: Gilbert, "Iterative methods for the three-dimensional reconstruction of an object from projections"
        (1972): simultaneous iterative reconstruction (SIRT).
        """
        s = self._sketch
        relit = relit_sh(s.sh, logs[self._drawn], mean)
        moved = np.zeros_like(relit[:, 0])
        sums = np.zeros((len(s), 4), np.float32)
        for _ in range(rounds):
            current = relit.copy()
            current[:, 0] += moved
            current = Splats(s.means, s.scales, s.quats_wxyz, s.opacities, current)
            sums[:] = 0.0
            for look in self._looks:
                color = rasterize(current, look.view, self._near).color
                error = np.expm1(look.log_gain(of_nodes)) * look.base - (color - look.color)
                backproject(s, look.view, look.values(error), sums, self._near)
            moved += sums[:, :3] / (sums[:, 3:] + CAUTION) / SH_C0
        correction = np.zeros_like(logs)
        correction[self._drawn] = moved
        return correction

    def _chosen(self, scene, up, seed):
        """Views from where the capture of a place stood, of an object from all around."""
        from splat2mesh.views.eyes import around
        from splat2mesh.views.standpoints import Eye
        from splat2mesh.views.viewpoints import virtual_views

        if len(self._sketch) < MIN_SPLATS:
            return []
        standing = scene.capture.get("eyes", ()) if scene.is_place else ()
        if len(standing):
            back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
            eyes = [Eye(back[:3, :3] @ eye + back[:3, 3], self._near) for eye in np.asarray(standing, np.float64)]
            return around(eyes[:EYES], EYE_PIXELS, up / np.linalg.norm(up))[0]
        return virtual_views(self._sketch, VIEWS, PIXELS, up / np.linalg.norm(up), seed)

    def _look(self, view):
        return _Look(self._sketch, self.surface, view, self._near)


class _Look:
    """One view of splats and mesh. color, base: (H, W, 3) float32 as shown, and what the gain multiplies."""

    def __init__(self, splats, surface, view, near):
        rendering = rasterize(splats, view, near)
        directions = view.ray_directions().astype(np.float32)
        rays = np.concatenate([np.broadcast_to(view.center.astype(np.float32), directions.shape), directions], axis=-1)
        hits = surface.caster.first_hits(rays)  # distances in camera z, as the directions are
        self.view, self.color = view, rendering.color
        self.base = rendering.color + np.float32(CURVE_OFFSET) * rendering.alpha[..., None]
        apart = np.abs(hits.distance - rendering.depth_median)
        allowed = DEPTH_TOLERANCE * np.minimum(surface.diagonal, rendering.depth_median / OBJECT_DISTANCE)
        self._known = (rendering.alpha > MIN_ALPHA) & (apart < allowed)
        self._corners = surface.faces[hits.faces[self._known]]
        second, third = hits.uv[self._known].T
        self._shares = np.stack([1.0 - second - third, second, third], axis=1)

    def log_gain(self, of_nodes):
        """Log gain of what each pixel shows: (H, W, 3) float32, 0 where it is not known."""
        result = np.zeros_like(self.color)
        result[self._known] = np.einsum("nk,nkc->nc", self._shares, of_nodes[self._corners])
        return result

    def values(self, picture):
        """A picture as `backproject` takes it: a fourth channel holds 1 where the pixel is known."""
        return np.concatenate([picture, self._known[..., None]], axis=-1, dtype=np.float32)


def relit(splats, scene, before, after, exposure=1.0, views=None, rounds=ROUNDS, seed=0):
    """Bind splats and relight them in one call. Keep a `Binding` for several lights: it does most of the work once."""
    return Binding(splats, scene, views, seed).relit(before, after, exposure, rounds)


def usable(splats):
    """(N,) bool: splats whose centre, scales, rotation and colour can be used."""
    arrays = (splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh)
    finite = np.logical_and.reduce([np.isfinite(a).all(axis=tuple(range(1, a.ndim))) for a in arrays])
    with np.errstate(invalid="ignore"):
        largest = splats.scales.max(axis=1)
        sized = (splats.scales.min(axis=1) >= 0) & (largest > 0) & (largest <= ABSURD_LENGTH)
        placed = np.abs(splats.means).max(axis=1) <= ABSURD_LENGTH
    return finite & sized & placed & splats.quats_wxyz.any(axis=1)


def _diffuse(splats, rows):
    return Splats(
        splats.means[rows], splats.scales[rows], splats.quats_wxyz[rows], splats.opacities[rows], splats.sh[rows, :1]
    )
