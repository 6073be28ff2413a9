"""Closed forms of what lamps give, against cosine-weighted rays and each other."""

import numpy as np
import pytest
from seen_lamps import RAYS, hits_tube, seen_share, share_error

from relight.lamps.emitters import emitters_of
from relight.lamps.shapes import (
    MeshLamp,
    ProfileLamp,
    RectangleLamp,
    SphereLamp,
    SpotLamp,
    TubeLamp,
)
from relight.lamps.unoccluded import aimed, unoccluded


def given(lamp, place, normal):
    """What a lamp of radiance 1 gives a white vertex, by the closed form."""
    emitters = emitters_of([lamp])
    each = range(len(emitters.kind))
    return sum(unoccluded(emitters, e, *place, *normal) for e in each)


def sampled(lamp, place, normal, samples=4096, leaf=0.0):
    """The same, by the points that shadow rays aim at."""
    emitters = emitters_of([lamp])
    return sum(
        aimed(emitters, e, *place, *normal, leaf, sample, samples, 0.3, 0.6)[3]
        for e in range(len(emitters.kind))
        for sample in range(samples)
    )


def hits_ball(center, radius):
    def hits(directions):
        along = directions @ center
        return (along > 0) & (center @ center - along**2 < radius**2)

    return hits


def hits_rectangle(lamp):
    normal = np.cross(lamp.edge_u, lamp.edge_v)

    def hits(directions):
        facing = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.array(lamp.center) @ normal) / facing
            point = t[:, None] * directions - lamp.center
            u, v = (point @ np.array(edge) / np.dot(edge, edge) for edge in (lamp.edge_u, lamp.edge_v))
        return (t > 0) & (facing < 0) & (abs(u) < 0.5) & (abs(v) < 0.5)

    return hits


def unit(*values):
    return np.array(values) / np.linalg.norm(values)


NORMALS = [unit(0, 1, 0), unit(1, 0.2, 0.1), unit(-0.4, 0.5, 0.7), unit(0.1, -0.25, 0.9)]


@pytest.mark.parametrize("normal", NORMALS)
@pytest.mark.parametrize(
    ("center", "radius"), [((0.3, 0.8, 0.2), 0.3), ((0.1, 0.4, 0.0), 0.35), ((2.0, 0.1, 1.0), 0.5)]
)
def test_a_sphere_is_what_rays_see_of_it_cut_by_the_horizon_or_not(center, radius, normal):
    found = given(SphereLamp(center, radius, (1, 1, 1)), (0.0, 0.0, 0.0), normal)
    true = seen_share(hits_ball(np.array(center), radius), normal)
    assert found == pytest.approx(true, abs=5 * np.sqrt(max(true, 1e-4) / RAYS))


@pytest.mark.parametrize("normal", NORMALS)
def test_a_rectangle_is_what_rays_see_of_it_cut_by_the_horizon_or_not(normal):
    lamp = RectangleLamp((0.2, 0.6, 0.1), (0.9, 0, 0.1), (-0.05, 0.0, 0.45), (1, 1, 1))  # u x v points down
    found = given(lamp, (0.0, 0.0, 0.0), normal)
    assert found == pytest.approx(seen_share(hits_rectangle(lamp), normal), abs=5 * np.sqrt(0.1 / RAYS))


@pytest.mark.parametrize("normal", NORMALS)
@pytest.mark.parametrize(
    "start,end,radius",
    [
        ((-0.5, 0.1, 0.0), (0.6, 0.1, 0.05), 0.098),  # lies on the surface beside the vertex
        ((-0.4, 0.005, 0.03), (0.5, 0.005, 0.03), 0.02),  # more than half of it is below the horizon
        ((-0.5, 0.6, 0.1), (0.6, 0.5, 0.3), 0.3),
        ((0.1, 0.1, 0.2), (0.5, 0.9, 0.9), 0.05),
        ((0.3, 0.4, 0.2), (0.3, 0.5, 0.25), 0.2),  # a disc, nearly
    ],
)
def test_a_tube_is_what_rays_see_of_its_side_cut_by_the_horizon_or_not(start, end, radius, normal):
    lamp, place = TubeLamp(start, end, radius, (1, 1, 1)), np.zeros(3)
    true = seen_share(hits_tube(lamp, place), normal)
    assert given(lamp, place, normal) == pytest.approx(true, abs=share_error(true))
    assert sampled(lamp, place, normal) == pytest.approx(true, abs=share_error(true))


def test_a_disc_of_sky_overhead_gives_sine_squared():
    """Nusselt's analog: a cone of half angle s about the normal fills sin^2 s of the disc."""
    for radius in (0.01, 0.5, 0.999):
        assert given(SphereLamp((0, 1, 0), radius, (1, 1, 1)), (0, 0, 0), (0, 1, 0)) == pytest.approx(
            radius**2, rel=1e-6
        )


def test_an_endless_tube_gives_its_radius_over_its_distance():
    """Integrated along its axis, the cosine at right angles to it gives 2 r / (pi D) times pi / 2."""
    tube = TubeLamp((-4e3, 1.0, 0), (4e3, 1.0, 0), 0.02, (1, 1, 1))
    assert given(tube, (0, 0, 0), (0, 1, 0)) == pytest.approx(0.02, rel=1e-3)


