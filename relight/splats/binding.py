"""Splats bound to the mesh made of them: do what depends on geometry once, then relight under any number of lights."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Mask, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.frames import has_moved
from splat2mesh.splats.splats import INVISIBLE_OPACITY, MIN_SPLATS, Splats

from ..transfer.store import Cache, array_key
from .attachment import Places, Surface
from .carried import CarriedMesh, MovedMesh
from .floor_mirror import FloorMirror
from .light_ratio import CURVE_POWER, LEAST, Usual, log_gain, relit_sh, without_clipping
from .looks import EYES, Looks
from .mirrored_places import LEAST_SHARE, MirroredPlaces, Mix, by_color
from .sketch import Sketch
from .wide import Neighborhoods

VIEWS, PIXELS = 32, 256
"""Virtual views of the fit and their longer side. 24 or 48 views or 320 pixels differ by less than 0.1 dB; 192
pixels lost 0.2 on a tabletop."""

LEAST_USE = 0.01
"""Sum of the weights that splats give a vertex; up to this its own light is not computed."""

ROUNDS = 2
"""Rounds of the fit. One gains 0.3 dB on an object and 0.5 to 0.9 on a tabletop, the second less than 0.1."""


class Binding:
    """N Gaussians bound to a Scene.

    splats: the N, as read. places: Places of those that can be lit, which are `shown`. lit: (N,) bool; the others keep
    their colour: a position, scale, rotation, opacity or colour that is not finite or out of any range, or a zero
    quaternion.
    """

    def __init__(
        self,
        splats: Splats,  # as read, in their own frame
        scene: Scene,  # Scene made of them; its vertex colours are the captured ones
        views: Sequence[View] | None = None,  # for the fit, frame of the splats; chosen by default, () for none
        seed: int = 0,  # of the choice
        advance: Callable[[int], None] = lambda count: None,  # called with the number of finished views
        cache: Cache | None = None,  # Cache of the scene, where what takes long is kept unless views are given
        diagonal: float | None = None,  # of `Surface`, where the scene is a part of another
    ) -> None:
        """Bind them. Warns with a DataWarning of Gaussians that cannot be lit."""
        self.splats, self.lit = splats, sound(splats)
        unlit = len(splats) - int(self.lit.sum())
        if unlit:
            warnings.warn(
                f"{unlit} of {len(splats)} splats are damaged: they keep their place and colour, unlit",
                DataWarning,
                stacklevel=2,
            )
        self._captured = linear_from_srgb(scene.colors_srgb.astype(np.float32) / np.float32(255.0))
        self.surface = Surface(scene, diagonal) if cache is None else Surface.kept_in(cache, scene, diagonal)
        self.shown = splats if not unlit else splats.take(self.lit)
        self._near = 0.005 * self.surface.diagonal
        self._mirrored: MirroredPlaces | None = None
        volume = scene.foliage
        self._volume = self.surface.of_vertices(volume[:, None])[:, 0]
        if cache is None or views is not None:
            self._bind(scene, views, seed, advance)
        else:
            key = _key(self.shown, scene, volume), seed
            if cache.restored(lambda kept: self._restore(kept, scene), "binding", *key) is None:
                self._bind(scene, None, seed, advance)
                cache.put("binding", *key, **self._arrays())

    def _bind(self, scene: Scene, views: Sequence[View] | None, seed: int, advance: Callable[[int], None]) -> None:
        self.places = Places(self.surface, self.shown)
        sketch = self._sketched(not scene.is_place and views is None).splats
        views = self._chosen(sketch, scene, seed) if views is None else views
        self._looks = Looks.at(sketch, self.surface, views, self._near, advance) if len(views) else None
        self._wide = Neighborhoods(self.surface.points, self._volume, self._asked())

    def mirroring(self, mirror: FloorMirror | None, scene: Scene) -> "Binding":
        """Itself, after giving the reflections of a floor of the Scene the light of what it mirrors. The fit leaves out
        the pixels that show them: the mesh has another light there."""
        if mirror is None:
            return self
        rows = np.cumsum(self.lit)[mirror.rows] - 1
        self._mirrored = MirroredPlaces(mirror, self.surface, scene, self.shown, rows)
        if self._looks is None:
            return self
        below = np.zeros((len(self.shown), 3), np.float32)
        below[rows] = 1.0
        clear = self._looks.blending.drawn(self.sketch.mean(below[self._drawn]))[self._looks.known, 0] < LEAST_SHARE
        self._looks = self._looks.at_pixels(clear)
        return self

    def recoloured(self, splats: Splats) -> "Binding":
        """The same binding of other Splats, row by row in the same places, of which only the colours count.

        Raises InputError for another number of splats.
        """
        if splats.sh.shape != self.splats.sh.shape:
            raise InputError(f"expected the {len(self.splats)} splats that are bound, found {len(splats)}")
        other = copy(self)
        other.splats, other.shown = splats, splats if self.lit.all() else splats.take(self.lit)
        return other

    def posed(self, splats: Splats, mesh: MovedMesh, captured: Radiance) -> "Binding":
        """The same binding of other Splats, row by row, that carry the mesh. captured: (V, 3), its colours there.

        Gaussians that went apart from what they lie on are attached anew, and the fit leaves torn faces out.
        """
        other = self.recoloured(splats)
        other.surface, other._captured = mesh.surface, captured
        columns, shown = self.places.columns, (self.shown, other.shown)
        asked = np.flatnonzero(mesh.pose.moved[columns].any(axis=1) | has_moved(other.shown, self.shown))
        lengths = [
            np.linalg.norm(each.means[asked, None] - on.points[columns[asked]], axis=2)
            for each, on in zip(shown, (self.surface, mesh.surface), strict=True)
        ]
        extents = np.maximum(self.shown.scales[asked].max(axis=1, keepdims=True), mesh.pose.extents[columns[asked]])
        apart = (np.abs(lengths[1] - lengths[0]) > extents) & (self.places.weights[asked] > 0.0)
        other.places = self.places.renewed(asked[apart.any(axis=1)], mesh.surface, other.shown)
        if self._looks is not None:
            other._looks = self._looks.at_pixels(~mesh.pose.torn(self._looks.corners))
        return other

    def _restore(self, kept: Mapping[str, NDArray[Any]], scene: Scene) -> "Binding":
        """Take over what was kept. Raises InputError or KeyError for what does not fit."""
        self.places = Places(self.surface, self.shown, kept)
        count = len(self._sketched(not scene.is_place))
        looks = "known" in kept
        self._looks = Looks.restored(kept, count, self.surface) if looks else None
        self._wide = Neighborhoods(self.surface.points, self._volume, self._asked(), kept["near"])
        return self

    def _arrays(self) -> dict[str, NDArray[Any]]:
        places = self.places
        arrays = {name: getattr(places, name) for name in ("columns", "weights", "far")}
        arrays["near"] = self._wide.near
        return arrays if self._looks is None else arrays | self._looks.arrays(self.surface)

    def _sketched(self, from_afar: bool) -> Sketch:
        """The Sketch of the pictures, of those `_drawn`: without what depends on the view, a third of the memory and
        time and the same fit. Far ones stand between the scene and virtual eyes that no camera of the capture had.
        from_afar: whether each picture shows the whole."""
        self._drawn = (self.places.far < 0.5) & (self.shown.opacities >= INVISIBLE_OPACITY)
        plain = replace(self.shown, sh=self.shown.sh[:, :1]).take(self._drawn)
        across = np.linalg.norm(np.ptp(self.surface.points[self.surface.used], axis=0))
        self.sketch = Sketch(plain, PIXELS if from_afar else None, float(across))
        return self.sketch

    @property
    def looks(self) -> Looks | None:
        """The Looks of the fit, at `drawn`; None without views."""
        return self._looks

    def looks_at(self, views: Sequence[View]) -> Looks:
        """Looks at the same from other views, in the frame of the splats."""
        return Looks.at(self.sketch.splats, self.surface, views, self._near)

    def drawn(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (N, ...) of all Gaussians as those of the ones in those pictures, (G, ...)."""
        return self.sketch.mean(values, self.drawn_rows)

    @property
    def carried(self) -> CarriedMesh:
        """The mesh, as the splats carry it where they move."""
        return CarriedMesh(self.surface, self.splats, self.drawn_rows)

    @property
    def drawn_rows(self) -> NDArray[np.int64]:
        """The rows of what they draw among all splats; several are one of theirs where they are finer than pixels."""
        return np.flatnonzero(self.lit)[self._drawn]

    @property
    def used(self) -> Mask:
        """(V,) bool: the vertices that any splat which is drawn takes light from."""
        return self._taken[self.surface.node]

    @cached_property
    def _taken(self) -> Mask:
        """(M,) bool: the nodes of those vertices."""
        use = np.zeros(len(self.surface.points))
        _add_weights(self.places.columns, self.places.weights, self._drawn, use)
        taken = use > LEAST_USE
        return taken if self._mirrored is None else taken | self._mirrored.reached(len(taken))

    def _asked(self) -> Mask | None:
        """(M,) bool: the nodes whose light is used; None without a volume."""
        if not self._volume.any():
            return None
        asked = np.zeros(len(self.surface.points), bool)
        asked[self.places.columns.ravel()] = True
        if self._looks is not None:
            asked[self._looks.corners.ravel()] = True
        return asked

    def relit(
        self, before: Radiance, after: Radiance, exposure: float = 1.0, rounds: int = ROUNDS, usual: Usual | None = None
    ) -> Splats:
        """The splats in a new light: Splats, in order, of which only `sh` differs.

        before: (V, 3) irradiance of the scene's vertices in the light of the capture, unit of the captured colours.
        after: (V, 3) the same in the new light. exposure: shown = radiance * exposure. rounds: of the fit in views.
        usual: Usual of the scene that this one is a part of; its own without.
        Where before and after are equal at all vertices, no bit changes.
        Raises InputError for arrays or an exposure that do not fit.
        """
        if not (np.isfinite(exposure) and exposure > 0.0):
            raise InputError(f"the exposure must be a positive number, found {exposure}")
        of_nodes, mean = self._log_gains(before, after, exposure, usual)
        logs = self.places.interpolate(of_nodes)
        if self._mirrored is not None:
            rows = self._mirrored.rows
            logs[rows] = self._mirrored.log_gains(of_nodes, logs[rows])
        s = self.splats
        sh = relit_sh(self.shown.sh, logs, mean)
        if self._looks is not None and rounds:
            before, relit = (self.sketch.mean(each[self._drawn, 0]) for each in (self.shown.sh, sh))
            sh[self._drawn, 0] += self.sketch.members(self._looks.corrections(before, relit, of_nodes, rounds))
        sh[:, 0] = without_clipping(sh[:, 0], self.shown.sh[:, 0])
        if not self.lit.all():
            sh, relit_rows = s.sh.copy(), sh
            sh[self.lit] = relit_rows
        return replace(s, sh=sh)

    def usual(self, before: Radiance, after: Radiance, exposure: float = 1.0) -> Usual:
        """What `relit` takes for the Usual of the scene without one. Arguments as of it."""
        after = np.asarray(after, np.float64) * exposure
        found = Usual.of(np.asarray(before, np.float64), after, self._shares)
        return found._replace(gain=log_gain(self._captured, before, after, self._shares, found)[1])

    @property
    def _shares(self) -> NDArray[np.float64]:
        """(V,) what each vertex counts in means over the scene."""
        return (self.surface.areas / np.bincount(self.surface.node))[self.surface.node]

    def log_gains(self, before: Radiance, after: Radiance, exposure: float = 1.0) -> NDArray[np.float32]:
        """(M, 3) log gain of the nodes by which `relit` relights."""
        return self._log_gains(before, after, exposure, None)[0]

    def _log_gains(
        self, before: Radiance, after: Radiance, exposure: float, usual: Usual | None
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Log gain of the nodes (M, 3), and its mean over the scene (3,)."""
        after = np.asarray(after, np.float64) * exposure
        if np.shape(before) != self._captured.shape:
            raise InputError(
                f"the irradiance must be {self._captured.shape}, one for each vertex, found {np.shape(before)}"
            )
        of_vertices, mean = log_gain(self._captured, before, after, self._shares, usual)
        return self._wide.shared(self.surface.of_vertices(of_vertices)), mean

    def spread(self, of_vertices: NDArray[np.float32], mix: Mix = by_color) -> NDArray[np.float32]:
        """Values (V, C) float32 of the scene's vertices as values (N, C) of the splats that are lit.

        mix: what the reflections of a floor make of those at their mirrored places and of those on the floor.
        """
        of_nodes = self._wide.shared(self.surface.of_vertices(of_vertices))
        values = self.places.interpolate(of_nodes)
        if self._mirrored is not None:
            rows = self._mirrored.rows
            values[rows] = mix(*self._mirrored.pair(of_nodes, values[rows]), self._mirrored.own)
        return values

    @property
    def mirrored(self) -> MirroredPlaces | None:
        """Where the reflections of a floor take their light; their rows are of the splats that are lit."""
        return self._mirrored

    def shaded(self, relit: Splats, ratio: Radiance) -> Splats:
        """Splats of this binding with the light of some vertices multiplied once more, at once: without the fit, what
        volumes share and what is far from the surface. ratio: (V, 3), 1 where nothing changes.

        Costs the splats that change, and one look at which these are."""
        of_nodes = np.zeros((len(self.surface.points), 3), np.float32)
        changed = np.flatnonzero((ratio != 1.0).any(axis=1))
        if not len(changed):
            return relit
        of_nodes[self.surface.node[changed]] = np.log(np.maximum(ratio[changed], LEAST)) / CURVE_POWER
        touched = np.zeros(len(of_nodes), bool)
        touched[self.surface.node[changed]] = True
        places = self.places
        reached = np.asarray(touched[places.columns].any(axis=1))
        if self._mirrored is not None:
            reached[self._mirrored.rows] = True
        rows = np.flatnonzero(reached)
        logs = np.einsum("nk,nkc->nc", places.weights[rows], of_nodes[places.columns[rows]])
        logs *= 1.0 - places.far[rows, None]
        if self._mirrored is not None:
            images = np.searchsorted(rows, self._mirrored.rows)
            logs[images] = self._mirrored.log_gains(of_nodes, logs[images])
        lit = rows if self.lit.all() else np.flatnonzero(self.lit)[rows]
        sh = relit.sh.copy()
        sh[lit] = relit_sh(relit.sh[lit], logs, np.zeros(3, np.float32))
        return replace(relit, sh=sh)

    def _chosen(self, sketch: Splats, scene: Scene, seed: int) -> Sequence[View]:
        """Views from where the capture of a place stood, of an object from all around."""
        from splat2mesh.views.eyes import around
        from splat2mesh.views.standpoints import Eye
        from splat2mesh.views.viewpoints import virtual_views

        if len(sketch) < MIN_SPLATS:
            return []
        up = np.asarray(scene.scene_from_splat, np.float64)[1, :3]
        standing = scene.capture.get("eyes", ()) if scene.is_place else ()
        if len(standing):
            back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
            eyes = [Eye(back[:3, :3] @ eye + back[:3, 3], self._near) for eye in np.asarray(standing, np.float64)]
            return around(eyes[:EYES], PIXELS, up / np.linalg.norm(up))[0]
        return virtual_views(sketch, VIEWS, PIXELS, up / np.linalg.norm(up), seed)


@kernel
def _add_weights(columns: Integers, weights: Floats, drawn: Mask, use: NDArray[np.float64]) -> None:
    """Add to the use (M,) of each node the weights (N, 9) that drawn splats give it."""
    for splat in range(len(drawn)):
        if drawn[splat]:
            for k in range(columns.shape[1]):
                use[columns[splat, k]] += weights[splat, k]


def _key(splats: Splats, scene: Scene, volume: Floats) -> str:
    """Key that distinguishes this binding from others on the same geometry."""
    shown = splats.means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh[:, 0]
    eyes = np.asarray(scene.capture.get("eyes", ()), np.float64) if scene.is_place else None
    return array_key(*shown, np.asarray(scene.scene_from_splat, np.float64), eyes, volume)
