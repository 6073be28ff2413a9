"""Scenes whose leaves are apart from the mesh: lit and relit as before, drawn without the leaves or with cards."""

import numpy as np
import pytest
from bush import GREEN, bush_scene, bush_splats
from gltf_check import validator_issues

from relight.cli import main
from relight.engine.relighter import Relighter
from relight.light.environment import Environment
from relight.output.lamps_glb import ShownLight
from relight.output.live_glb import write_live_glb
from relight.output.mesh_files import write_glb, write_npy, write_ply
from relight.output.picture import RelitPicture
from relight.splats.binding import Binding
from relight.transfer.settings import Settings
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.pipeline import add_texture
from splat2mesh.scene.drawn import MOST_TINT, Drawn
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import Look
from splat2mesh.surface.foliage import leaves_apart
from splat2mesh.views.viewpoints import virtual_views

KINDS = ["none", "cards"]


@pytest.fixture(scope="module")
def splats():
    return bush_splats()[0]


@pytest.fixture(scope="module", params=KINDS)
def apart(request, splats):
    return leaves_apart(bush_scene(), splats, request.param, 3000)


def place_light(points, seed):
    """(V, 3) some smooth light of the places alone."""
    waves = np.random.default_rng(seed).normal(size=(3, 3))
    return np.exp(np.sin(np.asarray(points, np.float64) @ waves)).astype(np.float32)


def test_relit_splats_are_those_of_the_whole_mesh_to_the_bit(apart, splats):
    whole = bush_scene()
    found = []
    for scene in (whole, apart):
        before, after = place_light(scene.vertices, 1), place_light(scene.vertices, 2)
        found.append(Binding(splats, scene, views=()).relit(before, after).sh)
    np.testing.assert_array_equal(found[1], found[0])
    moved = np.abs(found[0][:, 0] - splats.sh[:, 0]).max(axis=1)
    assert (moved > 0.0).all()  # no leaf keeps the light of the capture


def test_light_falls_through_the_leaves_as_before_and_nothing_is_black(apart, splats):
    """Constant light: as noisy as 128 rays of other vertices' directions."""
    whole, sky = bush_scene(), Environment(np.ones((16, 32, 3), np.float32))
    settings = Settings("raytraced", 4, 128, volume=256)
    lit = [_lit(scene, sky, settings) for scene in (whole, apart)]
    is_leaf = [scene.colors_srgb[:, 0] == GREEN[0] for scene in (whole, apart)]
    for part in (0, 1):
        means = [light[leaf == part].mean() for light, leaf in zip(lit, is_leaf, strict=True)]
        assert means[1] == pytest.approx(means[0], rel=0.02)
    drawn = Drawn(apart)
    shown = drawn.colors(lit[1] * apart.colors_linear)
    assert shown[drawn.scene.colors_srgb.min(axis=1) > 0].min() > 1e-4


def _lit(scene, sky, settings):
    relighter = Relighter(scene)
    transfer, done = relighter.precomputed.transfer(settings)
    assert done.volume >= settings.volume  # leaves are volumes in both
    return transfer[:, :16] @ sky.sh(4)


@pytest.mark.parametrize("kind", KINDS)
def test_meshes_hold_surfaces_and_cards_alone(tmp_path, splats, kind):
    scene = leaves_apart(bush_scene(), splats, kind, 3000)
    radiance = scene.colors_linear
    write_glb(tmp_path / "relit.glb", scene, radiance, 1.0)
    write_ply(tmp_path / "relit.ply", scene, radiance, 1.0)
    drawn = Drawn(scene).scene
    assert len(drawn.faces) == scene.statistics["faces"]
    for name in ("relit.glb", "relit.ply"):
        assert len(read_mesh(tmp_path / name).faces) == len(drawn.faces)
    found = read_mesh(tmp_path / "relit.ply")
    np.testing.assert_array_equal(found.vertices, drawn.vertices)
    # Captured light: all have the colours that they have in the scene.
    assert np.abs(found.colors_srgb.astype(int) - drawn.colors_srgb).max() <= 1
    assert (found.colors_srgb == GREEN).all(axis=1).any() == (kind == "cards")


