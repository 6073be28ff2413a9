"""Facts of a scene before relighting: its surfaces, its captured light, and the fraction that stays."""

import warnings
from collections.abc import Callable
from concurrent.futures import CancelledError
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from splat2mesh.base.beside import Beside
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import clean, sound

from ..engine.appearance import Appearance, Place, appearance_of, bounced_light
from ..engine.exposure import level_of
from ..engine.light_mix import LightKind, LightMix, kind_of
from ..engine.relighter import Relighter
from ..light.environment import Environment
from ..light.loading import light_of
from ..output.pass_views import moved_view
from ..transfer.receivers import EVERY
from ..transfer.store import Cache
from .inputs import Inputs
from .meshing import of_splats

if TYPE_CHECKING:
    from ..engine.relit_room import RelitRoom
    from ..gloss import SceneGloss
    from ..insert.asked import AskedInsert
    from ..insert.objects import InsertedObject
    from ..splats import Binding
    from ..splats.floor_mirror import FloorMirror
    from ..texture import Baked


class KnownScene(Inputs):
    """The part of a relight request that traces no light. Reads on first use."""

    @cached_property
    def scene(self) -> Scene:
        """The scene to light, with a mirrored floor closed."""
        mirror = self.mirror
        if mirror is None or self.splats is None:
            return self.read_scene
        from ..splats.closed_floor import closed_floor

        with self.stages.stage("bind splats"):
            return closed_floor(self.read_scene, mirror, self.splats[0], self._read_cache)

    @cached_property
    def relighter(self) -> Relighter:
        """The Relighter of the scene."""
        self.require("inserted_meshes")  # a broken object fails before any work
        if self.shows_splats:
            self.require("splats")  # so does a missing splat
        self.require("pass_views")
        if "usd" in (self.request.formats or ()):
            from ..output.usd import library

            library()  # so is a package
        alone = self._shows_splats_alone and not self._all_kept
        shown = (lambda: self.binding.used) if alone else None
        made = Relighter(self.scene, self.options, stages=self.stages, cache=self.cache, shown=shown)
        if self.choice_name == "estimated":
            _ = made.said  # or an InputError
        return made

    @property
    def _all_kept(self) -> bool:
        """Whether the cache keeps the light of all vertices, not only of the shown ones."""
        kept = [] if self.cache is None else [each[1:] for each in self.cache.settings_of("bounces")]
        return bool(kept) and all(each == (self.request.lighting.seed, EVERY) for each in kept)

    @cached_property
    def cache(self) -> Cache | None:
        """The cache of computed results, or None."""
        return self._cache_of(self.scene)

    @cached_property
    def _read_cache(self) -> Cache | None:
        """The cache of the scene as read."""
        return self._cache_of(self.read_scene)

    def _cache_of(self, scene: Scene) -> Cache | None:
        return Cache.of_scene(scene, self.request.caching == "read") if self.request.caching != "none" else None

    @cached_property
    def binding(self) -> "Binding":
        """The Binding of the splats. Raises InputError where there are none."""
        from ..splats import Binding

        if self.splats is None:
            raise InputError(f"{self.name}: this scene has no splats")
        with self.stages.stage("bind splats"):
            seed = self.request.lighting.seed
            begun, self._begun_binding = self._begun_binding, None
            binding = begun.result() if begun else Binding(self.splats[0], self.scene, seed=seed, cache=self.cache)
            return binding.mirroring(self.mirror, self.scene)

    _begun_binding: "Beside[Binding] | None" = None

    texture: "Callable[[], Baked | None] | None" = None
    """Return the texture of mesh.glb without captured light; None where it was not begun."""

    def begin(self) -> None:
        """Start a thread that reads or makes what files need and no light changes.

        Damaged splats are bound later, and warn then.
        """
        self.require("relighter")
        if not (self.light_kind is LightKind.CAPTURED or self.options.opened):
            self.relighter.precomputed.begin()
        if self.shows_splats and self.splats is not None:
            from ..splats import Binding

            splats, scene, cache, seed = self.splats[0], self.scene, self.cache, self.request.lighting.seed
            if sound(splats).all():
                asked = splats, scene, None, seed, self._go_on, cache
                self._begun_binding = Beside(lambda: Binding(*asked))
        self.require("appearance")
        if "glb" in self.formats:
            from ..texture import own_texture

            self.texture = Beside(own_texture(self.scene, self.appearance)).result

    _left = False

    def leave(self) -> None:
        """Cancel that thread for a run that ends early: a program waits for its threads."""
        self._left = True

    def _go_on(self, count: int) -> None:
        if self._left:
            raise CancelledError

    @cached_property
    def mirror(self) -> "FloorMirror | None":
        """The floor whose reflection was captured as Gaussians; None without splats or without such a floor."""
        from ..splats.floor_mirror import floor_mirror

        if not self.read_scene.is_place or self.splats is None:
            return None
        with self.stages.stage("bind splats"):
            return floor_mirror(self.splats[0], self.read_scene, self.request.lighting.seed, self._read_cache)

    @property
    def mirrored_floor(self) -> dict[str, Any] | None:
        """The report's entry on a mirrored floor, JSON-clean; None without one."""
        if not self.shows_splats or self.splats is None or self.mirror is None:
            return None
        return self.mirror.as_dict()

    @cached_property
    def gloss(self) -> "SceneGloss | None":
        """The glossy surfaces; None without an estimate of the captured light or without splats that show gloss."""
        if self.choice_name != "estimated" or not self.options.wants_gloss or self.splats is None:
            return None
        from ..gloss import SceneGloss

        return SceneGloss(
            self.scene,
            self.splats[0],
            binding=lambda: self.binding,
            cache=self.cache,
            seed=self.request.lighting.seed,
            stages=self.stages,
        )

    @cached_property
    def appearance(self) -> Appearance:
        """Albedo and captured colours of the surfaces."""
        relighter = self.relighter
        with self.stages.stage("load"):
            capture_env = self._capture_env()
        look = self._retinted(appearance_of(self._choice, capture_env, relighter))
        if self.options.opened:
            return look if look.room is not None else look._replace(place=Place.OPEN)
        shut = look.room is not None and look.room.report["windows"] is None
        return look._replace(place=Place.SHUT) if shut else look

    def _retinted(self, look: Appearance) -> Appearance:
        """The Appearance under a captured light of the requested colour, if any."""
        tint, place = self.request.capture_tint, self.request.white_at
        if tint is None and place is None:
            return look
        from ..engine.tint import color_where_white, retinted

        name = "capture_tint" if place is None else "white_at"
        if look.environment is None or look.place is not Place.OPEN or not (look.capture or {}).get("separable"):
            raise InputError(
                f"`{name}`: it changes the light that a splat of an object or an open place was captured in"
            )
        bounced = bounced_light(self.relighter)
        if place is None:
            return retinted(look, np.asarray(tint, np.float64), bounced)
        matrix = np.asarray(self.scene.scene_from_splat, np.float64)
        at = matrix[:3, :3] @ np.asarray(place) + matrix[:3, 3]
        color = color_where_white(look, bounced, self.scene.vertices, self.scene.diagonal, at)
        return retinted(look, color, bounced)

    @cached_property
    def inserted_meshes(self) -> "dict[AskedInsert, InsertedObject]":
        """The objects that are meshes, read."""
        from ..insert.objects import read_object

        splats = {each for each in self.asked_inserts if not isinstance(each.source, Mesh) and of_splats(each.source)}
        return {each: read_object(each) for each in self.asked_inserts if each not in splats}

    @cached_property
    def room(self) -> "RelitRoom | None":
        """The closed room that the scene is, or None."""
        look, options = self.appearance, self.options
        closed = look.capture is not None and "room" in look.capture
        if options.opened and not closed:
            raise InputError("`opened` ceiling: expected a closed room that was captured from inside, found none")
        room = None
        if closed:
            from ..engine.relit_room import RelitRoom

            brightness = None if look.capture is None else look.capture["brightness"]
            room = RelitRoom(look, self.relighter, level_of(brightness, self.environment))
        if isinstance(options.lamps, tuple):
            _ = room.lamp_factors if room else options.lamp_factors(0)  # or an InputError
        elif options.lamps != "keep" and not (room and room.lamps_found):
            message = "`lamps`: found no lamp of known strength, so none is changed"
            warnings.warn(message, DataWarning, stacklevel=4)
        return room

    @property
    def assumed(self) -> dict[str, Any] | None:
        """The assumption for an environment without a known way in, JSON-clean: the share of the captured
        light that comes from outside, and the factor on it, RGB; None without an assumption."""
        change = self.mix.assumed
        if self.room is None or change is None:
            return None
        return {"outside": self.room.outside, "change": [round(float(each), 4) for each in change]}

    @property
    def lamps_found(self) -> list[dict[str, Any]]:
        """Entries of the report for the captured lamps of a closed room, by number."""
        room = self.appearance.room
        return [] if room is None else list(room.report["lamps"])

    @property
    def light_kind(self) -> LightKind:
        """What the new light is."""
        return kind_of(self.options, self.environment)

    @cached_property
    def mix(self) -> LightMix:
        """All light on the scene."""
        asked = self.options, self.asked_lamps, self.environment
        return LightMix(*asked, self.relighter, self.appearance, self.room, self.request.exposure_ev)

    @cached_property
    def pass_views(self) -> "list[View] | None":
        """The cameras of passes, in the frame of the scene; None for that of the preview."""
        given = self.request.cameras
        if given is None:
            return None
        from splat2mesh.views.cameras import usable_views
        from splat2mesh.views.located import located_views

        if self.splats is not None:
            views = located_views(given, self.splats[1][0], "auto", clean(self.splats[0])[0])
        else:
            views = usable_views(given)
        if not views:
            raise InputError(f"`cameras` {given}: expected cameras that see the scene, found none")
        return [moved_view(view, self.read_scene.scene_from_splat) for view in views]

    def _capture_env(self) -> Environment | None:
        return None if self.request.capture_env is None else light_of(self.request.capture_env)
