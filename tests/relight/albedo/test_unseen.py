"""Backs of thin walls: found where both sides have one colour, never on solids."""

import numpy as np
import open3d as o3d

from relight.albedo.unseen import backs
from relight.transfer.occluder import Occluder


def open_box(thickness=0.04):
    """A room without a ceiling and front, its walls meshed on both sides: (Occluder, inside (V,) bool)."""
    walls = [
        ((2.0, thickness, 2.0), (-1.0, -thickness, -1.0)),
        ((2.0, 1.2, thickness), (-1.0, 0.0, -1.0 - thickness)),
        ((thickness, 1.2, 2.0), (-1.0 - thickness, 0.0, -1.0)),
        ((thickness, 1.2, 2.0), (1.0, 0.0, -1.0)),
    ]
    vertices, normals, faces, start = [], [], [], 0
    for size, corner in walls:
        box = o3d.geometry.TriangleMesh.create_box(*size).translate(corner).subdivide_midpoint(3)
        box.compute_vertex_normals()
        vertices.append(np.asarray(box.vertices, np.float32))
        normals.append(np.asarray(box.vertex_normals, np.float32))
        faces.append(np.asarray(box.triangles) + start)
        start += len(vertices[-1])
    vertices, normals = np.concatenate(vertices), np.concatenate(normals)
    toward = np.array([0.0, 0.4, 0.0]) - vertices
    return Occluder(vertices, normals, np.concatenate(faces)), np.einsum("ij,ij->i", toward, normals) > 0


def test_outer_sides_of_walls_of_one_colour_are_backs_and_inner_ones_are_not():
    occluder, inside = open_box()
    colors = np.full((len(inside), 3), 0.4, np.float32)
    visible = np.where(inside, 0.4, 0.9)
    found = backs(occluder, colors, visible)
    assert not found[inside].any()
    assert found[~inside].mean() > 0.2  # the rest are edges and rims, whose rays leave sideways


def test_sides_of_two_colours_were_both_seen():
    occluder, inside = open_box()
    colors = np.where(inside[:, None], 0.2, 0.6).astype(np.float32) * np.ones((1, 3), np.float32)
    assert not backs(occluder, colors, np.where(inside, 0.4, 0.9)).any()


def test_a_solid_has_no_backs():
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 20)
    ball.compute_vertex_normals()
    occluder = Occluder(*(np.asarray(a) for a in (ball.vertices, ball.vertex_normals, ball.triangles)))
    assert not backs(occluder, np.full((len(ball.vertices), 3), 0.5, np.float32), np.ones(len(ball.vertices))).any()
