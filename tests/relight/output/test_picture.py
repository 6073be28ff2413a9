"""The picture of a relit scene: the splats as viewers draw them, the ground, the sky and the inset."""

import numpy as np
import pytest
from disc_splats import discs
from viewer_scenes import ball_on_plate

from relight.light import skies
from relight.light.environment import Environment
from relight.output import backdrop, picture
from relight.output.catcher import Catcher, _gathered, _spread
from relight.output.inset import add_inset
from relight.output.picture import RelitPicture
from relight.output.sheet import sheet
from relight.texture import bake
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.views.viewpoints import even_directions

SIZE = 160, 120
FRONT = {"eye": [0, 0.5, 5], "target": [0, 0, 0], "up": [0, 1, 0], "fov_deg": 40.0}
EVEN = Environment(np.ones((16, 32, 3)))


@pytest.fixture(autouse=True)
def coarse_shadow(monkeypatch):
    """A tenth of the rays: enough for what is asserted."""
    monkeypatch.setattr("relight.output.catcher.SIDE", 48)
    monkeypatch.setattr("relight.output.catcher.DIRECTIONS", 256)


def test_splats_are_drawn_as_any_viewer_draws_them_whatever_frame_they_are_in():
    # A frame with a turn and twice the size: the same picture of the splats as from their own frame.
    points = even_directions(400)
    splats = discs(points, points, 0.12, 1e-3)
    matrix = np.diag([2.0, -2.0, -2.0, 1.0])
    scene = Scene(ball_on_plate().chunks, scene_from_splat=matrix)
    camera = {**FRONT, "eye": [0, 1, 10], "target": [0, 0, 0]}
    image = RelitPicture(scene, camera, SIZE).of_splats(splats, None, 1.0)
    view = View.look_at([0, -0.5, -5], [0, 0, 0], [0, -1, 0], 40.0, *SIZE)
    seen = rasterize(splats, view)
    expected = np.clip(seen.color, 0, 1) + (1 - seen.alpha[..., None]) * picture.PLAIN
    assert (seen.alpha > 0.5).mean() > 0.05
    assert np.abs(image - 255.0 * expected).max() <= 1.0  # rounding to bytes, and float32 poses


def test_a_hole_in_the_floor_of_a_room_shows_no_ground_outside():
    points = even_directions(10)
    far = discs(points + np.array([0.0, 500.0, 0.0]), points, 0.1, 1e-3)  # in no picture
    scene = Scene(ball_on_plate().chunks, capture={"from": "inside"})
    above = {**FRONT, "eye": [0, 4, 12]}
    outdoors, indoors = (RelitPicture(scene, above, SIZE, indoors=each) for each in (False, True))
    open_, closed = (each.of_splats(far, EVEN, 0.5, inset=False) for each in (outdoors, indoors))
    black = (closed == 0).all(axis=-1)
    assert (open_ > 0).all() and np.array_equal(open_[~black], closed[~black])
    low, high = np.percentile(scene.vertices, [5, 95], axis=0)
    corners = [[x, low[1], z, 1.0] for x in (low[0], high[0]) for z in (low[2], high[2])]
    view = indoors.view
    across, down, ahead, _ = view.camera_from_world @ np.transpose(corners)
    columns, rows = view.fx * across / ahead + view.cx, view.fy * down / ahead + view.cy
    for pixels, expected in zip(np.nonzero(black), (rows, columns), strict=True):
        assert abs(pixels.min() - expected.min()) < 2 and abs(pixels.max() - expected.max()) < 2


def test_the_mesh_is_shown_where_there_is_no_splat_with_smooth_edges():
    scene = ball_on_plate()
    shown = RelitPicture(scene, FRONT, SIZE)
    radiance = np.full((len(scene.vertices), 3), 0.5, np.float32)
    image = shown.of_vertices(radiance, None, 1.0)[..., 0]
    inside = round(255 * 0.7354)  # sRGB of 0.5
    plain = round(255 * picture.PLAIN)
    assert {inside, plain} <= set(image.ravel().tolist())
    between = (image > plain) & (image < inside)
    assert 0 < between.mean() < 0.1


def test_a_texture_shows_what_the_vertices_show_and_what_lies_between_them():
    scene = ball_on_plate()
    shown = RelitPicture(scene, FRONT, SIZE)
    baked = bake(scene, size=256)
    radiance = scene.colors_linear
    image = baked.relit(np.ones_like(radiance), 1.0)
    vertices = shown.of_vertices(radiance, EVEN, 1.0).astype(int)
    texture = shown.of_texture(baked.atlas, image, EVEN, 1.0).astype(int)
    off = np.abs(texture - vertices).max(axis=2)
    assert np.median(off) <= 1 and (off <= 6).mean() > 0.98  # bytes of texels, and folds between their charts
    # A texel alone, which no vertex knows, is seen where its face is.
    dark = np.zeros_like(image)
    center = np.array([0.0, 0.1, 0.8])  # of the ball towards the camera
    points = np.einsum("tk,tkc->tc", baked.atlas.weights, scene.vertices[scene.faces[baked.atlas.face]])
    near = baked.atlas.texels[np.linalg.norm(points - center, axis=1) < 0.15]
    dark.reshape(-1, 3)[near] = 255
    lit = shown.of_texture(baked.atlas, dark, Environment(np.zeros((16, 32, 3))), 1.0)[..., 0] > 200
    lit[:, :40] = lit[:, 120:] = False  # the inset
    rows, columns = np.nonzero(lit)
    expected = shown.view.project(center[None])[0][0]
    assert 5 < lit.sum() < 400 and np.abs([columns.mean() - expected[0], rows.mean() - expected[1]]).max() < 3


