"""The gloss of one scene: observed once, kept with the scene, and redrawn in every light."""

from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.progress import Stages
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..sh import harmonics
from ..splats.looks import Looks
from ..transfer.store import Cache, array_key
from .agreement import hints_at_gloss
from .fits import PatchFits, observed
from .gloss_plan import GlossPlan, plan_gloss
from .material import Gloss, materials
from .reflections import Reflections
from .views import outer_looks

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.placed import LampLight
    from ..engine.relighter import Shaded
    from ..splats.binding import Binding

LEAST_DEGREE = 2
"""Least degree of a splat's harmonics: degree 1 shows its brighter side, but no lobe."""


class NewLight(NamedTuple):
    """Light that glossy surfaces mirror. light: (K, 3) SH coefficients of the environment in display units, frame of
    the scene. radiance: (V, 3) that vertices send out, received: (V, 3) irradiance, both display units once times
    exposure. unit: display units per unit of the picture, of lamps and captured light. captured: factor on it. lamps:
    LampLight of placed lamps, or None."""

    light: NDArray[np.float64]
    radiance: NDArray[np.float32]
    received: NDArray[np.floating]
    exposure: float
    unit: float = 1.0
    captured: float = 0.0
    lamps: "LampLight | None" = None

    @classmethod
    def of(cls, shaded: "Shaded", received: NDArray[np.float32], lamps: "LampLight | None" = None) -> "NewLight":
        """That of a Shaded, whose surfaces receive an irradiance (V, 3), beside lamps."""
        exposure, unit = shaded.exposure, shaded.exposure / shaded.level
        light = shaded.environment * exposure * shaded.light.sh(harmonics.MAX_BANDS)
        return cls(light, shaded.shading.radiance, received, exposure, unit, shaded.captured, lamps)


