"""Gloss of generated tables, whose light, mesh and materials are known: what is found, and what splats gain."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from relight.engine.appearance import Appearance
from relight.engine.relighter import Shaded, Shading
from relight.gloss import SceneGloss
from relight.gloss.scene_gloss import NewLight
from relight.light.environment import Environment
from relight.options import LightingOptions
from relight.splats import Binding
from scenes import bake, capture_views, seen_faces
from scenes.cameras import SCENE_FROM_SPLAT
from scenes.ceramics import ceramics
from scenes.highlights import glossy_splats
from splat2mesh.base.progress import Stages
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

VERTICES = 12_000
SETTINGS = LightingOptions().unplanned


class Table:
    """A table under the light of a studio, its splats there and at sunset, and what would be known of it at best."""

    def __init__(self, seed, glossy=True, splats=6000):
        truth = self.truth = ceramics(seed, VERTICES, glossy)
        self.views = capture_views(truth, 48)
        seen = seen_faces(truth, self.views)
        self.seen = np.zeros(len(truth.vertices), bool)
        self.seen[truth.faces[seen]] = True
        lights = [Environment.load(name) for name in ("studio", "sunset")]
        (self.splats, self.relit_truth), factors = glossy_splats(truth, lights, self.views, splats, seed, seen)
        self.lights = [Environment(f * light.radiance, light.name) for f, light in zip(factors, lights, strict=True)]
        # A mesh knows no metal: it takes what is reflected for albedo.
        self.albedo = np.maximum(truth.albedo_linear, truth.reflectance * truth.metal[:, None])
        white = ceramics(seed, VERTICES, glossy)
        white.albedo_linear[:] = 1.0
        self.irradiance = [bake(white, light) for light in self.lights]
        captured = (self.albedo * self.irradiance[0]).astype(np.float32)
        shown = bytes_from_unit(srgb_from_linear(np.clip(captured, 0, 1)))
        mesh = Mesh(truth.vertices, truth.normals, truth.faces, shown)
        self.scene = Scene.from_mesh(mesh, 40_000, scene_from_splat=SCENE_FROM_SPLAT)
        self.look = Appearance(self.albedo, captured, self.irradiance[0], environment=self.lights[0])
        self.binding = Binding(self.splats, self.scene)
        self.gloss = SceneGloss(self.scene, self.splats, lambda: self.binding, None, 0, Stages())

    def relit(self, number, moved):
        """The splats under a light, with gloss that moves or that stays."""
        after = self.irradiance[number]
        found = self.binding.relit(self.look.irradiance, after)
        if not moved:
            return found
        shading = Shading((self.albedo * after).astype(np.float32), 0, [], SETTINGS)
        return self.gloss.relit(self.look, found, NewLight.of(Shaded(self.lights[number], shading, 1.0), after))

    def psnr(self, splats):
        """Against the splats that were trained at sunset, dB."""
        views = [view.resized(128) for view in self.views[4::8]]
        one, other = (
            np.stack([np.clip(rasterize(each, view).color, 0, 1) for view in views])
            for each in (splats, self.relit_truth)
        )
        return -10 * np.log10(np.mean((one - other) ** 2))

    def nearest(self):
        """(M,) the vertex of the truth at each node."""
        surface = self.binding.surface
        return cKDTree(self.truth.vertices * [1, -1, -1]).query(surface.points)[1]


@pytest.fixture(scope="module")
def table():
    return Table(301)


@pytest.mark.slow
def test_what_shines_is_found_and_what_is_matte_stays_so(table):
    found, nodes = table.gloss.of(table.look), table.nearest()
    seen = table.seen[nodes]
    glossy, matte = table.truth.glossy[nodes] & seen, ~table.truth.glossy[nodes] & seen
    # A third of what shines mirrors other things; of what is matte, patches that reach into shining things are taken.
    assert found.glossy[glossy].mean() > 0.3 and found.glossy[matte].mean() < 0.15


def test_metals_reflect_more_than_glazes_do(table):
    found, nodes = table.gloss.of(table.look), table.nearest()
    metal = table.truth.metal[nodes] & found.glossy
    glaze = table.truth.glossy[nodes] & ~table.truth.metal[nodes] & found.glossy
    f0 = found.reflectance.mean(axis=1)
    assert np.median(f0[metal]) > 2 * np.median(f0[glaze])
    assert 0.02 < np.median(f0[glaze]) < 0.08  # .035 to .06 in truth


def test_splats_come_nearer_to_the_truth(table):
    stays, moves = table.psnr(table.relit(1, False)), table.psnr(table.relit(1, True))
    assert moves > stays + 0.3
    assert stays > table.psnr(table.splats) + 3.0


def test_under_the_captured_light_no_bit_changes(table):
    nothing = Shading(table.look.captured, 0, [], SETTINGS)
    own = Shaded(table.lights[0], nothing, 1.0, environment=0.0, captured=1.0)
    found = table.binding.relit(table.look.irradiance, table.look.irradiance)
    kept = table.gloss.relit(table.look, found, NewLight.of(own, table.look.irradiance))
    np.testing.assert_array_equal(kept.sh, table.splats.sh)


@pytest.mark.slow
def test_the_same_table_without_gloss_keeps_every_bit():
    matte = Table(303, glossy=False, splats=2000)
    assert matte.gloss.of(matte.look) is None
    np.testing.assert_array_equal(matte.relit(1, True).sh, matte.relit(1, False).sh)
