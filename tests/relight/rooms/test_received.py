"""What a captured sky in windows sends in where it was not seen: the mean of what was seen of it above the horizon."""

import numpy as np

from relight.albedo.skylight import GROUND
from relight.rooms.received import sky_parts
from splat2mesh.base.sphere import texel_directions
from splat2mesh.scene.measured import CapturedSky

HEIGHT, WIDTH = 32, 64
HIGHER = np.broadcast_to(texel_directions(HEIGHT, WIDTH)[..., 1:2], (HEIGHT, WIDTH, 3)).copy()
"""Of every texel, the vertical part of its direction."""

UP, DOWN, LEVEL = [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.25, -0.97]


def seen_between(low, high):
    """(H, W, 3): 1 for texels whose direction lies between these heights."""
    return ((low < HIGHER) & (high > HIGHER)).astype(np.float32)


def sky(radiance, bound, clipped=0.0):
    shape = (HEIGHT, WIDTH, 3)
    return CapturedSky(*(np.broadcast_to(np.float32(each), shape).copy() for each in (radiance, bound, clipped)))


def test_a_part_of_an_even_sky_determines_the_whole():
    even = [0.5, 0.6, 0.7]
    known, unknown = sky_parts(sky(even, seen_between(0.1, 0.4)), np.array([UP, DOWN, LEVEL]), image=True)
    below = np.multiply(GROUND, even)  # as ground sends up a part of what it receives
    np.testing.assert_allclose(known, [even, below, even], rtol=1e-5)
    np.testing.assert_allclose(unknown, 0.0, atol=1e-6)


def test_the_dark_ground_that_was_seen_below_windows_says_nothing_of_the_sky_above():
    ground = seen_between(-1.0, -0.1)
    dark = sky(np.where(ground > 0.0, 0.05, 0.8), ground + seen_between(0.0, 0.3))
    known, _ = sky_parts(dark, np.array([UP, DOWN]), image=True)
    np.testing.assert_allclose(known[0], 0.8, rtol=1e-5)
    np.testing.assert_allclose(known[1], 0.05, rtol=1e-5)
    known, _ = sky_parts(sky(0.05, ground), np.array([UP]), image=True)  # where nothing else was seen, it does
    np.testing.assert_allclose(known, 0.05, rtol=1e-5)


def test_what_was_seen_clipped_is_unknown_where_nothing_was_seen_too():
    band = seen_between(0.0, 0.3)
    known, unknown = sky_parts(sky(0.6, 0.75 * band, 0.25 * band), np.array([UP]), image=True)
    np.testing.assert_allclose(known, 0.75 * 0.6 + 0.25, rtol=1e-5)
    np.testing.assert_allclose(unknown, 0.25, rtol=1e-5)
