"""Gloss of a whole scene: a glazed ball, whose Gaussians have harmonics of degree 3, under its own and other lights."""

import numpy as np
import pytest

from relight.engine.appearance import Appearance
from relight.engine.relighter import Shaded, Shading
from relight.gloss import SceneGloss
from relight.gloss.ggx import fresnel_rise, zonal_factors
from relight.gloss.scene_gloss import NewLight
from relight.light.environment import Environment
from relight.options import LightingOptions
from relight.sh import harmonics
from relight.splats import Binding
from relight.transfer.store import Cache
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.harmonics import sh_basis_3dgs
from splat2mesh.splats.splats import SH_C0, Splats

REFLECTANCE, ALPHA = 0.06, 0.15
SETTINGS = LightingOptions().unplanned


def window(way, strength=12.0):
    """An Environment: dim, and a wide bright spot in one direction."""
    rows, columns = 32, 64
    polar = (np.arange(rows) + 0.5) / rows * np.pi
    turn = (np.arange(columns) + 0.5) / columns * 2 * np.pi - np.pi
    # canonical lat-long: row 0 is +y, the centre looks at +z, +x a quarter from the left
    x = -np.sin(polar)[:, None] * np.sin(turn)
    z = np.sin(polar)[:, None] * np.cos(turn)
    directions = np.stack([x, np.broadcast_to(np.cos(polar)[:, None], x.shape), z], axis=2)
    way = np.asarray(way, float) / np.linalg.norm(way)
    return Environment(0.5 + strength * np.exp(12.0 * (directions @ way - 1.0))[..., None] * np.ones(3), "window")


OLD, NEW = window((0.6, 0.7, 0.4)), window((-0.7, 0.5, 0.5))


def normals_of(count, seed=0):
    rng = np.random.default_rng(seed)
    found = rng.normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def irradiance(light, normals):
    """Irradiance over pi."""
    bent = harmonics.convolve(light.sh(5)) / np.pi
    return np.maximum(harmonics.evaluate(normals, 5) @ bent, 0.0)


def captured(light, normals, colors, reflectance):
    """(N, 16, 3) harmonics of Gaussians on a ball, as a perfect training would find them."""
    degree, _ = harmonics.degrees_and_orders(10)
    blurred = zonal_factors(ALPHA, 10)[degree][:, None] * light.sh(10)
    rng = np.random.default_rng(1)
    sh = np.zeros((len(normals), 16, 3))
    diffuse = colors * irradiance(light, normals)
    for row, normal in enumerate(normals):
        toward = rng.normal(size=(48, 3))
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        toward *= np.sign(toward @ normal)[:, None]
        cosine = toward @ normal
        mirrored = 2 * cosine[:, None] * normal - toward
        rise = np.minimum(reflectance * fresnel_rise(cosine, np.zeros(48, bool)), 1.0)[:, None]
        shown = srgb_from_linear(diffuse[row] + rise * np.maximum(harmonics.evaluate(mirrored, 10) @ blurred, 0.0))
        weight = np.sqrt(cosine)[:, None]
        basis = sh_basis_3dgs(-toward, 3)
        square = (basis * weight).T @ (basis * weight) + np.diag([0.0] + 15 * [0.1])
        sh[row] = np.linalg.solve(square, (basis * weight).T @ ((shown - 0.5) * weight))
    return sh


class Ball:
    """Gaussians on a ball of known gloss, captured under OLD, and what its mesh knows."""

    def __init__(self, reflectance, count=3000):
        import open3d as o3d

        normals = normals_of(count)
        self.normals, self.reflectance = normals, reflectance
        self.colors = np.where(normals[:, :1] > 0.0, [[0.1, 0.3, 0.12]], [[0.3, 0.12, 0.1]])
        quats = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(count)], axis=1)
        self.layout = normals, np.tile([0.05, 0.05, 0.002], (count, 1)), quats, np.full(count, 0.95)
        self.splats = self.under(OLD)
        mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 30)
        points = np.asarray(mesh.vertices, np.float32)
        self.points = points / np.linalg.norm(points, axis=1, keepdims=True)
        self.albedo = np.where(self.points[:, :1] > 0.0, [[0.1, 0.3, 0.12]], [[0.3, 0.12, 0.1]])
        before = irradiance(OLD, self.points)
        shown = bytes_from_unit(srgb_from_linear(self.albedo * before))
        self.scene = Scene.from_mesh(Mesh(points, self.points, np.asarray(mesh.triangles), shown), 40_000)
        self.look = Appearance(
            self.albedo.astype(np.float32),
            self.scene.colors_linear,
            before.astype(np.float32),
            environment=OLD,
        )
        self.binding = Binding(self.splats, self.scene)

    def under(self, light):
        return Splats(*self.layout, captured(light, self.normals, self.colors, self.reflectance))

    def gloss(self, cache=None):
        return SceneGloss(self.scene, self.splats, lambda: self.binding, cache, 0, Stages())

    def relit(self, light, gloss=None):
        """The splats under a light, with gloss that moves or without."""
        after = irradiance(light, self.points).astype(np.float32)
        found = self.binding.relit(self.look.irradiance, after)
        if gloss is None:
            return found
        radiance = (self.albedo * after).astype(np.float32)
        shaded = Shaded(light, Shading(radiance, 0, [], SETTINGS), 1.0)
        return gloss.relit(self.look, found, NewLight.of(shaded, after))