def test_cards_take_the_light_around_them_in_their_own_colour(splats):
    scene = leaves_apart(bush_scene(), splats, "cards", 3000)
    drawn, count = Drawn(scene), sum(len(mesh.vertices) for mesh in scene.cards)
    twice = drawn.colors(2.0 * scene.colors_linear)[-count:]
    np.testing.assert_allclose(twice, 2.0 * drawn.scene.colors_linear[-count:], rtol=1e-5)
    light = place_light(scene.vertices, 5)
    around = drawn.values(light)[-count:]
    own = place_light(drawn.scene.vertices[-count:], 5)
    assert np.abs(np.log(around / own)).mean() < 0.1  # within a few leaves' lengths
    dark = drawn.colors(np.ones((scene.vertex_count, 3), np.float32))[-count:]
    assert 0.0 < dark.min() and dark.max() <= MOST_TINT


def test_raw_radiance_keeps_all_that_is_lit(tmp_path, apart):
    write_npy(tmp_path / "radiance.npy", apart, apart.colors_linear)
    assert len(np.load(tmp_path / "radiance.npy")) == apart.vertex_count
    with pytest.raises(InputError, match="one RGB per scene vertex"):
        write_npy(tmp_path / "radiance.npy", apart, Drawn(apart).scene.colors_linear[:-1])


def test_live_meshes_are_of_what_is_drawn(tmp_path, apart):
    count, light = apart.vertex_count, Environment(np.ones((16, 32, 3), np.float32))
    nine = np.zeros((count, 9), np.float32), np.zeros((count, 3), np.float32)
    write_live_glb(tmp_path / "live.glb", apart, apart.colors_linear, nine, ShownLight(light, 1.0))
    assert len(read_mesh(tmp_path / "live.glb").faces) == len(Drawn(apart).scene.faces)


def test_the_picture_of_a_mesh_shows_the_ground_behind_leaves_left_out(splats):
    camera = {"eye": [0.2, 0.7, 3.0], "target": [0.2, 0.7, -0.1], "up": [0, 1, 0], "fov_deg": 40.0}
    green = {}
    for kind in KINDS:
        scene = leaves_apart(bush_scene(), splats, kind, 3000)
        image = RelitPicture(scene, camera, (64, 48), 1).of_vertices(scene.colors_linear, None, 1.0).astype(int)
        green[kind] = (image[..., 1] > image[..., 0] + 30).sum()
    assert green["none"] == 0 and green["cards"] > 150


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_every_file_of_the_commands_is_of_what_is_drawn(tmp_path, capsys, splats, kind):
    scene = leaves_apart(bush_scene(), splats, kind, 3000)
    views = virtual_views(splats, 8, 128, np.array([0.0, 1.0, 0.0]), 0)
    add_texture(scene, [Look(splats, 0.1, views, np.full(len(views), 0.01))], 256, Stages())
    write_inria_ply(tmp_path / "bush.ply", splats)
    scene.source = describe(tmp_path / "bush.ply")
    scene.save(tmp_path / "scene")
    asked = ["--env", "studio", "--method", "analytic", "--albedo", "captured", "--format", "glb", "ply", "npy", "png"]
    out = tmp_path / "out"
    assert main([str(tmp_path / "scene"), *asked, "--bake", "texture", "--live", "-o", str(out), "-q"]) == 0
    count = scene.statistics["faces"]
    names = ["relit.glb", "relit.ply", "live.glb", "relit_texture.glb", "albedo_texture.glb"]
    paths = [tmp_path / "scene/mesh.glb", *(out / name for name in names)]
    for path in paths:
        assert len(read_mesh(path).faces) == count, path
    assert len(np.load(out / "radiance.npy")) == scene.vertex_count
    for path in paths:
        if path.suffix == ".glb":
            assert validator_issues(path)["numErrors"] == 0  # skips where the validator is missing
