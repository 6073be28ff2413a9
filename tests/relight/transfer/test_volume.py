"""Light in leaves and grass: Beer-Lambert by closed forms, energy, the grid made of splats, the effect as a whole."""

import math
from dataclasses import replace

import numpy as np
import pytest

from relight.albedo.direct import direct_light
from relight.engine.relighter import Relighter
from relight.light.environment import Environment, Suns
from relight.planning.sample import Sample
from relight.transfer import volume
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.settings import Settings
from relight.transfer.volume import Foliage, transmittance
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.render import thickness
from splat2mesh.render.thickness import optical_depth
from splat2mesh.scene.measured import Measured
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.optical_depth import MOST, OpticalDepth
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

CELL = 0.05
THIN = MOST * (32 / 255) ** 2  # .126, which is kept without rounding
DIRECTIONS = fibonacci_sphere(500)


def filled(inside, half=1.0, per_cell=2 * THIN, levels=1):
    """OpticalDepth of boxes of a half side, twice as wide each, whose cells hold `per_cell` where `inside` is true."""
    origins, cells, grids = [], [], []
    for level in range(levels):
        cell, count = CELL * 2**level, round(2 * half / CELL)
        middle = (np.arange(count) + 0.5) * cell - half * 2**level
        at = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1)
        origins.append(np.full(3, -half * 2**level))
        cells.append(cell)
        grids.append(np.where(inside(at), np.float32(per_cell * 2**level), np.float32(0.0)))
    return OpticalDepth.of_levels(origins, cells, grids)


def test_a_slab_is_beer_lambert():
    slab = filled(lambda at: np.abs(at[..., 1]) < 0.3, per_cell=THIN)
    up = DIRECTIONS[DIRECTIONS[:, 1] > 0.75]  # leaves the box by its top
    found = transmittance(slab, np.array([[0.0, -0.6, 0.0]]), up)[0]
    expected = np.exp(-THIN / CELL * 0.6 / up[:, 1])
    # A step of one cell more or less: at most so much of the depth.
    assert np.abs(np.log(found / expected)).max() <= THIN + 1e-5
    assert found.mean() == pytest.approx(expected.mean(), rel=0.01)


@pytest.mark.parametrize("levels", [1, 3])
def test_a_sphere_is_beer_lambert_from_anywhere_in_it(levels):
    radius, dense = 0.8, THIN / CELL
    sphere = filled(lambda at: np.linalg.norm(at, axis=-1) < radius, per_cell=THIN, levels=levels)
    places = np.array([[0.0, 0.0, 0.0], [0.3, 0.2, -0.1], [0.0, 0.7, 0.0]])
    found = transmittance(sphere, places, DIRECTIONS)
    along = places @ DIRECTIONS.T
    length = -along + np.sqrt(along**2 - (places**2).sum(axis=1)[:, None] + radius**2)
    expected = np.exp(-dense * np.maximum(length - volume.CLEARANCE * CELL, 0.0))
    assert np.abs(found - expected).max() < 0.25 * levels**0.5
    np.testing.assert_allclose(found.mean(axis=1), expected.mean(axis=1), rtol=0.04)


def leaves(depth, share=1.0, count=200):
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (count, 3))
    return Foliage(points, np.full(count, share), depth)


def test_what_nothing_hides_sends_on_a_constant_sky():
    transfer = leaves(filled(lambda at: at[..., 0] > 9)).mixed(np.zeros((200, 25), np.float32))
    np.testing.assert_allclose(transfer[:, 0], 1 / math.sqrt(4 * math.pi), rtol=1e-5)  # float32 sums of 256
    assert np.abs(transfer[:, 1:]).max() < 2e-3  # sums of harmonics over 256 directions


def test_no_light_is_made_and_opaque_leaves_are_dark():
    for per_cell, most in ((0.2, 0.9), (MOST, 0.05)):
        thick = leaves(filled(lambda at: np.abs(at).max(axis=-1) < 0.8, per_cell=per_cell))
        visible = thick.mixed(np.zeros((200, 1), np.float32))[:, 0] * math.sqrt(4 * math.pi)
        assert (visible >= 0.0).all() and visible.max() <= 1.0 and visible.mean() < most


