"""Splats of places that are hard on light, from the capture to the relit file: nothing but leaves, a black cabinet."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial import cKDTree

from relight import Environment, LightingOptions
from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.splats import Binding
from scenes import capture_views
from scenes.cameras import SCENE_FROM_SPLAT
from scenes.capture import SOLID, capture
from scenes.places import build_place
from scenes.places.hard import BLACK
from scenes.radiosity import light
from splat2mesh.render.thickness import optical_depth
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.scene.measured import Measured
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0

VERTICES, SPLATS = 2500, 2500


pytestmark = pytest.mark.usefixtures("fewer_samples")


@cache
def captured(kind):
    """(Place, Capture under an overcast sky, Scene of its true mesh, which knows its leaves) of a hard place."""
    place = build_place(kind, 1, VERTICES)
    lighting = light(place, Environment.load("overcast"))
    made = capture(place, lighting, capture_views(place, 16), SPLATS, 1)
    colors = bytes_from_unit(srgb_from_linear(np.clip(made.exposure * lighting.radiance(), 0.0, 1.0)))
    mesh = Mesh(place.vertices, place.normals, place.faces, colors)
    scene = Scene([mesh], scene_from_splat=SCENE_FROM_SPLAT, capture={"from": "outside"})
    leafy = place.volume.astype(np.float32)
    corners = place.faces[np.maximum(made.faces, 0), 0]
    of_splats = np.where(made.faces >= 0, leafy[corners], 0.0).astype(np.float32)
    depth = optical_depth(made.splats, of_splats, SCENE_FROM_SPLAT) if leafy.any() else None
    scene.measured = Measured(None, of_splats, leafy, depth)
    return place, made, scene


@cache
def relit(kind, env="sunset", **known):
    """Display colours (N, 3), clipped, of the splats as captured, as relit and as they truly are in a new light."""
    place, made, scene = captured(kind)
    sky = Environment.load(env)
    job = Job(RelightRequest(scene, sky, LightingOptions(tolerance=0.2), albedo="estimated", caching="none", **known))
    shaded, look = next(iter(job.shaded())), job.known.appearance
    after = look.received(shaded.shading.radiance * np.float32(made.exposure))
    found = Binding(made.splats, scene, views=()).relit(look.irradiance, after)
    shown = made.splats, found, made.lit(light(place, sky))
    return tuple(np.clip(SH_C0 * splats.sh[:, 0] + 0.5, 0.0, 1.0) for splats in shown)


def off(colors, truth):
    """How far display colours are from true ones, root mean square, after one gain of light for each colour."""
    colors, true = linear_from_srgb(colors), linear_from_srgb(truth)
    gain = (colors * true).sum(axis=0) / np.square(colors).sum(axis=0)
    return np.sqrt(np.square(srgb_from_linear(np.clip(gain * colors, 0.0, 1.0)) - truth).mean())


def sparkle(before, after, means):
    """Mean difference between neighbours of the logarithm of what light changed colours by."""
    change = np.log((after + 0.05) / (before + 0.05))
    near = cKDTree(means).query(means, 7)[1][:, 1:]
    return np.abs(change[near] - change[:, None]).mean()


def test_a_forest_comes_back_in_its_own_light_and_does_not_sparkle_in_another():
    _, made, scene = captured("forest")
    lit = scene.measured.splat_volume == 1.0
    assert scene.measured.foliage.min() == 1.0 and lit.mean() > 0.5  # nothing has a normal
    before, after, _ = relit("forest", "overcast", capture_env="overcast")
    assert off(before[lit], after[lit]) < 0.08  # no sky shows the exposure of the known light, and a forest is dark
    before, after, truth = (colors[lit] for colors in relit("forest"))
    assert np.isfinite(after).all() and after.std() > 0.02
    means = made.splats.means[lit]
    assert sparkle(before, after, means) < sparkle(before, truth, means) / 3.0
    assert off(after, truth) < 1.15 * off(before, truth)  # flecks of sun are finer than the grid


def test_a_black_cabinet_stays_black_and_what_stands_around_it_is_relit():
    place, made, _ = captured("cabinet")
    before, after, truth = relit("cabinet")
    lit = made.region == SOLID
    black = lit & (made.albedo(place).max(axis=1) < 1.5 * BLACK)
    assert black.sum() > 100 and np.isfinite(after).all()
    assert after[black].max() < 0.4 and after[black].mean() < 1.5 * truth[black].mean()
    assert off(after[lit], truth[lit]) < 0.8 * off(before[lit], truth[lit])
