"""The first bounce by many rays: the matrix of bounces as oracle, closed forms, and that it may be cut into rows."""

import numpy as np
import pytest
import trimesh

from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.first_bounce import first_bounce
from relight.transfer.occluder import Occluder
from splat2mesh.base.errors import InputError


def hollow_ball(subdivisions=2):
    ball = trimesh.creation.icosphere(subdivisions)
    vertices = np.array(ball.vertices, np.float32)
    return Occluder(vertices, -vertices, np.array(ball.faces[:, ::-1], np.int32))


@pytest.fixture(scope="module")
def ball():
    return hollow_ball()


def test_it_is_the_product_with_the_matrix_of_as_many_rays(ball):
    """The matrix rounds hits to 1/64 of an edge: half of that over three corners of light within 1."""
    sent = np.random.default_rng(0).random((len(ball.origins), 3)).astype(np.float32)
    np.testing.assert_allclose(first_bounce(ball, sent, 64), Interreflection(ball, 64).bounce(sent), atol=2e-3)


def test_a_closed_body_of_one_brightness_sends_as_much_to_each_place(ball):
    sent = np.full((len(ball.origins), 3), (1.0, 0.5, 0.25), np.float32)
    np.testing.assert_allclose(first_bounce(ball, sent, 32), sent, rtol=1e-5)


def test_rows_are_those_of_all(ball):
    sent = np.random.default_rng(1).random((len(ball.origins), 3)).astype(np.float32)
    rows = np.array([3, 17, 100])
    np.testing.assert_array_equal(first_bounce(ball, sent, 64, rows), first_bounce(ball, sent, 64)[rows])


def test_backs_are_black(ball):
    outward = Occluder(ball.origins, -ball.normals, ball.faces.astype(np.int32))
    assert not first_bounce(outward, np.ones_like(ball.origins), 32).any()


def test_bounces_go_on_from_a_first_one_that_is_given(ball):
    """Given the matrix's own first bounce, nothing changes, to the bit."""
    matrix, albedo = Interreflection(ball, 16), np.full_like(ball.origins, 0.5)
    direct = np.random.default_rng(2).random(ball.origins.shape).astype(np.float32)
    plain = with_bounces(direct, albedo, matrix)
    given = with_bounces(direct, albedo, matrix, first=matrix.bounce(albedo * direct))
    np.testing.assert_array_equal(plain[0], given[0])
    assert plain[1] == given[1]


def test_no_rays_are_refused(ball):
    with pytest.raises(InputError, match="rays"):
        first_bounce(ball, np.ones_like(ball.origins), 0)
