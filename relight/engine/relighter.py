"""From a scene and lights to radiance: transfer once per geometry, then one small product for every light."""

from collections.abc import Callable, Mapping
from collections.abc import Set as AbstractSet
from copy import copy
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.scene.foreign import AnyScene, as_scene
from splat2mesh.scene.scene import Scene

from ..albedo.said import Said
from ..light.loading import CapturedLight
from ..options import LightingOptions
from ..planning import planner
from ..rooms.hidden import kept_volumes
from ..transfer import DEFAULT_BANDS, DEFAULT_RAYS
from ..transfer.bounces import with_bounces
from ..transfer.checks import checked_albedo
from ..transfer.precomputed import PosedPrecomputed, Precomputed
from ..transfer.settings import BOUNCE_RAYS, VOLUME_DIRECTIONS, Settings
from ..transfer.transport import Transport
from .blinnphong import blinn_phong
from .direct import DirectLight, Geometry
from .posed import PER_VERTEX, PosedGeometry, check_changes
from .static import StaticGeometry

if TYPE_CHECKING:
    from ..light.environment import Environment
    from ..planning.plan import Plan
    from ..planning.planner import Planner
    from ..transfer.bounces import Interreflection
    from ..transfer.occluder import Occluder
    from ..transfer.store import Cache
    from .dynamic import DynamicGeometry

PLANNED = ("auto", "raytraced", "analytic")
"""Methods whose settings can be planned; the others guess, and no setting makes the error of that smaller."""


class Shading(NamedTuple):
    """Light on a scene. radiance: (V, 3) float32 linear exit radiance, in the vertex order of the scene.

    sun_count: number of directions traced. bounces: relative contribution of each bounce, a list. settings: the
    Settings that made it; more rays than requested, where they were cached. received: (V, 3) float32
    irradiance over pi, unit of `radiance`, where it is known separately; None where it follows from the albedo.
    """

    radiance: NDArray[np.float32]
    sun_count: int
    bounces: list[float]
    settings: Settings
    received: NDArray[np.float32] | None = None


class Shaded(NamedTuple):
    """A scene in one light. light: the Environment. exposure: display value per unit of the radiance of `shading`.
    backdrop: factor on the light itself where it shows in the far background. environment, captured: factors on the
    light itself and on that of the capture beside it. level: units of the picture, which those and lamps use, per
    unit of the light. inserted: the InsertedLight of added objects or None; `shading.radiance` contains their
    shadows, `shading.received` does not."""

    light: "Environment"
    shading: Shading
    exposure: float
    backdrop: float = 1.0
    environment: float = 1.0
    captured: float = 0.0
    level: float = 1.0
    inserted: Any = None

    @property
    def sky(self) -> "Environment | None":
        """The light as it shows behind the scene; None for the captured light."""
        return None if isinstance(self.light, CapturedLight) else self.light


