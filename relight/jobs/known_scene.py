"""Facts of a scene before relighting: its surfaces, its captured light, and the fraction that stays."""

from collections.abc import Callable
from concurrent.futures import CancelledError
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask, Radiance
from splat2mesh.base.beside import Beside
from splat2mesh.base.errors import InputError
from splat2mesh.options import ConvertOptions
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_parts
from splat2mesh.splats.cleaning import clean, sound
from splat2mesh.views.cameras import usable_views
from splat2mesh.views.located import located_views

from ..engine.appearance import Appearance, Place, appearance_of, bounced_light
from ..engine.relighter import Relighter
from ..engine.tint import color_where_white, retinted
from ..gloss import SceneGloss
from ..insert.asked import AskedInsert
from ..insert.inserts import Inserts
from ..insert.objects import read_object, splat_object
from ..light import CAPTURED
from ..light.environment import Environment
from ..light.loading import light_of
from ..output.picture import in_frame
from ..request import RelightRequest
from ..splats import Binding
from ..splats.closed_floor import closed_floor
from ..splats.floaters import floaters
from ..splats.floor_mirror import floor_mirror
from ..splats.part_spec import SplatFile
from ..splats.parts import PartShares
from ..texture import own_texture
from ..transfer.receivers import EVERY
from ..transfer.store import Cache
from .inputs import Inputs
from .meshing import is_scene, of_splats, scene_at_hand

if TYPE_CHECKING:
    from ..insert.objects import InsertedObject
    from ..splats.floor_mirror import FloorMirror
    from ..texture import Baked


