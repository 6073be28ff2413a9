"""Write what is live, once for a scene: the bundle that loaders read, and the page that relights."""

from typing import TYPE_CHECKING

from splat2mesh.render.raycaster import RayCaster

from ..engine.assumed_light import assumed_exposure
from ..light import SUN_TOLERANCE
from ..light.loading import CapturedLight
from ..live.bundle import write_bundle
from ..live.ground import ShadowedGround
from ..live.lights import PortableLight, captured_alone, light_of, offered_lights
from ..live.live import Live, LiveScene, LiveSettings, live_of
from ..live.objects import LiveObjects, movables_of, objects_of
from ..live.page import write_page
from ..live.parts import LiveParts
from ..live.terms import sources_of
from ..options import PLACE_TOLERANCE
from ..transfer.settings import BOUNCE_RAYS, BOUNCE_TOLERANCE, BOUNCES, Settings
from .catcher import Catcher
from .inserted_glb import inserted_glb
from .relit_splats import RelitSource
from .subject import LitFolder, WrittenScene

if TYPE_CHECKING:
    from ..light.environment import Environment


class LiveFiles:
    """Writes live.json with its files, and the page. relit: of the same scene."""

    def __init__(self, written: WrittenScene, relit: RelitSource) -> None:
        assert written.source is not None and written.mix is not None  # else nobody asks
        self._written, self._relit, self._splats = written, relit, written.source
        self._relighter, self._appearance = written.relighter, written.appearance
        # The captured light has a place of its own.
        self._others = [each for each in written.asked.lights if not isinstance(each, CapturedLight)]
        self._mix, self._room, self._exposed = written.mix, written.mix.room, written.mix.exposure_ev is not None
        self._live: dict[bool, Live] = {}

    def write(self, into: LitFolder) -> list[str]:
        """Write them, with their entry in the report; returns the names of the files."""
        folder, light, kinds = into.path, into.shaded.light, self._written.asked.kinds
        objects = self._objects(into)
        live = self._prepared(light)
        others = [each for each in live.lights if each.name != light.name]
        live = live._replace(lights=[self._shown(light, into.shaded.exposure), *others])
        if objects is not None:
            live = live._replace(objects=objects.in_order(live.order))
        names = []
        with self._relighter.stages.stage("write"):
            if "live" in kinds:
                (folder / "live").mkdir()
                names += [f"live/{name}" for name in write_bundle(folder / "live", live)]
            if "web" in kinds:
                names += write_page(folder, live, light.rotation_deg)
        tried = live.errors[-1]
        into.facts["live"] = {"splats": len(live.splats), "bytes": tried["bytes"], "error": round(tried["error"], 5)}
        return names

    def _objects(self, into: LitFolder) -> LiveObjects | None:
        """The inserted objects in the form of the page and the bundle, or None."""
        shaded = into.shaded
        if shaded.inserted is None:
            return None
        relit = self._relit.relit(shaded) if into.relit is None else into.relit
        content = inserted_glb(shaded.inserted, shaded.exposure)
        movable = movables_of(shaded.inserted, shaded.exposure)
        return objects_of(self._relit.without_objects(shaded), relit, content, shaded.light.rotation_deg, movable)

    def _prepared(self, light: "Environment") -> Live:
        """All but how the light that is shown first is exposed."""
        mixes = self._mix.under(light).kind.adds
        if mixes not in self._live:
            others = {each.name: each for each in self._others}
            settings = self._settings(next(iter(others.values())) if isinstance(light, CapturedLight) else light)
            albedo, traced = self._appearance.albedo, settings._replace(sun_tolerance=SUN_TOLERANCE)
            as_captured = self._room is not None and self._room.exposure is not None
            lights = []
            for each in others.values():
                if self._mix.assumes:
                    exposure = self._mix.exposure_of(each, None) if self._exposed else 1.0
                    lights.append((each, *self._assumed_light(each, exposure)))
                    continue
                radiance = None if as_captured else self._relighter.shading(each, albedo, traced).radiance
                exposure = self._mix.level(radiance, each) if mixes else self._mix.exposure_of(each, radiance)
                lights.append((each, exposure, self._lamps(each, exposure)))
            shown = LiveScene(
                self._relighter,
                self._appearance,
                self._splats,
                self._room,
                sources_of(self._mix) if mixes else (),
                None if self._written.gloss is None else self._written.gloss.of(self._appearance),
                self._mix.assumes,
                self._written.mirror(),
            )
            asked = self._written.asked
            how = LiveSettings(asked.tolerance or PLACE_TOLERANCE, asked.sky, asked.seed)
            found = live_of(shown, lights, settings, how)
            offered = offered_lights(self._relighter, self._appearance)
            parts = LiveParts.of(self._written.kept_parts(), found.order)
            found = found._replace(ground=self._ground(), offered=offered, parts=parts)
            self._live[mixes] = self._mixed(found) if mixes else found
        return self._live[mixes]

    def _ground(self) -> ShadowedGround | None:
        """The ground under an object, as in its picture; None in a place, which has its own."""
        scene = self._relighter.scene
        return None if scene.is_place else Catcher(scene, RayCaster(scene.vertices, scene.faces)).ground()

    def _shown(self, light: "Environment", exposure: float) -> PortableLight:
        """The light that is shown first, not turned, and what is beside it."""
        if isinstance(light, CapturedLight):
            return captured_alone(self._mix.under(light).captured_factor, exposure)
        if self._mix.assumes:
            return light_of(light.rotated(-light.rotation_deg), *self._assumed_light(light, exposure))
        found = light_of(light.rotated(-light.rotation_deg), exposure, self._lamps(light, exposure))
        if not self._mix.under(light).kind.adds:
            return found
        if not self._exposed:
            return self._beside(found, light)
        known = self._room is not None and self._room.exposure is not None
        radiance = None if known else self._relighter.shading(light, self._appearance.albedo).radiance
        return self._beside(found, light, exposure / self._mix.level(radiance, light))

    def _mixed(self, live: Live) -> Live:
        """A Live whose lights have the requested light beside them, and the captured light."""
        by_name = {each.name: each for each in self._others}
        lights = live.lights
        if not self._mix.assumes:  # by which no light has another beside it
            lights = [self._beside(each, by_name[each.name]) for each in lights]
        alone = captured_alone(self._mix.under(CapturedLight()).captured_factor)
        return live._replace(lights=[*lights, alone])

    def _beside(self, found: PortableLight, light: "Environment", unit: float = 1.0) -> PortableLight:
        """A Light with the light beside it. An environment without effect shows only through windows."""
        captured = self._mix.under(light).captured_factor
        scale = captured if self._appearance.as_captured else self._mix.options.env_scale
        return found._replace(captured=captured, unit=unit).times(scale)

    def _assumed_light(self, light: "Environment", exposure: float) -> tuple[float, float]:
        """Display value per radiance by that assumption, and the factor on lamps, of what is shown at an exposure."""
        assert self._room is not None
        lamps = self._room.lamp_factor if self._room.lamps_found else 0.0
        return exposure * assumed_exposure(light, self._mix.options.env_scale), exposure * lamps

    def _lamps(self, light: "Environment", exposure: float) -> float:
        """Factor on the light of a room's lamps, at the exposure of a light beside it."""
        capture, room = self._appearance.capture, self._room
        if (
            room is None
            or not room.lamps_found
            or capture is None
            or (self._appearance.as_captured and self._mix.under(light).kind.adds)
        ):
            return 0.0
        mean = light.mean_luminance
        return room.lamp_factor * (exposure * mean / capture["brightness"] if mean > 0.0 else 1.0)

    def _settings(self, light: "Environment") -> Settings:
        """The settings of the first light's plan; other lights are unknown, so bounces are always included."""
        options = self._relighter.options
        if self._appearance.as_captured:
            return options.unplanned
        settings = self._relighter.shading(light, self._appearance.albedo).settings
        if settings.rays and BOUNCES in options.chosen_effects and not settings.bounce_rays:
            if self._appearance.albedo is not None:
                settings = settings._replace(bounce_rays=BOUNCE_RAYS, bounce_tolerance=BOUNCE_TOLERANCE)
        return settings
