"""Light on a scene in another pose, by the rays of the first one: what the motion does not reach stays to the bit."""

from dataclasses import replace

import numpy as np
import pytest
from bush import bush_scene
from moving_meshes import ball, grid, mesh
from scipy.spatial.transform import Rotation

from relight import Environment, Relighter
from relight.transfer.occluder import Occluder
from relight.transfer.precomputed import PosedPrecomputed, Precomputed
from relight.transfer.settings import Settings
from relight.transfer.visibility import Visibility
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

SETTINGS = Settings("raytraced", 4, 24, bounce_rays=16, bounce_tolerance=1e-3)
BODY = 1


def table_scene(radius=0.2):
    """A table and, in chunk BODY, a ball over it."""
    return Scene([mesh(*grid(40)), mesh(*ball(radius, [-0.5, 1.5 * radius, 0.1]))])


def moved(scene, turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0), faces=slice(None)):
    """The scene with its body turned about its middle and shifted, some of its faces gone."""
    body, rotation = scene.chunks[BODY], Rotation.from_euler("xyz", turn)
    middle = body.vertices.mean(axis=0)
    vertices = (rotation.apply(body.vertices - middle) + middle + shift).astype(np.float32)
    normals = rotation.apply(body.normals).astype(np.float32)
    return Scene([scene.chunks[0], Mesh(vertices, normals, body.faces[faces], body.colors_srgb)])


@pytest.mark.parametrize(
    "motion",
    [
        {"shift": (0.4, 0.1, 0.0)},
        {"turn": (0.3, 2.0, 1.0)},
        {"turn": (0.0, 0.4, 0.0), "shift": (0.0, -0.25, 0.0)},
        {"shift": (0.3, 0.0, 0.3), "faces": slice(0, None, 2)},
    ],
)
def test_rays_are_those_of_the_first_pose(motion):
    scene = table_scene()
    first, then = Precomputed(scene, 0), moved(scene, **motion)
    first.transfer(SETTINGS)
    whole = Visibility(Occluder(then.vertices, then.normals, then.faces, first.occluder), SETTINGS.rays)
    np.testing.assert_array_equal(PosedPrecomputed(first, then).transfer(SETTINGS)[0], whole.transfer(SETTINGS.bands))


def test_a_body_that_stays_keeps_its_light_to_the_bit():
    scene, light = table_scene(), Environment.load("noon")
    albedo = np.full(scene.vertices.shape, 0.5, np.float32)
    relighter = Relighter(scene, "raytraced", bands=4, rays=24)
    lit = relighter.shading(light, albedo)
    again = relighter.posed(Scene(scene.chunks), lit.settings).posed(Scene(scene.chunks), lit.settings)
    np.testing.assert_array_equal(again.shading(light, albedo).radiance, lit.radiance)


def test_light_changes_where_the_shadow_was_or_is_alone():
    scene, light = table_scene(0.1), Environment.load("noon")
    relighter = Relighter(scene, "raytraced", bands=4, rays=64, effects="shadows,sun")
    lit = relighter.shading(light)
    posed = relighter.posed(moved(scene, shift=(0.2, 0.0, 0.0)), lit.settings)
    table = slice(0, len(scene.chunks[0].vertices))
    before, after = lit.radiance[table], posed.shading(light).radiance[table]
    same = (before == after).all(axis=1)
    fresh = Relighter(moved(scene, shift=(0.2, 0.0, 0.0)), "raytraced", bands=4, rays=64, effects="shadows,sun")
    expected = fresh.shading(light).radiance[table]
    change = np.abs(expected - before).max(axis=1)
    assert same.mean() > 0.1 and change[same].max() < 0.1 * change.max()  # of tracing with other rays
    error = np.linalg.norm(after - expected) / np.linalg.norm(expected)
    assert error < 0.03 < 0.1 < np.linalg.norm(before - expected) / np.linalg.norm(expected)


def test_leaves_are_lit_beside_what_moves():
    scene, light = bush_scene(), Environment.load("noon")
    relighter = Relighter(scene, "raytraced", bands=3, rays=16, effects="shadows,sun,volume")
    lit = relighter.shading(light)
    assert lit.settings.volume
    still = relighter.posed(replace(scene), lit.settings)
    np.testing.assert_array_equal(still.shading(light).radiance, lit.radiance)
    chunks = [replace(each, vertices=each.vertices.copy()) for each in scene.chunks]
    corner = np.linalg.norm(chunks[0].vertices - chunks[0].vertices[0], axis=1) < 0.3
    chunks[0].vertices[corner] -= np.float32([0.0, 0.2, 0.0])
    then = still.posed(replace(scene, chunks=chunks), lit.settings).shading(light).radiance
    changed = (then != lit.radiance).any(axis=1)
    far = np.linalg.norm(scene.vertices - scene.vertices[0], axis=1) > 0.5
    error = np.abs(then - lit.radiance)[far].mean() / lit.radiance[far].mean()
    assert changed[~far].any() and error < 0.01  # a dent in a corner of the lawn