class Relighter:
    """Light on one scene. Results that depend on the geometry alone are computed once, on first use.

    scene: a Scene; the path of a scene folder or mesh file; or a mesh of trimesh or open3d.
    options: LightingOptions, or the name of a method; `wishes` are fields of them, such as tolerance=0.02. With a
        tolerance or a budget, each light is planned (`plan_for`).
    stages: Stages that time the work.
    cache: keeps transfers; none by default. `Cache.of_scene(scene)` is in the scene's folder.
    precomputed: of another Relighter of the same scene, with its seed and cache, to share traced rays.
    shown: returns (V,) bool, the visible vertices, the only ones lit exactly. Default: all.
    Raises InputError for options outside these and, on first use, for a scene that cannot be lit.
    """

    def __init__(
        self,
        scene: AnyScene,
        options: LightingOptions | str | None = None,
        *,
        stages: Stages | None = None,
        cache: "Cache | None" = None,
        precomputed: Precomputed | None = None,
        shown: Callable[[], NDArray[np.bool_]] | None = None,
        **wishes: Any,
    ) -> None:
        self.options = LightingOptions.of(options, **wishes)
        self.scene = as_scene(scene)
        self.stages = Stages() if stages is None else stages
        self.precomputed = precomputed or Precomputed(self.scene, self.options.seed, cache, self.stages, shown)
        if self.scene.capture.get("from") == "inside":
            self.precomputed.solid = partial(kept_volumes, self.scene, self.precomputed.cache)
        self._direct_light = self._lit(StaticGeometry(self.precomputed, self.stages))
        self._everything = self.options.unplanned
        if self.precomputed.foliage is None:
            self._everything = self._everything._replace(volume=0)
        self._planner: Planner | None = None
        self._latest: Settings | None = None
        self._dynamic: DynamicGeometry | PosedGeometry | None = None
        self._albedo: tuple[NDArray[np.floating], NDArray[np.float32] | None] | None = None
        self._posed: Precomputed | None = None
        if self.options.is_planned:
            self._planner = planner.Planner(self.precomputed, self.options, self.stages)

    @property
    def effects(self) -> frozenset[str]:
        """The effects that may take part."""
        return self.options.chosen_effects

    @property
    def method(self) -> str:
        """The method in use; with a plan, that of the latest light."""
        return self._settings_now().method

    @property
    def occluder(self) -> "Occluder":
        """The Occluder of the whole scene."""
        return self.precomputed.occluder

    @property
    def transfer(self) -> NDArray[np.float32]:
        """Transfer of every vertex as if white, without bounces: (V, K) float32; see `relight.transfer`.

        Where it is planned, as the latest light called for it; it may have more bands than the plan says.
        """
        return self.precomputed.transfer(self._settings_now())[0]

    @property
    def rays_traced(self) -> int:
        """Number of rays traced for transfers and bounces so far; cached results count none."""
        return self.precomputed.rays_traced

    def interreflection(self, rays: int = BOUNCE_RAYS) -> "Interreflection":
        """The Interreflection of the scene, for the visibility of `transfer`; while chunks move, the earlier one."""
        if self._posed is not None and self._dynamic is not None:
            return self._posed.interreflection(rays, self._dynamic.transfer()[0])
        return self.precomputed.interreflection(rays, self.transfer)

    def transport(self, settings: Settings, alone: bool = False) -> Transport:
        """The Transport of the white scene under Settings with bounces, for what builds on it. Leaves and grass are
        volumes wherever they may be. alone: with no more rays than they say, however many are there."""
        settings = settings._replace(volume=VOLUME_DIRECTIONS if self._everything.volume else 0)
        precomputed = self.precomputed.alone(settings) if alone else self.precomputed
        transfer = precomputed.transfer(settings)[0]
        bounces = precomputed.interreflection(settings.bounce_rays, transfer)
        geometry = StaticGeometry(precomputed, self.stages)
        return Transport(
            transfer[:, : settings.bands**2], bounces, lambda suns, rows: geometry.sunlight(suns, settings, rows)
        )

    @property
    def leaves(self) -> str:
        """Short text, for keys, that identifies the leaves and grass treated as volumes, if any."""
        foliage = self.precomputed.foliage
        return "" if foliage is None or not self._everything.volume else foliage.key

    @property
    def cache(self) -> "Cache":
        """The Cache in use; it may be one that keeps nothing."""
        return self.precomputed.cache

    @cached_property
    def said(self) -> "Said":
        """What the options say of the captured light. Raises InputError for what cannot be read."""
        given = self.options.captured_sun, self.options.captured_sky, self.options.captured_light
        return Said.read(*given, self.scene.path)

    def under_kept_light(self) -> "Relighter":
        """The same where nothing is said of the captured light but what the folder of the scene keeps."""
        other = copy(self)
        other.said = Said.read(None, None, None, self.scene.path)
        return other

    @property
    def seed(self) -> int:
        """Seed of the ray directions."""
        return self.precomputed.seed

    def plan_for(
        self, environment: "Environment", albedo_linear: NDArray[np.floating] | None = None, angles: int = 1
    ) -> "Plan | None":
        """The Plan for a light in all its rotations, or None without one; made once per image.

        albedo_linear: (V, 3) in [0, 1], white without. angles: the number of lights that share its cost. Until the
        light has been shaded its error is a prediction.
        """
        if self._planner is None or self.options.method not in PLANNED:
            return None
        return self._planner.plan(environment, self._tint(albedo_linear), angles)

    def shade(
        self, environment: "Environment", albedo_linear: NDArray[np.floating] | None = None
    ) -> NDArray[np.float32]:
        """Exit radiance of every vertex, (V, 3) float32 linear: the radiance of `shading`."""
        return self.shading(environment, albedo_linear).radiance

    def shading(
        self,
        environment: "Environment",
        albedo_linear: NDArray[np.floating] | None = None,  # (V, 3) in [0, 1], white without
        settings: Settings | None = None,  # by default as planned or fixed. While chunks move, those of before
    ) -> Shading:
        """Light a scene: a Shading. A new light or rotation costs one product of matrices, a ray for each vertex and
        sun, and a sparse product for each bounce. Where truncated light rings below 0, it is 0.

        Raises InputError for an albedo that is not one colour in [0, 1] per vertex.
        """
        tint, planner = self._tint(albedo_linear), None
        if self._dynamic is not None:
            settings = self._dynamic.settings  # a new light is not planned while chunks move
        elif settings is None:
            planner = self._planner if self.options.method in PLANNED else None
            settings = self._everything if planner is None else planner.settled(environment, tint)
        self._latest = settings
        direct, suns, done = self._direct(environment, settings)
        if not settings.bounce_rays or (self.options.fixed_effects is None and tint is None):
            return Shading(direct if tint is None else direct * tint, suns, [], done)
        radiance, bounces, matrix = self._with_bounces(direct, tint, settings)
        while planner is not None:
            more = planner.bounced(environment, tint, direct, radiance, matrix)
            if more is None:
                break
            settings, done = more, done._replace(bounce_rays=more.bounce_rays)
            self._latest = settings
            radiance, bounces, matrix = self._with_bounces(direct, tint, settings)
        return Shading(radiance, suns, bounces, done)

    def _with_bounces(
        self, direct: NDArray[np.float32], tint: NDArray[np.float32] | None, settings: Settings
    ) -> tuple[NDArray[np.float32], list[float], "Interreflection"]:
        """(exit radiance (V, 3) float32, what each bounce gave, the Interreflection that carried them)."""
        interreflection = self.interreflection(settings.bounce_rays)
        with self.stages.stage("bounces"):
            albedo = np.broadcast_to(np.float32(1.0), direct.shape) if tint is None else tint
            return *with_bounces(direct, albedo, interreflection, settings.bounce_tolerance), interreflection

    def direct(
        self, environment: "Environment", settings: Settings
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Direct light on the white scene, (V, 3) float32, and the part of it that single suns have, None without any.

        settings: of a Shading in that light.
        """
        suns = settings.method != "blinn-phong"
        sunlight = self._direct_light.sunlight(environment, settings) if suns else None
        return self._direct(environment, settings)[0], sunlight

    def posed(self, scene: Scene, settings: Settings) -> "Relighter":
        """That of the same vertices in another pose, under Settings: their light is, to the bit, the same wherever the
        motion does not reach.

        scene: as many vertices in as many chunks; faces may be gone. No plan is made anew, and nothing is kept.
        """
        other = copy(self)
        other.scene, other.precomputed = scene, PosedPrecomputed(self.precomputed, scene)
        other._direct_light = other._lit(StaticGeometry(other.precomputed, self.stages))
        other._everything, other._planner, other._latest = settings, None, None
        return other

    def update(self, chunk: int, vertices: NDArray[np.floating], normals: NDArray[np.floating]) -> NDArray[np.int64]:
        """Move one chunk of the scene; see `update_all`."""
        return self.update_all({chunk: (vertices, normals)})

    def update_all(self, changes: Mapping[int, tuple[NDArray[np.floating], NDArray[np.floating]]]) -> NDArray[np.int64]:
        """Move chunks: the sorted rows, (M,), of vertices whose light may change.

        changes: chunk -> (vertices, normals), (V, 3) both, as many of either as it had, scene frame.
        Only the region that the motion can reach is traced again. Bounces keep the matrix from before the motion until
        `catch_up` is called; a plan's bands and rays stay, with shadows everywhere. Under the methods "analytic" and
        "neural-gash" every moved vertex is computed anew, without rays. The Scene itself is not changed.
        Raises InputError for arrays that do not fit and for the method "blinn-phong".
        """
        check_changes(self.scene, changes)
        if self._dynamic is None or not self._dynamic.moving >= changes.keys():
            self._dynamic = self._in_motion(changes.keys() | (self._dynamic.moving if self._dynamic else set()))
            self._direct_light = self._lit(self._dynamic)
        with self.stages.stage("motion"):
            return self._renewed(*self._dynamic.update(changes))

    def _in_motion(self, moving: AbstractSet[int]) -> "DynamicGeometry | PosedGeometry":
        """The geometry of which these chunks may move, in its present pose."""
        from .dynamic import DynamicGeometry

        before = self._dynamic
        settings = before.settings if before else self._settings_now()
        if self.options.method in PER_VERTEX:
            assert before is None or isinstance(before, PosedGeometry)
            return PosedGeometry(self.scene, moving, settings, before)
        assert before is None or isinstance(before, DynamicGeometry)
        if settings.method != "raytraced":
            if self.options.method != "auto":
                raise InputError(f"the method {settings.method} cannot follow motion; leave it at auto")
            settings = self._everything._replace(method="raytraced", bands=DEFAULT_BANDS, rays=DEFAULT_RAYS)
        settings = settings._replace(volume=0)
        return DynamicGeometry(self.scene, moving, settings, self.seed, before)

    def catch_up(self) -> None:
        """After motion, have light bounce off the present pose."""
        if self._dynamic is not None:
            self._posed = Precomputed(self._dynamic.scene(self.scene), self.seed, None, self.stages)

    def _tint(self, albedo_linear: NDArray[np.floating] | None) -> NDArray[np.float32] | None:
        """The albedo as (V, 3) float32, None where it is white; looked through once, however many lights follow.

        Raises InputError for one that does not fit.
        """
        if albedo_linear is None:
            return None
        if self._albedo is None or self._albedo[0] is not albedo_linear:
            albedo = checked_albedo(albedo_linear, int(self.precomputed.sizes.sum()))
            self._albedo = albedo_linear, None if (albedo == 1.0).all() else albedo
        return self._albedo[1]

    def _direct(self, environment: "Environment", settings: Settings) -> tuple[NDArray[np.float32], int, Settings]:
        """Direct light on the white scene, (V, 3) float32 and never negative; how many suns; the Settings as done."""
        if settings.method != "blinn-phong":
            return self._direct_light.shade(environment, settings)
        with self.stages.stage("shade"):
            return blinn_phong(self.scene.normals, environment), 0, settings

    def _lit(self, geometry: Geometry) -> DirectLight:
        return DirectLight(geometry, self.cache, self.stages)

    def _renewed(self, transfer_rows: NDArray[np.int64], light_rows: NDArray[np.int64]) -> NDArray[np.int64]:
        self._direct_light.renew(transfer_rows)
        return light_rows

    def _settings_now(self) -> Settings:
        return self._latest or self._everything