def pictures(splats):
    eyes = [(3.0, 1.5, 1.0), (-2.0, 1.5, 2.5), (0.5, 2.5, -2.5), (0.0, 0.8, 3.4)]
    views = [View.look_at(eye, (0, 0, 0), (0, 1, 0), 45, 96) for eye in eyes]
    return np.stack([np.clip(rasterize(splats, view).color, 0, 1) for view in views])


def psnr(one, other):
    return -10 * np.log10(np.mean((one - other) ** 2))


@pytest.fixture(scope="module")
def glazed():
    return Ball(REFLECTANCE)


@pytest.fixture(scope="module")
def matte():
    return Ball(0.0)


def test_reflectance_and_roughness_of_a_captured_ball_are_found(glazed):
    found = glazed.gloss().of(glazed.look)
    rows = found.glossy
    assert rows.mean() > 0.5  # of below no picture is taken
    # Degree 3 holds three quarters of a lobe this sharp.
    assert REFLECTANCE / 2 < np.median(found.reflectance[rows]) < 1.3 * REFLECTANCE
    assert np.median(found.alpha[rows]) < 0.5 and not np.median(found.flat[rows])


def test_highlights_move_to_where_the_new_light_puts_them(glazed):
    gloss, truth = glazed.gloss(), pictures(glazed.under(NEW))
    stayed, moved = pictures(glazed.relit(NEW)), pictures(glazed.relit(NEW, gloss))
    assert psnr(moved, truth) > psnr(stayed, truth) + 2.0
    # What the highlight adds follows the truth; the old one is gone.
    bare = pictures(Ball(0.0).under(NEW))
    added = [(each - bare).ravel() for each in (truth, stayed, moved)]
    assert np.corrcoef(added[0], added[2])[0, 1] > max(0.8, np.corrcoef(added[0], added[1])[0, 1] + 0.2)


def test_pictures_of_an_object_are_drawn_once_for_all_lights(glazed, tmp_path, monkeypatch):
    cache = Cache(tmp_path, "a ball")
    first = glazed.relit(NEW, glazed.gloss(cache))
    with monkeypatch.context() as only:
        only.setattr("relight.gloss.scene_gloss.outer_looks", lambda *_: pytest.fail("they are drawn again"))
        again = glazed.relit(NEW, glazed.gloss(cache))
    np.testing.assert_array_equal(again.sh, first.sh)
    (kept,) = tmp_path.glob("looks-*")
    kept.write_bytes(kept.read_bytes()[:-200])  # damaged: drawn anew
    np.testing.assert_array_equal(glazed.relit(NEW, glazed.gloss(cache)).sh, first.sh)


def test_under_the_light_of_the_capture_no_bit_changes(glazed):
    gloss = glazed.gloss()
    nothing = Shading(np.zeros_like(glazed.look.captured), 0, [], SETTINGS)
    found = glazed.binding.relit(glazed.look.irradiance, glazed.look.irradiance)
    own = Shaded(OLD, nothing._replace(radiance=glazed.look.captured), 1.0, environment=0.0, captured=1.0)
    kept = gloss.relit(glazed.look, found, NewLight.of(own, glazed.look.irradiance))
    np.testing.assert_array_equal(kept.sh, glazed.splats.sh)


def test_a_matte_ball_keeps_every_bit(matte):
    gloss = matte.gloss()
    assert gloss.of(matte.look) is None and gloss.as_dict(matte.look) is None
    plain = matte.relit(NEW)
    np.testing.assert_array_equal(matte.relit(NEW, gloss).sh, plain.sh)


@pytest.mark.slow
def test_what_was_observed_is_kept_and_damage_is_observed_anew(glazed, tmp_path):
    cache = Cache(tmp_path, "a ball")
    first = glazed.gloss(cache)
    assert not first.known
    fits = first.fits
    assert fits is not None
    again = glazed.gloss(cache)
    assert again.known
    np.testing.assert_array_equal(again.fits.moments, fits.moments)
    (kept,) = tmp_path.glob("reflections-*")
    kept.write_bytes(kept.read_bytes()[:-200])
    third = glazed.gloss(cache)
    assert not third.known
    np.testing.assert_array_equal(third.fits.moments, fits.moments)


def test_splats_without_harmonics_show_no_gloss(glazed):
    plain = Splats(*glazed.layout, glazed.splats.sh[:, :4])
    gloss = SceneGloss(glazed.scene, plain, lambda: pytest.fail("bound for nothing"), None, 0, Stages())
    assert gloss.known and gloss.fits is None and gloss.of(glazed.look) is None
    assert np.abs(plain.sh[:, 0]).max() * SH_C0 < 2.0


@pytest.mark.parametrize(
    ("effects", "wanted"), [("auto", True), ("none", False), ("shadows,gloss", True), ("shadows,sun,bounces", False)]
)
def test_gloss_is_an_effect_like_the_others(effects, wanted):
    options = LightingOptions(effects=effects)
    assert options.wants_gloss == wanted
    assert "gloss" not in options.chosen_effects  # it is none of the light on the mesh
    if effects == "shadows,gloss":
        assert options.unplanned == LightingOptions(effects="shadows").unplanned
    with pytest.raises(InputError, match="gloss"):
        LightingOptions(effects="glos")