class KnownScene:
    """What a relight request knows of its scene, whatever the new light. Each part is found on first use."""

    def __init__(self, inputs: Inputs) -> None:
        self.inputs, self._request, self._stages = inputs, inputs.request, inputs.stages

    @cached_property
    def scene(self) -> Scene:
        """The scene to light, with a mirrored floor closed."""
        mirror = self.mirror
        if mirror is None or self.inputs.splats is None:
            return self.inputs.read_scene
        with self._stages.stage("bind splats"):
            return closed_floor(self.inputs.read_scene, mirror, self.inputs.splats[0], self._read_cache)

    @cached_property
    def relighter(self) -> Relighter:
        """The Relighter of the scene."""
        _ = self.inserted_meshes  # a broken object fails before any work
        if self.inputs.shows_splats:
            _ = self.inputs.splats  # so does a missing splat
        _ = self._parts  # and a part that is not there
        _ = self.pass_views
        if "usd" in (self._request.formats or ()):
            from ..output.usd import library

            library()  # so is a package
        kept = [] if self.cache is None else [each[1:] for each in self.cache.settings_of("bounces")]
        # Where the cache keeps the light of all vertices, none is left out.
        all_kept = bool(kept) and all(each == (self._request.lighting.seed, EVERY) for each in kept)
        alone = self.inputs.shows_splats_alone and not all_kept
        shown = (lambda: self.binding.used) if alone else None
        made = Relighter(self.scene, self.inputs.options, stages=self._stages, cache=self.cache, shown=shown)
        if self.inputs.choice_name == "estimated":
            _ = made.said  # or an InputError
        return made

    @cached_property
    def cache(self) -> Cache | None:
        """The cache of computed results, or None."""
        return self._cache_of(self.scene)

    @cached_property
    def _read_cache(self) -> Cache | None:
        """The cache of the scene as read."""
        return self._cache_of(self.inputs.read_scene)

    def _cache_of(self, scene: Scene) -> Cache | None:
        return Cache.of_scene(scene, self._request.caching == "read") if self._request.caching != "none" else None

    @cached_property
    def binding(self) -> Binding:
        """The Binding of the splats. Raises InputError where there are none."""
        if self.inputs.splats is None:
            raise InputError(f"{self.inputs.name}: this scene has no splats")
        with self._stages.stage("bind splats"):
            seed = self._request.lighting.seed
            begun, self._begun_binding = self._begun_binding, None
            binding = (
                begun.result() if begun else Binding(self.inputs.splats[0], self.scene, seed=seed, cache=self.cache)
            )
            return binding.mirroring(self.mirror, self.scene)

    _begun_binding: "Beside[Binding] | None" = None

    texture: "Callable[[], Baked | None] | None" = None
    """Return the texture of mesh.glb without captured light; None where it was not begun."""

    def begin(self, traces: bool) -> None:
        """Start a thread that reads or makes what files need and no light changes.

        traces: whether rays will be. Damaged splats are bound later, and warn then.
        """
        relighter = self.relighter
        if traces:
            relighter.precomputed.begin()
        if self.inputs.shows_splats and self.inputs.splats is not None:
            splats, scene, cache, seed = self.inputs.splats[0], self.scene, self.cache, self._request.lighting.seed
            if sound(splats).all():
                asked = splats, scene, None, seed, self._go_on, cache
                self._begun_binding = Beside(lambda: Binding(*asked))
        appearance = self.appearance
        if "glb" in self.inputs.formats:
            self.texture = Beside(own_texture(self.scene, appearance)).result

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
        if not self.inputs.read_scene.is_place or self.inputs.splats is None:
            return None
        with self._stages.stage("bind splats"):
            return floor_mirror(self.inputs.splats[0], self.inputs.read_scene, self._read_cache)

    @property
    def mirrored_floor(self) -> dict[str, Any] | None:
        """The report's entry on a mirrored floor, JSON-clean; None without one."""
        return self.mirror.as_dict() if self.inputs.shows_splats and self.mirror is not None else None

    @property
    def part(self) -> PartShares | None:
        """The part that takes the new light, or all but the one that keeps the captured light; None for all."""
        return None if self.inputs.asked_part is None else self._parts[0]

    @property
    def lit_parts(self) -> list[PartShares]:
        """The parts in lights of their own."""
        return self._parts[len(self._parts) - len(self.inputs.lit_parts) :]

    @cached_property
    def _parts(self) -> list[PartShares]:
        """The requested parts, as of `Inputs.asked_parts`; without splats of those that are known of vertices alone."""
        found = []
        for asked in self.inputs.asked_parts:
            file, shares = None, None
            if (self.inputs.shows_splats or asked.needs_splats) and self.inputs.splats is not None:
                splats, paths = self.inputs.splats
                file = SplatFile(splats, paths[0] if len(paths) == 1 else None, self._rows_of_objects)
                shares = asked.of_splats(file)
            found.append(PartShares.of(asked, self.scene, file, shares))
        return found

    def _rows_of_objects(self) -> dict[str, slice]:
        """Rows of the splats of each object of a layout, by its name; none without a layout."""
        scene = self.inputs.read_scene
        if "objects" not in scene.source:
            return {}
        found, start = {}, 0
        for each in source_parts(scene, self._request.splat):
            found[each.name] = slice(start, start + len(each.splats))
            start += len(each.splats)
        return found

    @cached_property
    def gloss(self) -> SceneGloss | None:
        """The glossy surfaces; None without an estimate of the captured light or without splats that show gloss."""
        if self.inputs.choice_name != "estimated" or not self.inputs.options.wants_gloss or self.inputs.splats is None:
            return None
        return SceneGloss(
            self.scene,
            self.inputs.splats[0],
            binding=lambda: self.binding,
            cache=self.cache,
            seed=self._request.lighting.seed,
            stages=self._stages,
        )

    @cached_property
    def appearance(self) -> Appearance:
        """Albedo and captured colours of the surfaces."""
        relighter = self.relighter
        with self._stages.stage("load"):
            known = self.capture_env()
        look = self._retinted(appearance_of(self.inputs.choice, known, relighter))
        shut = look.room is not None and look.room.report["windows"] is None
        return look._replace(place=Place.SHUT) if shut else look

    @property
    def albedo(self) -> Radiance:
        """(V, 3) linear, white where it is that."""
        look = self.appearance
        return np.ones_like(look.captured) if look.albedo is None else look.albedo

    @property
    def roughness(self) -> NDArray[np.float32] | None:
        """(V,) as glTF has it; None without gloss."""
        return None if self.gloss is None else self.gloss.roughness(self.appearance)

    @cached_property
    def kept_splats(self) -> Mask:
        """(N,) bool: the splats that are no floaters."""
        assert self.inputs.shown_splats is not None  # else nobody asks
        with self._stages.stage("floaters"):
            kept = np.ones(len(self.inputs.shown_splats), bool)
            kept[floaters(self.inputs.shown_splats, self.scene)] = False
            return kept

    @property
    def has_appearance(self) -> bool:
        """Whether these were found already."""
        return "appearance" in vars(self)

    def _retinted(self, look: Appearance) -> Appearance:
        """The Appearance under a captured light of the colour that makes a requested place white, if any."""
        place = self._request.white_at
        if place is None:
            return look
        if look.environment is None or look.place is not Place.OPEN or not (look.capture or {}).get("separable"):
            raise InputError(
                "`white_at`: it changes the light that a splat of an object or an open place was captured in"
            )
        bounced, matrix = bounced_light(self.relighter), np.asarray(self.scene.scene_from_splat, np.float64)
        at = matrix[:3, :3] @ np.asarray(place) + matrix[:3, 3]
        color = color_where_white(look, bounced, self.scene.vertices, self.scene.diagonal, at)
        return retinted(look, color, bounced)

    @cached_property
    def inserted_meshes(self) -> dict[AskedInsert, "InsertedObject"]:
        """The objects that are meshes, read."""
        splats = {
            each for each in self.inputs.asked_inserts if not isinstance(each.source, Mesh) and of_splats(each.source)
        }
        return {each: read_object(each) for each in self.inputs.asked_inserts if each not in splats}

    @property
    def lamps_found(self) -> list[dict[str, Any]]:
        """Entries of the report for the captured lamps of a closed room, by number."""
        room = self.appearance.room
        return [] if room is None else list(room.report["lamps"])

    @cached_property
    def inserts(self) -> Inserts | None:
        """The inserted objects at their positions, or None."""
        asked = self.inputs.asked_inserts
        if not asked:
            return None
        return Inserts(asked, self.relighter, lambda: self.appearance, lambda: list(map(self._object_of, asked)))

    def _object_of(self, asked: AskedInsert) -> "InsertedObject":
        """A requested object. A splat is meshed first, like a scene, and its captured light is removed."""
        if asked in self.inserted_meshes:
            return self.inserted_meshes[asked]
        folder, source, at_hand = asked.source, asked.source, None
        if not isinstance(source, Mesh) and not is_scene(source):
            at_hand, _ = scene_at_hand(source, ConvertOptions(), self._stages)
            folder = at_hand.folder
        request = RelightRequest(folder, CAPTURED, formats=("splat",))
        own = KnownScene(Inputs(request, self._stages, at_hand))
        splats = own.inputs.splats
        assert splats is not None  # or an InputError
        return splat_object(asked.name, own.scene, own.binding, len(splats[0]), own.appearance)

    @cached_property
    def pass_views(self) -> "list[View] | None":
        """The cameras of passes, in the frame of the scene; None for that of the preview."""
        given = self._request.cameras
        if given is None:
            return None
        if self.inputs.splats is not None:
            views = located_views(given, self.inputs.splats[1][0], "auto", clean(self.inputs.splats[0])[0])
        else:
            views = usable_views(given)
        if not views:
            raise InputError(f"`cameras` {given}: expected cameras that see the scene, found none")
        splat_from_scene = np.linalg.inv(self.inputs.read_scene.scene_from_splat)
        return [in_frame(view, splat_from_scene)[0] for view in views]

    def capture_env(self) -> Environment | None:
        """The known light of the capture, if there is one."""
        return None if self._request.capture_env is None else light_of(self._request.capture_env)
