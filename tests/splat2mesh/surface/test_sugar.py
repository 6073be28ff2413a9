"""The SuGaR way to a surface: level crossings against the closed form of the density, Poisson of a sphere."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from splat2mesh.base.errors import InputError
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.sugar import (
    DENSITY_LEVEL,
    NEIGHBORS,
    STEPS,
    DensityField,
    SurfacePoints,
    poisson,
    surface_points,
)

SPREAD, THICKNESS, OPACITY = 0.5, 0.02, 0.8

# The level is found by a straight line between two samples 6 / (STEPS - 1) standard deviations apart. A Gaussian
# lies at most h^2 / 8 off that line, and where these tests cross the level its slope is at least 0.3.
CROSSING = (6 / (STEPS - 1)) ** 2 / 8 / 0.3


def layer(turn=None, center=(0, 0, 0), thickness=THICKNESS):
    """4 x 4 = NEIGHBORS flat Gaussians in the plane z = 0, so that the density is their full sum: one flat layer."""
    turn = Rotation.identity() if turn is None else turn
    grid = np.stack([*np.meshgrid([-0.6, -0.2, 0.2, 0.6], [-0.6, -0.2, 0.2, 0.6]), np.zeros((4, 4))], -1).reshape(-1, 3)
    count = len(grid)
    x, y, z, w = turn.as_quat()
    return Splats(
        means=turn.apply(grid) + center,
        scales=np.tile([SPREAD, SPREAD, thickness], (count, 1)),
        quats_wxyz=np.tile([w, x, y, z], (count, 1)),
        opacities=np.full(count, OPACITY),
        sh=np.zeros((count, 1, 3)),
    )


def density_and_gradient(splats, points):
    """The sum over all Gaussians, in float64, from their covariances."""
    precision = np.linalg.inv(splats.covariances().astype(float))
    offset = points[:, None].astype(float) - splats.means
    pull = np.einsum("nij,pnj->pni", precision, offset)
    value = splats.opacities * np.exp(-0.5 * (pull * offset).sum(axis=-1))
    return value.sum(axis=1), -(value[..., None] * pull).sum(axis=1)


def test_a_flat_layer_is_met_where_the_closed_form_says():
    splats = layer()
    assert len(splats) == NEIGHBORS
    x, y = np.random.default_rng(0).uniform(-0.7, 0.7, (2, 200))
    offsets = np.stack([x, y], 1)[:, None] - splats.means[:, :2]
    in_plane = OPACITY * np.exp(-(offsets**2).sum(axis=-1) / (2 * SPREAD**2)).sum(axis=1)
    # Density = in_plane(x, y) exp(-z^2 / 2 t^2) = DENSITY_LEVEL, met from above.
    height = THICKNESS * np.sqrt(2 * np.log(in_plane / DENSITY_LEVEL))
    start = np.stack([x, y, np.zeros(200)], axis=1)
    for sign in (1, -1):
        found = DensityField(splats).crossings(start, np.tile([0.0, 0.0, -sign], (200, 1)))
        assert found.points.dtype == found.normals.dtype == np.float32 and len(found.points) == 200
        np.testing.assert_array_equal(found.points[:, :2], start[:, :2].astype(np.float32))
        np.testing.assert_allclose(sign * found.points[:, 2], height, atol=CROSSING * THICKNESS)
        assert (sign * found.normals[:, 2] > 0).all()


@pytest.mark.parametrize("seed", range(4))
def test_oblique_rays_end_on_the_level_with_the_gradients_normal(seed):
    rng = np.random.default_rng(seed)
    turn, center = Rotation.random(random_state=seed), rng.normal(size=3) * 10
    splats = layer(turn, center, thickness=SPREAD / 2)
    local = np.stack([*rng.uniform(-0.6, 0.6, (2, 300)), np.zeros(300)], axis=1)
    slope = np.stack([*rng.uniform(-0.4, 0.4, (2, 300)), -np.ones(300)], axis=1)
    directions = turn.apply(slope / np.linalg.norm(slope, axis=1, keepdims=True))
    found = DensityField(splats).crossings(turn.apply(local) + center, directions)
    assert len(found.points) == 300
    density, gradient = density_and_gradient(splats, found.points)
    distance = np.abs(density - DENSITY_LEVEL) / np.linalg.norm(gradient, axis=1)
    assert distance.max() < CROSSING * SPREAD
    expected = -gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    # float32 positions about 10 from the origin, seen by Gaussians 0.25 thick.
    np.testing.assert_allclose(found.normals, expected, atol=1e-5)
    assert ((found.normals * directions).sum(axis=1) < 0).all()
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-6)


def test_rays_that_stay_below_the_level_are_dropped():
    splats = layer()
    faint = Splats(splats.means, splats.scales, splats.quats_wxyz, np.full(16, 0.01), splats.sh)
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    assert len(DensityField(faint).crossings(np.zeros((2, 3)), down).points) == 0
    beside = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]])
    found = DensityField(splats).crossings(beside, down)
    assert len(found.points) == len(found.normals) == 1 and abs(found.points[0, 0]) < 1e-6


@pytest.mark.parametrize("stride", [1, 2, 3, 5])
def test_surface_points_lie_on_the_rays_of_the_pixels_that_are_solid(stride):
    splats = layer()
    view = View.look_at([0.1, 0.2, 2.0], [0.05, 0.0, 0.0], [0, 1, 0], 20.0, 40, 32)
    rays = view.ray_directions()
    depth = (-view.center[2] / rays[..., 2]).astype(np.float32)  # where the rays meet z = 0
    depth[:, :5] = np.nan
    alpha = np.ones((32, 40), np.float32)
    alpha[:4] = 0.4
    rendering = SimpleNamespace(depth_median=depth, alpha=alpha)
    found = surface_points(DensityField(splats), view, rendering, stride)
    rows, columns = (np.arange(stride // 2, size, stride) for size in (32, 40))
    expected = [(c + 0.5, r + 0.5) for r in rows if r >= 4 for c in columns if c >= 5]
    pixels, _ = view.project(found.points)
    # float32 world positions through a focal length of 113 pixels.
    np.testing.assert_allclose(pixels, expected, atol=1e-3)
    assert (found.points[:, 2] > 0).all() and (found.normals[:, 2] > 0.5).all()


def sphere_points(count=4000, radius=2.0, center=(5.0, 0.0, -1.0)):
    k = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    normals = np.stack([np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z], axis=1)
    return SurfacePoints((radius * normals + center).astype(np.float32), normals.astype(np.float32))


def test_poisson_of_a_sphere_is_closed_outward_and_of_its_radius():
    mesh = poisson(sphere_points(), 6)
    vertices, faces = np.asarray(mesh.vertices) - [5.0, 0.0, -1.0], np.asarray(mesh.triangles)
    # An octree cell is 1.1 * 4 / 2^6 = 0.07 wide; second order within it.
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 2.0, atol=0.01)
    assert mesh.is_edge_manifold(allow_boundary_edges=False)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * 8, rel=0.01)  # positive: counter-clockwise seen from outside


def test_poisson_cuts_away_what_no_point_supports():
    whole = sphere_points(40_000)
    upper = whole.points[:, 2] > -1.0
    mesh = poisson(SurfacePoints(whole.points[upper], whole.normals[upper]), 7)
    vertices = np.asarray(mesh.vertices)
    # Points lie 0.036 apart; three octree levels less dense is eight times as far, and the rim may run on by twice
    # that. Untrimmed, the sheet runs on to the end of the octree, 1.4 away.
    assert cKDTree(whole.points[upper]).query(vertices)[0].max() < 16 * 0.036
    assert mesh.get_surface_area() == pytest.approx(2 * np.pi * 4, rel=0.3)


def test_no_points_make_no_surface():
    nothing = np.zeros((0, 3), np.float32)
    with pytest.raises(InputError, match="no surface points were found"):
        poisson(SurfacePoints(nothing, nothing), 6)
