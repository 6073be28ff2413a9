"""relight.gloss.lamp_lobes: where a lamp shines on a glossy ball, how bright, and what hides it."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from relight.gloss.lamp_lobes import lamp_lobes
from relight.gloss.mirrored import MirroredPixels
from relight.gloss.pixels import SurfacePixels
from relight.lamps.emitters import emitters_of
from relight.lamps.shapes import SphereLamp
from relight.transfer.occluder import Frame
from splat2mesh.render.raycaster import RayCaster

EYE = np.array([0.0, 0.0, 50.0])
UNIT = Frame(np.zeros(3), 1.0, 1e-7)


def ball(alpha, more=()):
    """(view of a unit ball from far off, surface it is on): MirroredPixels without the rays that lamps do not need."""
    mesh = trimesh.creation.icosphere(5)
    points = np.asarray(mesh.vertices)
    toward = EYE - points
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    cosine = np.einsum("ij,ij->i", points, toward)
    rows = cosine > 0.05
    points, toward, cosine = points[rows], toward[rows], cosine[rows]
    count = len(points)
    mirrored = 2 * cosine[:, None] * points - toward
    nothing = np.zeros((count, 3))
    pixels = SurfacePixels(None, np.arange(count), nothing, nothing, points, points, toward, mirrored, cosine, EYE)
    whole = trimesh.util.concatenate([mesh, *more])
    surface = SimpleNamespace(diagonal=0.1, caster=RayCaster(whole.vertices, whole.faces))
    one = np.ones((count, 3), np.float32)
    rough = np.full(count, alpha, np.float32)
    return MirroredPixels(pixels, one, rough, one[:, 0], None, None, np.eye(3), None), surface


def highlight(lamp, alpha=0.1, more=(), frame=None):
    view, surface = ball(alpha, more)
    found = lamp_lobes(view, surface, emitters_of([lamp]), UNIT, np.eye(4) if frame is None else frame)
    return view.pixels, found


@pytest.mark.parametrize("way", [(1.0, 0.0, 1.0), (0.3, -0.8, 0.5), (-0.9, 0.2, -0.1)])
def test_a_highlight_lies_where_the_half_vector_says(way):
    way = np.array(way) / np.linalg.norm(way)
    pixels, found = highlight(SphereLamp(tuple(200 * way), 0.5, (1.0, 1.0, 1.0)), alpha=0.08)
    half = way + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    brightest = pixels.points[found[:, 0].argmax()]
    # the ball's corners are 1.1 degrees apart, and Fresnel is none here: the lobe peaks within a degree of the half
    assert np.degrees(np.arccos(min(brightest @ half, 1.0))) < 3.0


def test_a_ball_returns_as_much_of_a_far_lamp_as_any_mirror_of_its_size():
    """A perfect mirror ball scatters evenly: radiant intensity I gives E R^2 / 4 in every direction."""
    lamp = SphereLamp((0.0, 0.0, 400.0), 2.0, (1.0, 1.0, 1.0))
    pixels, found = highlight(lamp, alpha=0.1)
    irradiance = np.pi * (2.0 / 399.0) ** 2  # at the near side, where the light comes back from
    areas = 4 * np.pi / 10242  # of an icosphere's corners, seen along the eye
    intensity = (found[:, 0] * pixels.cosine).sum() * areas
    assert intensity == pytest.approx(irradiance / 4, rel=0.05)  # corners are not quite even; Smith takes 1%


def test_color_and_strength_scale_the_light():
    pixels, white = highlight(SphereLamp((0.0, 5.0, 5.0), 0.2, (1.0, 1.0, 1.0)))
    _, red = highlight(SphereLamp((0.0, 5.0, 5.0), 0.2, (2.0, 0.0, 0.5)))
    np.testing.assert_allclose(red, white * [2.0, 0.0, 0.5], rtol=1e-6)
    assert white.any() and np.isfinite(white).all()
    assert not white[pixels.points @ [0.0, 1.0, 1.0] < -0.1].any()  # behind the horizon


def test_what_stands_between_hides_the_lamp():
    wall = trimesh.creation.box((4.0, 0.1, 4.0), trimesh.transformations.translation_matrix((0.0, 3.0, 3.0)))
    lamp = SphereLamp((0.0, 8.0, 8.0), 0.2, (1.0, 1.0, 1.0))
    assert highlight(lamp)[1].any()
    assert not highlight(lamp, more=[wall])[1].any()


def test_the_frame_of_the_splat_may_be_another_than_that_of_the_scene():
    """A splat whose y points down: the lamp, given in the scene's frame, shines from the same side of it."""
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    view, surface = ball(0.1)
    flipped = view._replace(scene=turn[:3, :3])
    straight = lamp_lobes(view, surface, emitters_of([SphereLamp((0.0, 5.0, 5.0), 0.2, (1, 1, 1))]), UNIT, np.eye(4))
    turned = lamp_lobes(flipped, surface, emitters_of([SphereLamp((0.0, -5.0, -5.0), 0.2, (1, 1, 1))]), UNIT, turn)
    np.testing.assert_allclose(turned, straight, rtol=1e-4, atol=1e-7)


@pytest.mark.parametrize("radius", [0.0, 1e-3, 1.05])
def test_a_lamp_on_the_surface_stays_finite(radius):
    _, found = highlight(SphereLamp((0.0, 0.0, 1.0), max(radius, 1e-6), (1e6, 1e6, 1e6)))
    assert np.isfinite(found).all() and (found >= 0.0).all()
