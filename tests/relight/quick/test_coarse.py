"""Places without a mesh: normals against the shape that splats were laid on, visibility against what hides the sky."""

import numpy as np
import pytest
from ball_splats import RADIUS, solid_ball
from place_splats import garden, room

from relight.quick.coarse import coarse_surface
from splat2mesh.base.progress import Stages
from splat2mesh.capture import capture_of
from splat2mesh.options import ConvertOptions
from splat2mesh.splats.formats import write_inria_ply


def surface_of(splats, folder, up):
    write_inria_ply(folder / "splat.ply", splats)
    capture = capture_of(folder / "splat.ply", ConvertOptions(up=up), Stages())
    return capture, coarse_surface(capture)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    return surface_of(solid_ball(), tmp_path_factory.mktemp("ball"), "-y")


@pytest.fixture(scope="module")
def lawn(tmp_path_factory):
    return surface_of(garden(), tmp_path_factory.mktemp("lawn"), "+y")


def test_normals_of_a_ball_point_outwards(ball):
    capture, surface = ball
    shell = np.linalg.norm(surface.points, axis=1) > 0.97 * RADIUS
    outwards = surface.points @ capture.rotation[:3, :3].T
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    cosine = np.einsum("ni,ni->n", outwards, surface.normals)[shell]
    assert np.median(cosine) > 0.99 and (cosine > 0.9).mean() > 0.98


def test_nothing_hides_the_sky_from_a_ball(ball):
    _, surface = ball
    shell = np.linalg.norm(surface.points, axis=1) > 0.97 * RADIUS
    assert np.median(surface.visible[shell]) == pytest.approx(1.0, abs=0.03)  # 512 directions
    assert surface.visible.max() < 1.05


def test_a_lawn_faces_up_and_a_table_hides_its_sky(lawn):
    _, surface = lawn
    flat = (surface.points[:, 1] < 0.05) & (np.abs(surface.points[:, [0, 2]]) < 3.5).all(axis=1)
    assert np.median(surface.normals[flat, 1]) > 0.98
    under = flat & (np.abs(surface.points[:, [0, 2]]) < 0.3).all(axis=1)
    apart = flat & (np.abs(surface.points[:, [0, 2]]) > 2.0).any(axis=1)
    # The table's top fills a third of the cosine-weighted sky of what lies 0.7 below the middle of 1.2 x 1.2.
    assert surface.visible[under].mean() < surface.visible[apart].mean() - 0.2


def test_a_closed_room_sees_no_sky(tmp_path):
    _, surface = surface_of(room(), tmp_path, "+y")
    assert surface.visible.mean() < 0.1


def test_the_same_seed_gives_the_same_places(ball):
    capture, surface = ball
    np.testing.assert_array_equal(coarse_surface(capture).points, surface.points)
