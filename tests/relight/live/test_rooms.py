"""Closed rooms, live: the change of light in a bundle is that of a relit splat, lamps included."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from lit_rooms import room

from relight import Environment, LightingOptions, Relighter
from relight.engine.appearance import Place
from relight.engine.relit_room import RelitRoom
from relight.jobs.job import Job
from relight.live.lights import capture_light
from relight.live.response import LAMPS, SPREAD_BANDS, about_y, light_vector, response_of
from relight.request import RelightRequest
from relight.splats.light_ratio import linear_parts
from relight.transfer.settings import Settings
from splat2mesh.base.errors import DataWarning

SETTINGS = Settings("raytraced", 10, 64, bounce_rays=32, bounce_tolerance=1e-3)


@cache
def appearance():
    job = Job(
        RelightRequest(room()[0], "overcast", LightingOptions(tolerance=0.05), albedo="estimated", caching="none")
    )
    with pytest.warns(DataWarning, match="closed room"):
        return job.known.appearance._replace(place=Place.ROOM)


def without_ceiling(scene):
    """The scene without its highest faces."""
    chunk, (low, high) = scene.chunks[0], scene.bounds
    above = (chunk.vertices[chunk.faces, 1] > high[1] - 0.2 * (high[1] - low[1])).all(axis=1)
    return replace(scene, chunks=[replace(chunk, faces=np.ascontiguousarray(chunk.faces[~above]))])


@cache
def relit(lamps=1.0, opened=False):
    """(RelitRoom, Response) of a box with a lamp, closed, or open above as by a window that was black."""
    scene, look = room()[0], appearance()
    if opened:
        found = look.room._replace(report=look.room.report | {"windows": {}})
        scene, look = without_ceiling(scene), look._replace(room=found)
    relighter = Relighter(scene, tolerance=0.1, lamps=lamps)
    found = RelitRoom(look, relighter, 1.0)
    shares = np.ones(len(look.captured))
    return found, response_of(relighter, look, SETTINGS, shares, found)


def ratio_of(radiance):
    """The light ratio (V, 3) of relit splats for what vertices send out, before its roll-off."""
    look = appearance()
    own, usual = linear_parts(look.captured, look.irradiance)
    after = look.received(radiance)
    return own * after + usual * after.sum(axis=0) / look.irradiance.sum(axis=0, dtype=np.float64)


def test_dimmed_lamps_dim_a_closed_room_as_they_do_its_relit_splat():
    found, response = relit(0.3)
    assert not response.values[:, :LAMPS].any() and not response.own.any()  # no sky gets in
    expected = ratio_of(found.shading(Environment.load("noon")).radiance)
    np.testing.assert_allclose(0.3 * response.values[:, LAMPS], expected, rtol=1e-4)


def gradient():
    """A sky that is brighter and redder on one side."""
    side = 1.0 + 0.8 * np.cos(np.arange(32) * 2 * np.pi / 32)
    return Environment(np.broadcast_to(np.stack([side, side, 0.5 + 0 * side], axis=-1), (16, 32, 3)), "gradient")


@pytest.mark.parametrize("sky", [Environment.load("overcast"), gradient()], ids=lambda sky: sky.name)
def test_the_sky_adds_to_the_lamps(sky):
    """Through the ceiling, which is taken off."""
    found, response = relit(0.3, opened=True)
    light = about_y(sky.sh(10))
    change = np.einsum("vkc,kc->vc", response.values, light_vector(light, light, 0.3))
    expected = ratio_of(found.shading(sky).radiance)
    lamps = 0.3 * response.values[:, LAMPS]
    assert 0.05 < np.mean(lamps) / np.mean(expected) < 0.9
    bounded = expected.max(axis=1) < 20.0  # the change of a room is at most 30, which nothing linear is
    off = (change - expected)[bounded]
    # Both are within the tolerance of 10% of the light, by rays of their own.
    assert bounded.mean() > 0.9 and np.sqrt(np.mean(off**2)) < 0.07 * np.sqrt(np.mean(expected[bounded] ** 2))


def test_the_capture_light_is_what_lamps_leave():
    _, response = relit(0.3, opened=True)
    shares = np.ones(len(response.own))
    light = capture_light(response, shares, 0.3)
    few = SPREAD_BANDS**2
    change = np.einsum("vkc,kc->vc", response.values, light_vector(light.rest, light.whole[:few], 1.0))
    alone = response.values[:, LAMPS]
    assert light.lamps == 0.3 and np.mean((change - 1.0) ** 2) < np.mean((alone - 1.0) ** 2)
