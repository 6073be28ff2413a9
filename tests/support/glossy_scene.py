"""The ball above a plate of `live_scene`, glazed, and the bundle of it."""

from functools import cache

import numpy as np
from live_scene import LIGHTS, SETTINGS, live_scene

from relight import Environment, LightingOptions
from relight.engine.light_mix import LightMix
from relight.gloss import Gloss
from relight.lamps.asked import AskedLamp, Brightness
from relight.lamps.shapes import RectangleLamp, SphereLamp, moved
from relight.light.loading import CapturedLight
from relight.live.lights import light_of
from relight.live.live import LiveScene, live_of
from relight.live.terms import sources_of
from relight.splats import Binding

OWN = "studio"


def glaze(scene, splats):
    """(Binding, Gloss): the ball reflects, its lower half like a metal; the plate is matt."""
    binding = Binding(splats, scene, views=())
    height = scene.vertices[:, 1]
    height = binding.surface.of_vertices(height[:, None].astype(np.float64))[:, 0]
    reflectance = np.where((height > 0.2)[:, None], 0.05, 0.0) * np.ones(3)
    metal = (height > 0.2) & (height < 0.8)
    reflectance[metal] = 0.5, 0.4, 0.2
    alpha = np.where(metal, 0.3, 0.1).astype(np.float32)
    reflectance = reflectance.astype(np.float32)
    return binding, Gloss(reflectance, alpha, metal, np.ones(len(alpha), np.float32))


@cache
def glossy_scene():
    """(Scene, Appearance, Splats, Gloss, Live) of it, captured under a studio."""
    relighter, look, splats, _ = live_scene()
    look = look._replace(environment=Environment.load(OWN))
    gloss = glaze(relighter.scene, splats)[1]
    lights = [light_of(Environment.load(name), 0.7) for name in LIGHTS]
    live = live_of(LiveScene(relighter, look, splats, gloss=gloss), lights, SETTINGS)
    return relighter.scene, look, splats, gloss, live


BULB = SphereLamp((1.6, 2.4, 1.4), 0.15, (90.0, 60.0, 20.0))
PANEL = RectangleLamp((-0.4, 1.8, 0.2), (0.0, 0.0, 0.4), (0.4, 0.4, 0.0), (0.0, 30.0, 60.0), two_sided=True)

NAMES = "bulb", "panel"


@cache
def glossy_scene_with_lamps():
    """(Live, lamps in the frame of the scene): it beside a bulb and a panel, with a fifth of the captured light."""
    relighter, _, splats, _ = live_scene()
    _, look, _, gloss, _ = glossy_scene()
    lamps, back = [BULB, PANEL], np.linalg.inv(relighter.scene.scene_from_splat)
    asked = [
        AskedLamp(moved(lamp, back), Brightness(1.0, "picture"), name=name)
        for lamp, name in zip(lamps, NAMES, strict=True)
    ]
    mix = LightMix(LightingOptions(tolerance=0.05, captured=0.2), asked, CapturedLight(), relighter, look)
    shown = LiveScene(relighter, look, splats, sources=sources_of(mix), gloss=gloss)
    lights = [light_of(Environment.load(name), 0.7) for name in LIGHTS]
    live = live_of(shown, lights, SETTINGS)
    return live._replace(lights=[each._replace(captured=0.2, unit=0.7) for each in live.lights]), lamps