class SceneGloss:
    """The gloss of a scene that was made from splats.

    splats: as read. binding: returns their Binding. cache: for the observations, or None.
    """

    def __init__(
        self,
        scene: Scene,
        splats: Splats,
        binding: Callable[[], "Binding"],
        cache: Cache | None,
        seed: int,
        stages: Stages,
    ) -> None:
        self._scene, self._splats, self._binding = scene, splats, binding
        self._cache, self._seed, self._stages = cache, seed, stages
        self._reflections: Reflections | None = None

    @cached_property
    def fits(self) -> PatchFits | None:
        """The reflections that pictures of the splat show; None where its harmonics show too little."""
        if self._splats.degree < LEAST_DEGREE:
            return None
        found = self._kept
        if found is None:
            colors, looks = self._scene.colors_srgb.astype(np.float64) / 255.0, self._looks
            with self._stages.stage("observe gloss"):
                found = observed(self._binding(), looks, self._rotation, colors, self._seed)
            if found is not None and self._cache is not None:
                self._cache.put("reflections", *self._key, **found._asdict())
        return found if found is not None and hints_at_gloss(found) else None

    @property
    def known(self) -> bool:
        """Whether `fits` takes no work."""
        return self._splats.degree < LEAST_DEGREE or self._kept is not None or "fits" in self.__dict__

    def of(self, look: "Appearance") -> Gloss | None:
        """The Gloss of the scene under its captured light, or None without gloss."""
        separable = look.capture is None or bool(look.capture["separable"])
        if look.environment is None or look.room is not None or look.as_captured or not separable or self.fits is None:
            return None
        return materials(self.fits, look.environment.sh(harmonics.MAX_BANDS))

    def relit(self, look: "Appearance", relit: Splats, new: NewLight) -> Splats:
        """Relit splats with the reflections of a NewLight.

        relit: as `Binding.relit` gives them for the irradiance that it receives.
        """
        gloss = self.of(look)
        looks = None if gloss is None else self._looks
        if gloss is None or looks is None or look.environment is None:
            return relit
        binding, lamps, exposure = self._binding(), new.lamps, new.exposure
        reflections = self._traced(looks, gloss)
        with self._stages.stage("gloss"):
            own = look.environment.sh(harmonics.MAX_BANDS)
            before, light = reflections.reflected(own, look.captured), new.light + new.captured * new.unit * own
            after = reflections.reflected(light, new.radiance * np.float32(exposure))
            if lamps is not None and new.unit:
                frame = np.asarray(self._scene.scene_from_splat, np.float64)
                shining = reflections.shining(lamps.emitters, lamps.frame, frame)
                after = [each + new.unit * more for each, more in zip(after, shining, strict=True)]
            log_gain = binding.log_gains(look.irradiance, new.received, exposure)
            return reflections.relit(relit, log_gain, before, after)

    def roughness(self, look: "Appearance") -> NDArray[np.float32] | None:
        """(V,) of the vertices, as glTF has it: the root of alpha, 1 where it is matt. None where nothing is glossy."""
        gloss = self.of(look)
        if gloss is None:
            return None
        rough = np.where(gloss.glossy, np.sqrt(gloss.alpha), np.float32(1.0))
        return rough.astype(np.float32)[self._binding().surface.node]

    def plan(self, look: "Appearance") -> GlossPlan | None:
        """Contribution and cost of gloss; None without gloss. It traces the rays that a light needs next."""
        gloss = self.of(look)
        looks = None if gloss is None else self._looks
        if gloss is None or looks is None or look.environment is None:
            return None
        own = look.environment.sh(harmonics.MAX_BANDS)
        make = partial(Reflections, self._binding(), looks, gloss, self._rotation)
        with self._stages.stage("plan"):
            self._reflections, found = plan_gloss(make, gloss, own, look.captured)
        return found

    def as_dict(self, look: "Appearance") -> dict[str, Any] | None:
        """The entry of the report, JSON-clean; None without gloss."""
        gloss = self.of(look)
        if gloss is None:
            return None
        rows = gloss.glossy
        return {
            "surface": round(float(rows.mean()), 4),
            "reflectance": _median(gloss.reflectance[rows]),
            "alpha": round(float(np.median(gloss.alpha[rows])), 3),
        }

    def _traced(self, looks: Looks, gloss: Gloss) -> Reflections:
        """The Reflections, whose rays are traced once."""
        if self._reflections is None:
            with self._stages.stage("trace gloss"):
                self._reflections = Reflections(self._binding(), looks, gloss, self._rotation)
        return self._reflections

    @cached_property
    def _looks(self) -> Looks | None:
        """Of a place those of the fit; of an object its own, kept beside them."""
        binding, cache = self._binding(), self._cache
        with self._stages.stage("look at gloss"):
            if cache is None or self._scene.is_place or binding.looks is None:
                return outer_looks(binding, self._scene)
            count, on = len(binding.sketch), binding.surface
            looks = cache.restored(lambda kept: Looks.restored(kept, count, on), "looks", *self._key)
            if looks is None and (looks := outer_looks(binding, self._scene)) is not None:
                cache.put("looks", *self._key, **looks.arrays(on))
            return looks

    @cached_property
    def _key(self) -> tuple[str, int]:
        return array_key(self._splats.means, self._scene.colors_srgb), self._seed  # the source is known by its SHA-256

    @cached_property
    def _kept(self) -> PatchFits | None:
        if self._cache is None or self._splats.degree < LEAST_DEGREE:
            return None
        return self._cache.restored(PatchFits.restored, "reflections", *self._key)

    @property
    def _rotation(self) -> NDArray[np.float64]:
        linear = np.asarray(self._scene.scene_from_splat, np.float64)[:3, :3]
        return linear / np.cbrt(np.linalg.det(linear))


def _median(values: NDArray[np.float32]) -> list[float] | None:
    """Of each colour (3,), JSON-clean; None of none."""
    return np.median(values, axis=0).round(4).tolist() if len(values) else None
