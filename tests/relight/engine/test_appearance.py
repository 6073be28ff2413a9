"""What `--albedo` names: colours given, colours read, and colours with the light of the capture taken out."""

import numpy as np
import pytest

from relight import Environment, Relighter
from relight.engine.appearance import appearance_of
from relight.transfer.store import Cache, geometry_key
from scenes import build
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def captured_mesh(kind, seed, light, shift=(0, 0, 0)):
    """A generated scene as a capture under a light shows it, and its true albedo."""
    truth = build(kind, seed, 2_000)
    mesh = Mesh(
        truth.vertices + np.float32(shift), truth.normals, truth.faces, np.zeros(truth.vertices.shape, np.uint8)
    )
    radiance = Relighter(Scene([mesh]), rays=64).shade(Environment.load(light), truth.albedo_linear)
    shown = radiance * (0.9 / np.quantile(radiance, 0.99))
    mesh.colors_srgb[:] = bytes_from_unit(srgb_from_linear(np.clip(shown, 0.0, 1.0)))
    return mesh, truth.albedo_linear


def error(found, true):
    """Relative L2, one gain for each colour."""
    gain = (found * true).sum(axis=0) / (found * found).sum(axis=0)
    return np.linalg.norm(gain * found - true) / np.linalg.norm(true)


@pytest.fixture(scope="module")
def table():
    return captured_mesh("tabletop", 3, "sunset")


@pytest.fixture(scope="module")
def relighter(table):
    return Relighter(Scene([table[0]]))


def test_the_light_of_the_capture_is_taken_out(table, relighter):
    look = appearance_of("estimated", None, relighter)
    captured = linear_from_srgb(table[0].colors_srgb / 255.0)
    # .65 as captured, .13 estimated, .10 in the known light were measured.
    assert error(look.albedo, table[1]) < 0.35 * error(captured, table[1])
    known = appearance_of("estimated", Environment.load("sunset"), relighter)
    assert error(known.albedo, table[1]) < 0.25 * error(captured, table[1])
    assert look.capture["separable"] and look.capture["light"] == "estimated" and known.capture["light"] == "sunset"
    # Lit by what it received it sends out what was captured, but for where the albedo is held back.
    ratio = look.albedo * look.irradiance / np.maximum(captured, 1e-3)
    assert np.median(np.abs(np.log(np.maximum(ratio, 1e-6)))) < 0.05


def test_an_estimate_is_kept_and_comes_back_to_the_bit(table, tmp_path):
    scene = Scene([table[0]])
    looks, rays = [], []
    for _ in range(2):
        again = Relighter(scene, cache=Cache(tmp_path, geometry_key(scene)))
        looks.append(appearance_of("estimated", None, again))
        rays.append(again.rays_traced)
    assert rays[0] > 0 and rays[1] == 0
    for name in ("albedo", "irradiance"):
        np.testing.assert_array_equal(getattr(looks[0], name), getattr(looks[1], name))
    assert looks[0].capture == looks[1].capture


def test_an_estimate_does_not_depend_on_what_was_traced_before(table, tmp_path):
    """More rays in memory, more rays kept, rays that are no multiple of its own: the same bytes."""
    scene = Scene([table[0]])
    fresh = appearance_of("estimated", None, Relighter(scene))
    for rays, bounces, bands in ((256, 64, 10), (48, 20, 8), (100, 32, 6)):
        kept = Cache(tmp_path / str(rays), geometry_key(scene))
        before = Relighter(scene, rays=rays, bands=bands, cache=kept)
        before.precomputed.interreflection(bounces, before.transfer)
        for relighter in (before, Relighter(scene, cache=kept)):
            kept.drop("albedo", *next(iter(kept.settings_of("albedo")), ()))
            look = appearance_of("estimated", None, relighter)
            np.testing.assert_array_equal(look.albedo, fresh.albedo)
            np.testing.assert_array_equal(look.irradiance, fresh.irradiance)
            assert look.capture == fresh.capture


def test_every_object_of_a_layout_is_taken_out_of_its_own_light(table):
    other, _ = captured_mesh("tabletop", 5, "noon", (9.0, 0.0, 0.0))
    objects = [{"name": "one", "chunks": [0, 1]}, {"name": "two", "chunks": [1, 2]}]
    joint = Relighter(Scene([table[0], other], source={"objects": objects}))
    look = appearance_of("estimated", None, joint)
    count = len(table[0].vertices)
    for part, mesh in ((slice(0, count), table[0]), (slice(count, None), other)):
        alone = appearance_of("estimated", None, Relighter(Scene([mesh])))
        np.testing.assert_array_equal(look.albedo[part], alone.albedo)
        np.testing.assert_array_equal(look.irradiance[part], alone.irradiance)


def test_light_that_cannot_be_separated_stays_as_captured_with_a_warning():
    u, v = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 1, 20)))
    vertices = np.stack([u, 0 * u, v], axis=1).astype(np.float32)
    corner = (np.arange(19)[:, None] * 20 + np.arange(19)).reshape(-1, 1)
    faces = (corner + np.array([0, 20, 21, 0, 21, 1])).reshape(-1, 3).astype(np.int32)
    colors = np.random.default_rng(0).integers(30, 200, vertices.shape).astype(np.uint8)
    plane = Mesh(vertices, np.tile(np.float32([0, 1, 0]), (len(u), 1)), faces, colors)
    with pytest.warns(DataWarning, match="could not be separated"):
        look = appearance_of("estimated", None, Relighter(Scene([plane])))
    assert not look.capture["separable"] and look.capture["reason"]
    captured = linear_from_srgb(colors / 255.0)
    assert error(look.albedo, captured) < 0.05  # but for the darkest, which no surface is


def test_given_colours_leave_their_irradiance(table, relighter, tmp_path):
    captured = linear_from_srgb(table[0].colors_srgb / np.float32(255.0))
    as_captured, white = (appearance_of(choice, None, relighter) for choice in ("captured", "white"))
    np.testing.assert_array_equal(as_captured.albedo, captured)
    assert white.albedo is None
    np.testing.assert_array_equal(white.irradiance, captured)
    np.save(tmp_path / "half.npy", np.full(captured.shape, 0.5))
    half = appearance_of(str(tmp_path / "half.npy"), None, relighter)
    np.testing.assert_allclose(half.irradiance, 2 * captured, rtol=1e-6)
    for look in (as_captured, white, half):
        assert look.capture is None and look.prior is None
    with pytest.raises(InputError, match="`capture_env`"):
        appearance_of("white", Environment.load("noon"), relighter)