def test_suns_come_through_the_same_grid():
    foliage = leaves(filled(lambda at: np.abs(at[..., 1] - 0.8) < 0.1, per_cell=THIN))
    sun = Suns(np.array([[0.0, 1.0, 0.0]]), np.array([[3.0, 2.0, 1.0]]))
    light = foliage.with_suns(np.zeros((200, 3), np.float32), sun)
    np.testing.assert_allclose(light, np.exp(-4 * THIN) * sun.weights / (4 * np.pi) * np.ones((200, 1)), rtol=1e-5)


def test_surfaces_keep_every_bit_and_mixtures_are_shares():
    depth = filled(lambda at: np.abs(at[..., 1] - 0.8) < 0.1)
    points = np.random.default_rng(1).uniform(-0.6, 0.6, (4, 3))
    foliage = Foliage(points, np.array([0.0, 0.01, 0.5, 1.0]), depth)
    surfaces = np.random.default_rng(2).normal(size=(4, 9)).astype(np.float32)
    mixed = foliage.mixed(surfaces.copy())
    own = Foliage(points, np.array([0.0, 0.01, 1.0, 1.0]), depth).mixed(surfaces.copy())
    assert np.array_equal(mixed[:2], surfaces[:2]) and np.array_equal(mixed[3], own[3])
    np.testing.assert_allclose(mixed[2], (surfaces[2] + own[2]) / 2, rtol=1e-5)
    assert foliage.solid.tolist() == [True, True, True, False]


def test_neighbours_take_the_same_light_whatever_their_normals():
    """Between leaves of one crown the change of light is smooth: no leaf of another colour than the one beside it."""
    bush = filled(lambda at: np.linalg.norm(at, axis=-1) < 0.7)
    near = np.array([0.1, 0.6, 0.0]) + np.random.default_rng(0).normal(scale=0.01, size=(50, 3))
    transfer = Foliage(near, np.ones(50), bush).mixed(np.zeros((50, 16), np.float32))
    assert (transfer.std(axis=0) / transfer[:, 0].mean()).max() < 0.06


def lawn(count=4000, solid=0.9):
    """Splats of a lawn of blades that face every way, y down, over 4 by 4 units."""
    random = np.random.default_rng(0)
    means = random.uniform([-2, -0.1, -2], [2, 0.0, 2], (count, 3))
    quats = random.normal(size=(count, 4))
    return Splats(
        means, np.tile([0.05, 0.03, 0.004], (count, 1)), quats, np.full(count, solid), np.zeros((count, 1, 3))
    )


FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def test_the_grid_of_a_lawn_lets_no_light_in_from_below():
    depth = optical_depth(lawn(), np.ones(4000), FLIP)
    below = fibonacci_sphere(300)
    free = transmittance(depth, np.array([[0.0, 0.25, 0.0], [0.5, 0.35, 0.1]]), below)
    assert free[:, below[:, 1] > 0.5].min() > 0.8 and free[:, below[:, 1] < -0.7].max() < 0.01


def test_thicker_splats_take_more_light(monkeypatch):
    monkeypatch.setattr(thickness, "OCCUPIED", np.inf)  # no ground
    straight = np.array([[0.0, -1.0, 0.0]])
    free = []
    for opacity in (0.1, 0.3, 0.6):
        depth = optical_depth(lawn(2000, opacity), np.ones(2000), FLIP)
        above = np.random.default_rng(0).uniform(-1.5, 1.5, (400, 3)) * [1, 0, 1] + [0, 0.6, 0]
        free.append(transmittance(depth, above, straight).mean())
    # A splat of opacity a takes half of a 2 pi s1 s2, as it is turned any way; 2,000 of them lie on 16 units.
    expected = [np.exp(-a * np.pi * 0.05 * 0.03 * 2000 / 16) for a in (0.1, 0.3, 0.6)]
    assert free[0] > free[1] > free[2]
    np.testing.assert_allclose(np.log(free), np.log(expected), rtol=0.25)  # clumps let more light through


