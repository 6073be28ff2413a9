"""Meshes of other libraries far from the origin, which float32 would lose."""

from dataclasses import replace

import numpy as np
import pytest
from viewer_scenes import ball_on_plate

from relight import Environment, Relighter
from relight.lamps.shapes import SphereLamp, moved
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.foreign import as_scene
from splat2mesh.scene.mesh import Mesh


def as_mesh(vertices, normals, faces, colors):
    return Mesh(vertices, normals, faces, colors)


def as_trimesh(vertices, normals, faces, colors):
    trimesh = pytest.importorskip("trimesh")
    return trimesh.Trimesh(vertices, faces, vertex_normals=normals, vertex_colors=colors, process=False)


@pytest.mark.parametrize("make", [as_mesh, as_trimesh])
def test_a_mesh_in_float64_is_lit_as_well_far_from_the_origin(make):
    """Float32 has steps of 1/16 at 1e6. The matrix of the scene keeps the way back, for lamps and objects."""
    near = ball_on_plate().chunks[0]
    shift = np.float64([1e6, -1e6, 1e6])
    near_shape = near.vertices.astype(np.float64), near.normals, near.faces, near.colors_srgb
    with pytest.warns(DataWarning, match=r"moved by \(-999999.25, 1000000.25, -999999.25\); lamps") as warned:
        far = as_scene(make(near_shape[0] + shift, *near_shape[1:]))
    assert len(warned) == 1 and "rounded" not in str(warned[0].message) and far.vertices.dtype == np.float32
    back = far.vertices - far.scene_from_splat[:3, 3]
    np.testing.assert_allclose(back, near_shape[0] + shift, rtol=0, atol=1e-6)
    light = Environment.load("noon")
    found, expected = (Relighter(each, tolerance=0.03).shade(light) for each in (far, make(*near_shape)))
    np.testing.assert_allclose(found, expected, atol=0.02)
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)  # was 6% and more


def test_what_float32_has_lost_already_is_said_with_figures():
    near = ball_on_plate().chunks[0]
    with pytest.warns(DataWarning, match=r"rounded to 0\.0625, \d+\.\d% of its median edge: make it of float64"):
        as_scene(Mesh(near.vertices + np.float32(1e6), near.normals, near.faces, near.colors_srgb))


def test_a_lamp_keeps_to_the_coordinates_of_a_far_mesh(tmp_path):
    near = ball_on_plate().chunks[0]
    lamp = SphereLamp((0.4, 1.5, 0.3), 0.1, (9.0, 9.0, 9.0))
    path = tmp_path / "far.ply"
    header = f"ply\nformat ascii 1.0\nelement vertex {len(near.vertices)}\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz") + f"element face {len(near.faces)}\n"
    rows = [f"{x + 1e6:.17g} {y:.17g} {z:.17g}" for x, y, z in near.vertices.tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in near.faces.tolist()]
    path.write_text(header + "property list uchar int vertex_indices\nend_header\n" + "\n".join(rows) + "\n")
    with pytest.warns(DataWarning, match="moved by"):
        far = as_scene(path)
    moved_lamp = moved(replace(lamp, position=(1e6 + 0.4, 1.5, 0.3)), far.scene_from_splat)
    middle = -far.scene_from_splat[:3, 3] - [1e6, 0, 0]
    np.testing.assert_allclose(np.array(moved_lamp.position) + middle, lamp.position, atol=1e-6)


def test_a_far_mesh_whose_faces_name_nothing_is_refused():
    near = ball_on_plate().chunks[0]
    with pytest.raises(InputError, match="names a vertex beyond"):
        as_scene(Mesh(near.vertices + np.float64(1e6), near.normals, near.faces + len(near.vertices), near.colors_srgb))
