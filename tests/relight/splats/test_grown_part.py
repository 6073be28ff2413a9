"""A part grows over what is joined by like colours, as far as a crease, whatever the chunks and the frame."""

from dataclasses import replace

import numpy as np
import pytest
from ball_splats import solid_ball

from relight.splats.attachment import Surface
from relight.splats.grown_part import GrowingSurface
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

SIDE, STEP, REACH = 41, 0.1, 0.2
TOP = np.array([2.0, 1.0, 2.0])
"""The middle of the block's top."""

FRAME = np.diag([2.0, -2.0, -2.0, 1.0])


def block_on_plate(max_chunk_vertices=100_000, frame=None):
    """A plate of 4 x 4 units, out of which a block of 1.4 x 1.4 x 1 stands: (Scene, its top, its foot, what is blue and
    not red). One surface, with vertical sides."""
    x, z = (each.ravel() for each in np.meshgrid(*[np.arange(SIDE) * STEP] * 2, indexing="ij"))
    inside = np.maximum(np.abs(x - 2.0), np.abs(z - 2.0)) < 0.75
    rim = np.maximum(np.abs(x - 2.0), np.abs(z - 2.0)) < 0.85
    shrunk = np.where(rim & ~inside, 0.7 / 0.8, 1.0)  # the foot lies below the edge of the top
    vertices = np.stack([2 + shrunk * (x - 2), np.where(inside, 1.0, 0.0), 2 + shrunk * (z - 2)], axis=1)
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    halves = (corner, corner + 1, corner + SIDE), (corner + SIDE, corner + 1, corner + SIDE + 1)
    faces = np.concatenate([np.stack(each, axis=1) for each in halves]).astype(np.int32)
    a, b, c = vertices[faces.T]
    normals = np.zeros_like(vertices)
    for each in faces.T:
        np.add.at(normals, each, np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    blue = x > 2.35
    colors = np.where(blue[:, None], [40, 40, 200], [200, 60, 40]).astype(np.uint8)
    mesh = Mesh(vertices.astype(np.float32), normals.astype(np.float32), faces, colors)
    scene = Scene.from_mesh(mesh, max_chunk_vertices)
    return (scene if frame is None else replace(scene, scene_from_splat=frame)), inside, rim & ~inside, blue


def growing(scene, colors=None):
    return GrowingSurface(Surface(scene), scene.colors_linear if colors is None else colors)


def around(scene, part):
    """The positions of a part, in order, whatever the chunks."""
    return np.unique(np.round(scene.vertices[part], 3), axis=0)


def test_a_block_comes_off_its_plate_of_the_same_colour():
    scene, top, foot, _ = block_on_plate()
    part = growing(scene, np.full(scene.vertices.shape, 0.5)).grown(TOP, REACH)
    assert not part[~(top | foot)].any()  # not over concave edges
    assert (~part[top | foot]).sum() <= 4 and part[top].all()  # but over convex ones, to all but corners of the foot
    whole = growing(scene, np.full(scene.vertices.shape, 0.5)).grown(TOP, 1.0)
    assert whole.all()


def test_a_part_ends_where_the_colour_does():
    scene, top, _, blue = block_on_plate()
    surface = growing(scene)
    part = surface.grown(TOP, REACH)
    assert not part[blue].any() and part[top & (scene.vertices[:, 0] < 2.2)].all()
    assert surface.grown(TOP, 2.0).all()


def test_a_larger_reach_holds_the_smaller_part():
    scene = block_on_plate()[0]
    rng = np.random.default_rng(3)
    surface = growing(scene, scene.colors_linear + rng.normal(0, 0.01, scene.vertices.shape))
    before = np.zeros(len(scene.vertices), bool)
    for reach in (0.02, 0.05, 0.1, 0.2, 0.4, 0.8):
        part = surface.grown(TOP, reach)
        assert (part | ~before).all()
        before = part


def test_chunks_and_frames_change_nothing():
    """In the splat's frame the block hangs down and is half as large."""
    scene = block_on_plate()[0]
    expected = around(scene, growing(scene).grown(TOP, REACH))
    for other, place in ((block_on_plate(300)[0], TOP), (block_on_plate(300, FRAME)[0], TOP / [2, -2, -2])):
        assert len(other.chunks) > 1
        np.testing.assert_array_equal(around(other, growing(other).grown(place, REACH)), expected)


@pytest.mark.parametrize("frame", [None, FRAME])
def test_splats_are_in_the_part_of_their_nearest_vertex(frame):
    scene, _, _, blue = block_on_plate(frame=frame)
    splats = solid_ball(count=1200)
    matrix = np.linalg.inv(np.asarray(scene.scene_from_splat))[:3, :3]
    means = np.tile(scene.vertices @ matrix.T, (2, 1))[:1200].astype(np.float32)
    means[1000:1100, 1] += 50.0  # far from every surface
    means[1100:] = np.nan
    found = growing(scene).splats_of(blue, replace(splats, means=means))
    np.testing.assert_array_equal(found[:1000], blue[:1000])
    assert found[:1000].any() and not found[1000:].any()