def thicket(share=1.0, seed=0):
    """A Scene of scattered triangles that face every way, with what is measured of it as leaves."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-0.5, 0.5, (300, 1, 3))
    corners = (middle + random.normal(scale=0.05, size=(300, 3, 3))).astype(np.float32)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), 3, axis=0).astype(np.float32)
    mesh = Mesh(corners.reshape(-1, 3), normals, np.arange(900).reshape(-1, 3).astype(np.int32), None)
    depth = filled(lambda at: np.abs(at).max(axis=-1) < 0.5, per_cell=0.2)
    scene = Scene([replace(mesh, colors_srgb=np.full((900, 3), 128, np.uint8))])
    scene.measured = Measured(None, np.zeros(0, np.float32), np.full(900, share, np.float32), depth)
    return scene


def sky():
    image = np.full((16, 32, 3), 0.3)
    image[:4, 8:14] = [4.0, 3.0, 1.0]
    return Environment(image)


def test_the_plan_finds_leaves_and_what_it_does_is_the_reference():
    scene = thicket()
    relighter = Relighter(scene, tolerance=0.05)
    found = relighter.shading(sky())
    plan = relighter.plan_for(sky())
    rows = {row[0]: row for row in plan.contributions}
    assert found.settings.volume and "volume" in found.settings.effects and rows["volume"][1] > 0.1
    assert "vertices" in rows["volume"][2] and plan.checked < 0.05
    some = slice(0, 900, 7)
    truth = reference(relighter.occluder, some, sky(), 2048, relighter.precomputed.foliage)
    off = np.linalg.norm(found.radiance[some] - truth) / np.linalg.norm(truth)
    assert off < 1.1 * 0.05  # of the error's square, a sample of a hundred is a fifth off
    assert "volume" in "\n".join(plan.table())


def test_without_the_effect_leaves_are_surfaces():
    bare = replace(thicket(), measured=None)
    plain = Relighter(bare, effects="shadows", rays=16, bands=3).shade(sky())
    assert np.array_equal(Relighter(thicket(), effects="shadows", rays=16, bands=3).shade(sky()), plain)
    given = Relighter(bare, effects="shadows,volume", rays=16, bands=3).shading(sky())
    assert np.array_equal(given.radiance, plain) and not given.settings.volume  # a scene that has none
    leafy = Relighter(thicket(), effects="shadows,volume", rays=16, bands=3).shading(sky())
    assert leafy.settings.volume and np.ptp(leafy.radiance[:, 0]) < 0.7 * np.ptp(plain[:, 0])  # half of it is even


def test_the_light_of_the_capture_passes_the_same_leaves_as_a_new_one():
    """Else a scene in its own light would change, and its leaves most."""
    image = np.full((16, 32, 3), 0.3)
    image[3, 10] = 300.0
    light, settings = Environment(image), Settings("raytraced", 8, 64, bounce_rays=8, volume=256)
    relighter = Relighter(thicket(), effects="shadows,sun,bounces,volume")
    known = relighter.transport(settings)
    lit = relighter.shading(light, settings=settings._replace(bounce_rays=0, sun_tolerance=0.007)).radiance
    again = direct_light(relighter.occluder, known.transfer, light, known.sunlit)
    np.testing.assert_allclose(again, lit, atol=0.02 * lit.max())  # the sun is split off by other tolerances
    on_surfaces = direct_light(relighter.occluder, known.transfer, light)
    assert np.abs(on_surfaces - lit).mean() > 5.0 * np.abs(again - lit).mean()


def test_the_furnace_stays_within_one():
    """Under a white sky, leaves among surfaces neither make nor keep more light than comes."""
    scene = thicket(0.5)
    lit = Relighter(scene, effects="shadows,bounces,volume", rays=32, bands=3)
    light = lit.shade(Environment(np.ones((8, 16, 3))), np.ones((900, 3), np.float32))
    assert light.max() <= 1.0 + 1e-3


def test_the_reference_marches_to_every_part_of_the_light():
    scene = thicket()
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    foliage = Foliage(scene.vertices, np.ones(900, np.float32), scene.measured.depth)
    light = reference(occluder, slice(0, 5), Environment(np.ones((8, 16, 3))), 512, foliage)
    share, free, _ = foliage.seen(np.arange(5), fibonacci_sphere(2000))
    assert (share == 1.0).all()
    np.testing.assert_allclose(light, free.mean(axis=1, keepdims=True) * np.ones(3), rtol=0.05)


def test_a_sample_that_looks_closer_has_the_leaves_of_one_that_always_did():
    scene = thicket(0.5)
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    foliage = Foliage(scene.vertices, np.linspace(0.0, 1.0, 900), scene.measured.depth)
    plain, fine = (Sample(occluder, 50, directions) for directions in (128, 512))
    closer, expected = plain.thickened(foliage)[0].finer(4), fine.thickened(foliage)[0]
    for name in ("directions", "open", "seen", "solid"):
        np.testing.assert_array_equal(getattr(closer, name), getattr(expected, name))
    assert plain.seen.shape == (50, 128) and not np.array_equal(closer.seen, fine.seen)
