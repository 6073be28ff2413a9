"""relight.gloss.mirrored: what a glossy ball mirrors of a sun, of an even light, and of what hides it."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from relight.gloss.material import Gloss
from relight.gloss.mirrored import LEAST_ALPHA, RAYS, MirroredPixels
from relight.gloss.pixels import SurfacePixels
from relight.sh import harmonics
from relight.splats.blending import Blending
from splat2mesh.render.raycaster import RayCaster

EYE = np.array([0.0, 0.0, 50.0])


def mirrored(alpha, metal=True, reflectance=1.0, more=(), scene=None, level=4):
    """The MirroredPixels of a unit ball's corners, seen from far off, beside other meshes."""
    ball = trimesh.creation.icosphere(level)
    whole = trimesh.util.concatenate([ball, *more])
    points = np.asarray(ball.vertices)
    toward = EYE - points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", points, toward)
    rows = cosine > 0.05
    points, toward, cosine = points[rows], toward[rows], cosine[rows]
    number = np.flatnonzero(rows)
    corners = np.repeat(number[:, None], 3, axis=1).astype(np.int32)
    weights = np.tile(np.float32([1, 0, 0]), (len(number), 1))
    way = 2 * cosine[:, None] * points - toward
    tiles, none = -(-len(ball.vertices) // 256), np.zeros(0, np.uint16)
    starts = np.zeros(tiles + 1, np.int64)
    blending = Blending(np.array([0, tiles]), starts, starts, none.astype(np.int32), none, none.astype(np.uint8), none)
    pixels = SurfacePixels(blending, number, corners, weights, points, points, toward, way, cosine, EYE)
    nodes = len(whole.vertices)
    gloss = Gloss(
        np.full((nodes, 3), reflectance, np.float32),
        np.full(nodes, alpha, np.float32),
        np.full(nodes, metal),
        np.ones(nodes, np.float32),
    )
    surface = SimpleNamespace(
        diagonal=0.1, faces=np.asarray(whole.faces, np.int32), caster=RayCaster(whole.vertices, whole.faces)
    )
    return MirroredPixels.of(pixels, surface, gloss, np.eye(3) if scene is None else scene), nodes


def sun(way, bands=10):
    """SH coefficients of one direction of light."""
    way = np.asarray(way, float) / np.linalg.norm(way)
    return np.repeat(harmonics.evaluate(way[None], bands)[0][:, None], 3, axis=1)


def even(bands=10):
    light = np.zeros((bands**2, 3))
    light[0] = np.sqrt(4 * np.pi)
    return light


@pytest.mark.parametrize("way", [(1.0, 0.0, 1.0), (0.3, -0.8, 0.5), (-0.9, 0.2, 0.2)])
def test_a_sun_is_mirrored_where_the_half_vector_says(way):
    view, nodes = mirrored(0.15, level=5)
    found = view.reflected(sun(way), np.zeros((nodes, 3)))[:, 0]
    half = np.array(way) / np.linalg.norm(way) + [0.0, 0.0, 1.0]
    half /= np.linalg.norm(half)
    near = found > 0.9 * found.max()
    middle = (found[near, None] * view.pixels.points[near]).sum(axis=0)
    assert np.degrees(np.arccos(middle @ half / np.linalg.norm(middle))) < 3.0


@pytest.mark.parametrize("alpha", [0.05, 0.15, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("metal", [True, False])
def test_a_white_furnace_stays_white(alpha, metal):
    """In light that is the same everywhere, from the sky or from what hides it, each reflects its strength."""
    wall = trimesh.creation.box((8.0, 0.1, 8.0), trimesh.transformations.translation_matrix((0.0, -1.5, 0.0)))
    view, nodes = mirrored(alpha, metal, reflectance=0.04, more=[wall], level=3)
    found = view.reflected(even(), np.ones((nodes, 3)))
    np.testing.assert_allclose(found, view.strength, rtol=2e-5)  # float32 sums of eight rays
    assert 0.05 < (view.visible < 0.99).mean() < 0.95  # both kinds of light take part


def test_a_lobe_is_as_wide_as_its_roughness():
    widths = []
    for alpha in (0.15, 0.3, 0.6):
        view, nodes = mirrored(alpha, level=5)
        found = view.reflected(sun((0.0, 0.0, 1.0)), np.zeros((nodes, 3)))[:, 0]
        angle = np.degrees(np.arccos(np.clip(view.pixels.points[:, 2], -1, 1)))
        widths.append(angle[found > found.max() / 2].max())
    assert widths[0] < widths[1] < widths[2]
    assert widths[0] < 15.0 and widths[2] > 20.0


def test_what_hides_the_light_is_mirrored_instead():
    wall = trimesh.creation.box((8.0, 0.1, 8.0), trimesh.transformations.translation_matrix((0.0, -1.2, 0.0)))
    view, nodes = mirrored(LEAST_ALPHA, more=[wall], level=3)
    radiance = np.zeros((nodes, 3))
    radiance[-8:] = [1.0, 0.5, 0.0]  # the wall's corners
    found = view.reflected(np.zeros((100, 3)), radiance)
    low, high = view.pixels.points[:, 1] < -0.6, view.pixels.points[:, 1] > 0.5
    assert found[low, 0].mean() > 0.9 and np.allclose(found[low, 1], 0.5 * found[low, 0], rtol=1e-5)
    assert found[high].mean() < 0.01  # but for the tail of the lobe at the rim
    assert view.corners.shape == (len(found), RAYS, 3)


def test_the_light_is_in_the_frame_of_the_scene():
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # z of the splat is x of the scene
    straight, nodes = mirrored(0.3)
    turned, _ = mirrored(0.3, scene=turn)
    nothing = np.zeros((nodes, 3))
    expected = straight.reflected(sun((0.2, 0.5, 1.0)), nothing)
    np.testing.assert_allclose(turned.reflected(sun(turn @ [0.2, 0.5, 1.0]), nothing), expected, rtol=1e-6, atol=1e-9)


def test_reflectance_is_at_most_all_and_rises_towards_the_rim():
    view, _ = mirrored(0.3, metal=False, reflectance=0.04)
    assert view.strength.max() <= 1.0
    order = np.argsort(view.pixels.cosine)
    assert (np.diff(view.strength[order, 0]) <= 1e-6).all()
    assert view.strength.min() == pytest.approx(0.04, rel=1e-3)