def test_a_tube_seen_along_its_axis_gives_next_to_nothing():
    """Its side alone shines. Inside it all directions do; beyond its end, seen end on, none."""
    tube = TubeLamp((0, 0, 1.0), (0, 0, 2.0), 0.05, (1, 1, 1))
    for off in (0.0, 0.02, 0.049):
        assert given(tube, (off, 0, 1.5), (0, 0, 1)) == 1.0
        for end, normal in ((0.0, 1), (3.0, -1)):
            assert given(tube, (off, 0, end), (0, 0, normal)) < 2.0 * 0.05**2  # as much as its end would


@pytest.mark.parametrize(
    "lamp",
    [
        SphereLamp((0.3, 0.5, -0.2), 0.25, (1, 1, 1)),
        TubeLamp((-0.5, 0.6, 0.1), (0.6, 0.5, 0.3), 0.03, (1, 1, 1)),
        RectangleLamp((0, 0.7, 0.2), (0.8, 0, 0), (0, 0, 0.4), (1, 1, 1), True),
    ],
)
@pytest.mark.parametrize("normal", NORMALS[:3])
def test_the_weights_of_shadow_rays_add_up_to_the_closed_form(lamp, normal):
    """4,096 even points leave a tenth of a percent of the lamp where nothing cuts it."""
    found, true = sampled(lamp, (0.0, 0.0, 0.0), normal), given(lamp, (0.0, 0.0, 0.0), normal)
    assert found == pytest.approx(true, rel=0.02, abs=2e-4)


@pytest.mark.slow
def test_a_mesh_in_the_form_of_a_rectangle_is_one():
    corners = np.array([[-0.4, 0.7, 0.0], [0.4, 0.7, 0.0], [0.4, 0.7, 0.4], [-0.4, 0.7, 0.4]])
    mesh = MeshLamp(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.ones(3))
    panel = RectangleLamp((0, 0.7, 0.2), (0.8, 0, 0), (0, 0, 0.4), (1, 1, 1))
    for normal in NORMALS:
        assert given(mesh, (0, 0, 0), normal) == pytest.approx(given(panel, (0, 0, 0), normal), abs=1e-6)
    below, above = (given(panel, (0, y, 0.2), (0, 1 if y < 0.7 else -1, 0)) for y in (0.3, 1.1))
    assert below > 0.1 and above == 0.0  # x cross z points down


def test_a_spot_falls_off_from_its_beam_to_its_cutoff():
    spot = SpotLamp((0, 2, 0), (0, 0, 0), (8, 8, 8), cutoff_deg=30, beam_deg=10)

    def at(angle_deg):
        x = 2 * np.tan(np.radians(angle_deg))
        square = 4 + x * x
        cosine = 2 / np.sqrt(square)
        emitters = emitters_of([spot])
        light = unoccluded(emitters, 0, x, 0.0, 0.0, 0.0, 1.0, 0.0) * emitters.color[0, 0]
        return light * np.pi * square / cosine / 8.0

    assert [round(at(angle), 4) for angle in (0, 9.9, 20, 30.1)] == pytest.approx([1, 1, 0.5, 0], abs=2e-3)


def test_a_profile_of_cosines_shines_as_a_flat_lamp_does():
    """A Lambertian disc has intensity I cos(angle)."""
    angles = np.arange(0.0, 90.1, 1.0)
    table = np.cos(np.radians(angles))[:, None]
    lamp = ProfileLamp((0, 2, 0), (0, 0, 0), (5, 5, 5), angles, np.array([0.0]), table)
    emitters = emitters_of([lamp])
    for x in (0.0, 1.0, 3.0):
        square = 4 + x * x
        cosine = 2 / np.sqrt(square)
        light = unoccluded(emitters, 0, x, 0.0, 0.0, 0.0, 1.0, 0.0) * emitters.color[0, 0]
        assert light == pytest.approx(5 * cosine * cosine / square / np.pi, rel=2e-3)


def test_a_leaf_takes_a_quarter_from_all_sides():
    """Its light is the mean over the sphere: solid angle / 4 pi, and irradiance over pi of it is that."""
    lamp = SphereLamp((0, -1.0, 0), 0.3, (1, 1, 1))
    share = (1 - np.sqrt(1 - 0.09)) / 2  # of the sphere
    assert sampled(lamp, (0, 0, 0), (0, 1, 0), 64, leaf=1.0) == pytest.approx(share, rel=1e-5)
    assert sampled(lamp, (0, 0, 0), (0, 1, 0), 64) == 0.0


@pytest.mark.parametrize("distance", [0.0, 1e-6, 1e-3])
def test_nothing_is_infinite_however_near(distance):
    for lamp in (
        SphereLamp((0, distance, 0), 0.0, intensity=(1, 1, 1)),
        SphereLamp((0, distance, 0), 0.1, (1e12, 1, 1)),
        TubeLamp((-1, distance, 0), (1, distance, 0), 0.01, (1, 1, 1)),
        RectangleLamp((0, distance, 0), (1, 0, 0), (0, 0, 1), (1, 1, 1), True),
    ):
        found = given(lamp, (0, 0, 0), (0, 1, 0))
        assert 0.0 <= found <= 1.0 + 1e-6
        assert np.isfinite(sampled(lamp, (0, 0, 0), (0, 1, 0), 16))