def test_nothing_hides_light_from_far_ground_and_a_body_on_it_hides_most_below_it():
    scene = ball_on_plate()
    catcher = Catcher(scene, RayCaster(scene.vertices, scene.faces))
    low, high = scene.bounds
    middle = 0.5 * (low + high)[[0, 2]]
    far = middle + np.array([30.0 * np.ptp(scene.bounds), 0.0])
    below, away = catcher.under(EVEN).share(np.array([middle, far]))
    assert np.all(away == 1.0) and np.all(below < 0.1)


def test_a_sun_throws_the_shadow_to_the_other_side():
    scene = ball_on_plate()
    catcher = Catcher(scene, RayCaster(scene.vertices, scene.faces))
    image = np.full((64, 128, 3), 1e-3, np.float32)
    image[16, 32] = 1e4  # 45 degrees up, towards +x
    reach = 0.5 * np.ptp(scene.bounds[:, 0])
    middle = 0.5 * scene.bounds.sum(axis=0)[[0, 2]]
    points = middle + np.array([[-1.3 * reach, 0.0], [1.3 * reach, 0.0]])
    dark, light = catcher.under(Environment(image)).share(points)[:, 0]
    assert dark < 0.6 < 0.9 < light
    turned = catcher.under(Environment(image).rotated(180.0)).share(points)[:, 0]
    np.testing.assert_allclose(turned[::-1] < 0.7, [True, False])


def test_the_points_of_the_ground_are_found_again():
    u = np.linspace(-1, 1, 33)
    np.testing.assert_allclose(_gathered(_spread(u)), u, atol=1e-5)


@pytest.mark.parametrize("name", skies.BUILTIN)
def test_a_sky_is_shown_as_bright_as_it_lights_but_for_the_air_at_its_horizon(name):
    from relight.light.projections import texel_directions

    directions = texel_directions(skies.HEIGHT, skies.WIDTH)
    image, seen = skies.image_of(name), skies.seen(name, directions)
    low = (directions[..., 1] < 0) & (directions[..., 1] > -0.2)
    sun = image.max(axis=-1) > 50.0  # which the image spreads over its texels
    compared = ~low & ~sun
    np.testing.assert_allclose(seen[compared], image[compared], rtol=5e-3)  # what is left of the air at -0.2
    if sun.any():
        center = np.einsum("nc,nk->ck", image[sun], directions[sun])[1]
        assert skies.seen(name, center[None] / np.linalg.norm(center)).min() > 100.0


def test_an_image_is_shown_as_it_is_and_turned():
    light = Environment(np.random.default_rng(0).uniform(0.2, 1.0, (32, 64, 3)))
    azimuth = np.linspace(0.0, 0.5, 400)
    directions = np.stack([np.sin(azimuth), 0 * azimuth, np.cos(azimuth)], axis=-1)
    shown = backdrop.behind(light, directions, 2.0)
    np.testing.assert_array_equal(shown, 2.0 * light.lookup(directions))
    turned = directions @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(backdrop.behind(light.rotated(90.0), turned, 2.0), shown, rtol=1e-4)


def test_the_arrow_comes_from_where_the_light_is():
    view = View.look_at([0, 0, 5], [0, 0, 0], [0, 1, 0], 40.0, 640, 480)
    found = {}
    for name, column in (("left", 96), ("right", 32)):  # -x is at 3/4, +x at 1/4 of the width
        light = np.full((64, 128, 3), 0.01, np.float32)
        light[30:34, column] = 50.0
        image = np.zeros((480, 640, 3), np.float32)
        rows, _ = add_inset(image, view, Environment(light), 0.3)
        yellow = (image[..., 0] > 0.8) & (image[..., 2] < 0.4)
        assert yellow.any() and not image[: rows.start].any()
        found[name] = np.nonzero(yellow)[1].mean()
    assert found["left"] < found["right"] - 20


def test_a_sheet_holds_every_picture_under_its_name():
    pictures = [(f"light {i}", np.full((60, 80, 3), 20 * i + 30, np.uint8)) for i in range(5)]
    whole = sheet(pictures)
    assert whole.shape[1] > 3 * 80 and whole.shape[0] > 2 * 60
    for _, image in pictures:
        assert (whole == image[0, 0]).all(axis=-1).sum() >= 60 * 80
    assert sheet(pictures * 4).shape[0] < 5 * 80
