"""Write what is live, once for a scene: the bundle that loaders read, and the page that relights."""

from splat2mesh.render.raycaster import RayCaster

from ..engine.assumed_light import assumed_exposure
from ..light import SUN_TOLERANCE
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..live.bundle import write_bundle
from ..live.lights import PortableLight, captured_alone, light_of, offered_lights
from ..live.live import Live, LiveScene, live_of
from ..live.objects import LiveObjects, movables_of, objects_of
from ..live.page import write_page
from ..live.parts import LiveParts
from ..live.terms import sources_of
from ..options import PLACE_TOLERANCE
from ..output.catcher import Catcher
from ..output.inserted_glb import inserted_glb
from ..transfer.settings import BOUNCE_RAYS, BOUNCE_TOLERANCE, BOUNCES, Settings
from .job import Job
from .part_lights import kept_live_parts
from .relit_source import RelitSource
from .scene_files import LitFolder


class LiveFiles:
    """Writes live.json with its files, and the page. job: of the first light. source: of that. lights: beside it."""

    def __init__(self, job: Job, source: RelitSource, lights: list[Environment]) -> None:
        self._job, self._source, self._known = job, source, job.known
        self._relighter, self._appearance = job.known.relighter, job.known.appearance
        # The captured light has a place of its own.
        self._others = [each for each in lights if not isinstance(each, CapturedLight)]
        self._mix, self._room, self._exposed = job.mix, job.mix.room, job.mix.exposure_ev is not None
        self._live: dict[bool, Live] = {}

    def write(self, into: LitFolder) -> list[str]:
        """Write them, with their entry in the report; returns the names of the files."""
        folder, light, kinds = into.path, into.shaded.light, self._job.inputs.formats
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
        relit = self._source.relit(shaded) if into.relit is None else into.relit
        content = inserted_glb(shaded.inserted, shaded.exposure)
        movable = movables_of(shaded.inserted, shaded.exposure)
        return objects_of(self._source.without_objects(shaded), relit, content, shaded.light.rotation_deg, movable)

    def _prepared(self, light: Environment) -> Live:
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
                else:
                    radiance = None if as_captured else self._relighter.shading(each, albedo, traced).radiance
                    exposure = self._mix.level(radiance, each) if mixes else self._mix.exposure_of(each, radiance)
                lights.append(self._portable(each, exposure))
            splats, gloss, asked = self._job.inputs.shown_splats, self._known.gloss, self._job.request
            assert splats is not None  # else nobody asks
            shown = LiveScene(
                self._relighter,
                self._appearance,
                splats,
                self._room,
                sources_of(self._mix) if mixes else (),
                None if gloss is None else gloss.of(self._appearance),
                self._mix.assumes,
                self._known.mirror,
            )
            tolerance, seed = asked.lighting.tolerance or PLACE_TOLERANCE, asked.lighting.seed
            found = live_of(shown, lights, settings, tolerance, asked.sky, seed)
            offered = offered_lights(self._relighter, self._appearance)
            parts = LiveParts.of(kept_live_parts(self._job), found.order)
            scene, ground = self._known.scene, None
            if not scene.is_place:  # which has its own
                ground = Catcher(scene, RayCaster(scene.vertices, scene.faces)).ground()
            found = found._replace(ground=ground, offered=offered, parts=parts)
            self._live[mixes] = self._mixed(found) if mixes else found
        return self._live[mixes]

    def _shown(self, light: Environment, exposure: float) -> PortableLight:
        """The light that is shown first, not turned, and what is beside it."""
        if isinstance(light, CapturedLight):
            return captured_alone(self._mix.under(light).captured_factor, exposure)
        found = self._portable(light.rotated(-light.rotation_deg), exposure)
        if self._mix.assumes or not self._mix.under(light).kind.adds:
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

    def _beside(self, found: PortableLight, light: Environment, unit: float = 1.0) -> PortableLight:
        """A Light with the light beside it. An environment without effect shows only through windows."""
        captured = self._mix.under(light).captured_factor
        scale = captured if self._appearance.as_captured else self._mix.options.env_scale
        return found._replace(captured=captured, unit=unit).times(scale)

    def _portable(self, light: Environment, exposure: float) -> PortableLight:
        """A light of a result at an exposure, with the factor on the lamps of a room."""
        room, capture = self._room, self._appearance.capture
        known = room is not None and room.lamps_found
        if self._mix.assumes:  # that exposure is of all that is shown
            assert room is not None
            lamps = exposure * room.lamp_factor if known else 0.0
            return light_of(light, exposure * assumed_exposure(light, self._mix.options.env_scale), lamps)
        lamps, captured = 0.0, self._appearance.as_captured and self._mix.under(light).kind.adds
        if room is not None and known and capture is not None and not captured:
            mean = light.mean_luminance
            lamps = room.lamp_factor * (exposure * mean / capture["brightness"] if mean > 0.0 else 1.0)
        return light_of(light, exposure, lamps)

    def _settings(self, light: Environment) -> Settings:
        """The settings of the first light's plan; other lights are unknown, so bounces are always included."""
        options = self._relighter.options
        if self._appearance.as_captured:
            return options.unplanned
        settings = self._relighter.shading(light, self._appearance.albedo).settings
        if settings.rays and BOUNCES in options.chosen_effects and not settings.bounce_rays:
            if self._appearance.albedo is not None:
                settings = settings._replace(bounce_rays=BOUNCE_RAYS, bounce_tolerance=BOUNCE_TOLERANCE)
        return settings
