"""relight.lamps.photometry: closed forms, and one form of a lamp against another."""

import numpy as np
import pytest

from relight.lamps.photometry import axis_intensity, flux, times
from relight.lamps.shapes import MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere

RADIANCE = (3.0, 2.0, 0.5)
ORIGIN, AHEAD = (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)


def profile(table, vertical_deg, horizontal_deg=(0.0, 360.0), intensity=RADIANCE):
    return ProfileLamp(ORIGIN, AHEAD, intensity, np.array(vertical_deg), np.array(horizontal_deg), np.array(table))


def ball(radius=0.5, rings=48):
    """A closed mesh, faces outside."""
    from scipy.spatial import ConvexHull

    points = fibonacci_sphere(rings * rings)
    faces = ConvexHull(points).simplices
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, corners[:, 0])
    faces[inward < 0] = faces[inward < 0][:, ::-1]
    return MeshLamp(radius * points, faces, np.array(RADIANCE))


def test_a_sphere_sends_pi_times_its_area():
    lamp = SphereLamp((1.0, 2.0, 3.0), 0.5, RADIANCE)
    assert flux(lamp) == pytest.approx(np.pi * 4.0 * np.pi * 0.25 * np.array(RADIANCE))
    assert axis_intensity(lamp) == pytest.approx(np.pi * 0.25 * np.array(RADIANCE))
    same = SphereLamp((1.0, 2.0, 3.0), 0.5, intensity=tuple(axis_intensity(lamp).tolist()))
    assert flux(same) == pytest.approx(flux(lamp))


def test_a_mesh_of_a_ball_is_a_sphere():
    # 2304 corners: its area is 0.2% too small, its outline as much, and directions are 10 degrees apart.
    assert flux(ball()) == pytest.approx(flux(SphereLamp(ORIGIN, 0.5, RADIANCE)), rel=5e-3)
    assert axis_intensity(ball()) == pytest.approx(axis_intensity(SphereLamp(ORIGIN, 0.5, RADIANCE)), rel=5e-3)


@pytest.mark.parametrize("two_sided", [False, True])
def test_a_mesh_of_a_rectangle_is_a_rectangle(two_sided):
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 1], [0, 1, 1]], float)
    mesh = MeshLamp(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.array([RADIANCE, RADIANCE]), two_sided)
    lamp = RectangleLamp(tuple(corners.mean(axis=0)), (2.0, 0.0, 0.0), (0.0, 1.0, 1.0), RADIANCE, two_sided)
    assert flux(lamp) == pytest.approx(np.pi * 2.0 * np.sqrt(2.0) * np.array(RADIANCE) * (1 + two_sided))
    assert flux(mesh) == pytest.approx(flux(lamp)) and axis_intensity(mesh) == pytest.approx(axis_intensity(lamp))


def test_a_long_prism_is_a_tube():
    turn = 2.0 * np.pi * np.arange(64) / 64
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(64)], axis=1) * 0.1
    low, high = np.arange(64), 64 + np.arange(64)
    next_low, next_high = np.roll(low, -1), np.roll(high, -1)
    faces = np.concatenate([np.stack([low, next_low, high], 1), np.stack([next_low, next_high, high], 1)])
    prism = MeshLamp(np.concatenate([ring, ring + np.array([0, 0, 3])]), faces, np.array(RADIANCE))
    lamp = TubeLamp(ORIGIN, (0.0, 0.0, 3.0), 0.1, RADIANCE)
    assert flux(lamp) == pytest.approx(np.pi * 2.0 * np.pi * 0.1 * 3.0 * np.array(RADIANCE))
    assert flux(prism) == pytest.approx(flux(lamp), rel=1e-3)
    # The best of the directions that are tried lies some degrees off.
    assert axis_intensity(prism) == pytest.approx(axis_intensity(lamp), rel=5e-3)


def test_cones():
    full = SpotLamp(ORIGIN, AHEAD, RADIANCE, 180.0, 180.0)
    assert flux(full) == pytest.approx(4.0 * np.pi * np.array(RADIANCE))
    hard = SpotLamp(ORIGIN, AHEAD, RADIANCE, 25.0, 25.0)
    assert flux(hard) == pytest.approx(2.0 * np.pi * (1.0 - np.cos(np.radians(25.0))) * np.array(RADIANCE))
    soft = SpotLamp(ORIGIN, AHEAD, RADIANCE, 40.0, 10.0)
    angle = np.radians((np.arange(200_000) + 0.5) * 40.0 / 200_000)
    fall = np.clip((40.0 - np.degrees(angle)) / 30.0, 0.0, 1.0)
    summed = 2.0 * np.pi * (fall * np.sin(angle)).sum() * angle[0] * 2.0
    assert flux(soft) == pytest.approx(summed * np.array(RADIANCE), rel=1e-8)


def test_a_profile_of_a_cone_is_a_spot_and_its_azimuths_are_averaged():
    cone = profile([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0]], [0.0, 10.0, 40.0])
    assert flux(cone) == pytest.approx(flux(SpotLamp(ORIGIN, AHEAD, RADIANCE, 40.0, 10.0)))
    half = profile([[2.0, 2.0, 0.0, 0.0, 2.0]] * 2, [0.0, 180.0], [0.0, 90.0, 180.0, 270.0, 360.0])
    assert flux(half) == pytest.approx(4.0 * np.pi * np.array(RADIANCE))
    assert axis_intensity(half) == pytest.approx(2.0 * np.array(RADIANCE))


@pytest.mark.parametrize(
    "lamp",
    [
        SphereLamp(ORIGIN, 0.5, RADIANCE),
        SphereLamp(ORIGIN, intensity=RADIANCE),
        SpotLamp(ORIGIN, AHEAD, RADIANCE),
        RectangleLamp(ORIGIN, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), RADIANCE),
        TubeLamp(ORIGIN, AHEAD, 0.1, RADIANCE),
        ball(rings=6),
        profile([[1.0, 1.0], [0.5, 0.5]], [0.0, 90.0]),
    ],
)
def test_light_is_linear(lamp):
    factor = np.array([2.0, 0.0, 0.25])
    assert flux(times(lamp, factor)) == pytest.approx(flux(lamp) * factor)
    assert axis_intensity(times(lamp, 3.0)) == pytest.approx(3.0 * axis_intensity(lamp))
    with pytest.raises(InputError, match="expected numbers from 0"):
        times(lamp, 1e15)
