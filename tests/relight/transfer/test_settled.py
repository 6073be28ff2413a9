"""Light with all bounces, settled by a part of the rays: against the series of bounces, and what it depends on."""

import numpy as np
import pytest

from relight.transfer.bounces import Interreflection, visible_fraction, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.raytraced import raytraced
from relight.transfer.settled import settled
from splat2mesh.base.errors import InputError

from .test_bounces import ball, box, error, joined


@pytest.fixture(scope="module")
def room():
    """A bright box with a ball in it, open at the top: occluder, matrix, albedo, direct light."""
    parts = joined(box(12, 5), ball(0.25, (0.4, 0.25, 0.45), 10))
    occluder = Occluder(*parts)
    transfer = raytraced(occluder, slice(None), 4, 128)
    albedo = np.random.default_rng(0).uniform(0.5, 0.9, (len(parts[0]), 3)).astype(np.float32)
    direct = np.repeat(visible_fraction(transfer)[:, None], 3, axis=1).astype(np.float32) * [1.0, 0.5, 2.0]
    return (
        occluder,
        Interreflection(occluder, 256, visible=visible_fraction(transfer)),
        albedo,
        direct.astype(np.float32),
    )


@pytest.mark.parametrize("tolerance", [1e-2, 3e-3, 1e-3])
def test_it_is_the_series_of_bounces_to_within_the_tolerance(room, tolerance):
    _, matrix, albedo, direct = room
    exact, _ = with_bounces(direct, albedo, matrix, 0.0, 200)
    found, given = settled(direct, albedo, matrix, tolerance)
    assert found.dtype == np.float32 and error(found, exact) < 1.5 * tolerance and given == sorted(given, reverse=True)
    _, plain = with_bounces(direct, albedo, matrix, tolerance, 200)
    assert len(given) < len(plain)


def test_no_vertex_is_darker_than_by_its_direct_light(room):
    _, matrix, albedo, direct = room
    assert (settled(direct, albedo, matrix, 1e-2)[0] >= albedo * direct).all()


def test_darkness_and_black_surfaces_stay_so(room):
    _, matrix, albedo, direct = room
    for light, color in ((0 * direct, albedo), (direct, 0 * albedo)):
        found, given = settled(light, color, matrix, 1e-3)
        assert not found.any() and given == [0.0]


def test_a_channel_without_light_leaves_the_others_alone(room):
    _, matrix, albedo, direct = room
    red = direct * np.array([1, 0, 0], np.float32)
    found, _ = settled(red, albedo, matrix, 1e-4)
    exact, _ = with_bounces(red, albedo, matrix, 0.0, 200)
    assert not found[:, 1:].any() and error(found[:, 0], exact[:, 0]) < 1e-3


def test_vertex_order_changes_nothing_but_roundings(room):
    occluder, _, albedo, direct = room
    parts = joined(box(12, 5), ball(0.25, (0.4, 0.25, 0.45), 10))
    order = np.random.default_rng(4).permutation(len(parts[0]))
    expected, _ = settled(direct, albedo, Interreflection(occluder, 64), 1e-3)
    turned = Occluder(parts[0][order], parts[1][order], np.argsort(order)[parts[2]])
    found, _ = settled(direct[order], albedo[order], Interreflection(turned, 64), 1e-3)
    np.testing.assert_allclose(found, expected[order], rtol=1e-5)


def test_what_does_not_fit_is_refused(room):
    _, matrix, albedo, direct = room
    with pytest.raises(InputError, match="the direct light must have shape"):
        settled(direct[1:], albedo, matrix, 1e-3)
    with pytest.raises(InputError, match="albedo must be in"):
        settled(direct, albedo + 1, matrix, 1e-3)
