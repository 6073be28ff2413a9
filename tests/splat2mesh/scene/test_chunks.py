"""Chunks: every face once, every limit held, seams identical on both sides."""

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.scene.chunks import DEFAULT_MAX_VERTICES, split
from splat2mesh.scene.mesh import Mesh


def random_mesh(vertices=900, faces=1500, seed=0):
    """Triangles between random vertices: the worst of seams. The last tenth of the vertices has no face."""
    rng = np.random.default_rng(seed)
    corners = rng.random((faces, vertices * 9 // 10)).argpartition(3, axis=1)[:, :3]
    return Mesh(
        rng.normal(size=(vertices, 3)).astype(np.float32),
        rng.normal(size=(vertices, 3)).astype(np.float32),
        corners.astype(np.int32),
        rng.integers(0, 256, (vertices, 3), dtype=np.uint8),
    )


def grid_mesh(side=60, stretch=(1.0, 1.0)):
    """A wavy sheet of side x side vertices."""
    x, z = np.meshgrid(np.linspace(0, stretch[0], side), np.linspace(0, stretch[1], side))
    vertices = np.stack([x, 0.1 * np.sin(9 * x), z], axis=-1).reshape(-1, 3).astype(np.float32)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    rng = np.random.default_rng(1)
    normals = rng.normal(size=vertices.shape).astype(np.float32)
    return Mesh(vertices, normals, faces, rng.integers(0, 256, vertices.shape, dtype=np.uint8))


def rows_of(mesh):
    """One row of bytes a vertex, everything that is stored of it: (V, 27) uint8."""
    parts = (mesh.vertices, mesh.normals, mesh.colors_srgb)
    return np.hstack([np.ascontiguousarray(part).view(np.uint8).reshape(len(part), -1) for part in parts])


def face_keys(mesh):
    """Every face as the bytes of its three corners, in order: a list, so that duplicates count."""
    rows = rows_of(mesh)
    return sorted(face.tobytes() for face in rows[mesh.faces])


@pytest.mark.parametrize("limit", [3, 4, 5, 7, 20, 100, 500, 809, 810, 899, 10_000])
@pytest.mark.parametrize("make", [random_mesh, grid_mesh])
def test_every_face_is_in_exactly_one_chunk_with_its_attributes_and_every_limit_holds(make, limit):
    mesh = make()
    chunks = split(mesh, limit)
    assert max(len(chunk.vertices) for chunk in chunks) <= limit
    assert sorted(key for chunk in chunks for key in face_keys(chunk)) == face_keys(mesh)
    for chunk in chunks:
        # Nothing is left over: each vertex of a chunk is a corner of one of its faces, and is there once.
        np.testing.assert_array_equal(np.unique(chunk.faces), np.arange(len(chunk.vertices)))
        assert len(np.unique(rows_of(chunk), axis=0)) == len(chunk.vertices)


def test_types_are_those_of_a_mesh():
    for chunk in split(random_mesh(), 100):
        assert chunk.vertices.dtype == chunk.normals.dtype == np.float32
        assert chunk.faces.dtype == np.int32 and chunk.colors_srgb.dtype == np.uint8


def test_seam_vertices_are_bit_identical_in_every_chunk_that_has_them():
    mesh = grid_mesh()
    known = {row[:12].tobytes(): row.tobytes() for row in rows_of(mesh)}
    assert len(known) == len(mesh.vertices)  # positions identify the vertices of this mesh
    copies = {}
    for chunk in split(mesh, 200):
        for row in rows_of(chunk):
            assert known[row[:12].tobytes()] == row.tobytes()
            copies[row.tobytes()] = copies.get(row.tobytes(), 0) + 1
    assert set(copies) == set(known.values())
    assert max(copies.values()) > 1


def test_vertices_without_a_face_are_left_out():
    mesh = random_mesh()
    used = np.unique(mesh.faces)
    assert len(used) < len(mesh.vertices)
    (chunk,) = split(mesh)
    np.testing.assert_array_equal(chunk.vertices, mesh.vertices[used])
    np.testing.assert_array_equal(chunk.vertices[chunk.faces], mesh.vertices[mesh.faces])


def test_a_mesh_within_the_limit_comes_back_as_it_was():
    mesh = grid_mesh(20)
    for limit in (400, DEFAULT_MAX_VERTICES):
        (chunk,) = split(mesh, limit)
        for name in ("vertices", "normals", "faces", "colors_srgb"):
            np.testing.assert_array_equal(getattr(chunk, name), getattr(mesh, name))


def test_the_same_mesh_is_cut_the_same_way_twice():
    for first, second in zip(split(random_mesh(), 50), split(random_mesh(), 50), strict=True):
        for name in ("vertices", "normals", "faces", "colors_srgb"):
            assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


@pytest.mark.parametrize("limit", [300, 950, 1900])
def test_chunks_are_few_compact_and_of_similar_size(limit):
    mesh = grid_mesh(60, stretch=(4.0, 1.0))
    chunks = split(mesh, limit)
    sizes = np.array([len(chunk.vertices) for chunk in chunks])
    # Square chunks of 300 vertices repeat a ninth of them on their seams; the rest is bisection's own waste.
    fewest = int(np.ceil(len(mesh.vertices) / limit))
    assert len(chunks) <= 1.5 * fewest
    assert sizes.min() > 0.4 * sizes.max()
    # A sheet four times as long as wide: no chunk is longer than a square of its area calls for, by more than 3.
    for chunk in chunks:
        extent = np.ptp(chunk.vertices[:, [0, 2]], axis=0)
        assert extent.max() < 3 * np.sqrt(4.0 * len(chunk.faces) / len(mesh.faces))


def test_faces_all_in_one_place_are_still_split():
    mesh = random_mesh()
    flat = Mesh(np.zeros_like(mesh.vertices), mesh.normals, mesh.faces, mesh.colors_srgb)
    chunks = split(flat, 30)
    assert max(len(chunk.vertices) for chunk in chunks) <= 30
    assert sorted(key for chunk in chunks for key in face_keys(chunk)) == face_keys(flat)


@pytest.mark.parametrize("limit", [2, 0, -5])
def test_a_limit_that_holds_no_triangle_is_refused(limit):
    with pytest.raises(InputError, match=f"at least 3 vertices, the limit is {limit}"):
        split(grid_mesh(5), limit)
