"""The raw surface on the city's lattice, and decimation that leaves a border alone."""

import numpy as np

from splat2mesh.scene.mesh import normals_of
from splat2mesh.surface.simplify import simplify
from splat2mesh.tiles.lattice import Raw, seam_edges, seam_of, smoothed


def sheet(size=24, seed=0):
    """A bumpy sheet of size x size vertices: points, faces, cells."""
    x, z = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    y = np.random.default_rng(seed).normal(0, 0.05, x.shape)
    index = np.arange(size * size).reshape(size, size)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).astype(float), faces.astype(np.int32), np.ones(size * size)


def parted(points, faces):
    """A Raw of two tiles, left and right of the middle."""
    middle = points[faces].mean(axis=1)[:, 0]
    return Raw(points, faces, np.ones(len(points)), (middle > points[:, 0].mean()).astype(np.int64))


def test_fixed_vertices_stay_to_the_bit_with_the_edges_between_them():
    points, faces, cells = sheet()
    raw = parted(points, faces)
    seam = seam_of(raw, 0)
    own = faces[raw.owner == 0]
    used, local = np.unique(own, return_inverse=True)
    local = local.reshape(-1, 3).astype(np.int32)
    at, found, _, origin = simplify(points[used], local, cells[used], 80, seam[used])
    assert len(at) < 0.5 * len(used)
    kept = np.flatnonzero(origin >= 0)
    assert sorted(used[origin[kept]]) == np.flatnonzero(seam).tolist()
    np.testing.assert_array_equal(at[kept], points[used[origin[kept]]])
    number = {used[origin[row]]: row for row in kept}
    edges = {frozenset(edge) for face in found.tolist() for edge in zip(face, face[1:] + face[:1], strict=True)}
    for a, b in seam_edges(raw, 0)[0]:
        assert frozenset((number[a], number[b])) in edges


def test_both_sides_name_the_same_border():
    raw = parted(*sheet()[:2])
    (ours, of_ours), (theirs, of_theirs) = seam_edges(raw, 0), seam_edges(raw, 1)
    np.testing.assert_array_equal(ours, theirs)
    assert set(of_ours) == {1} and set(of_theirs) == {0} and len(ours) >= 23
    np.testing.assert_array_equal(seam_of(raw, 0), seam_of(raw, 1))


def test_a_border_does_not_depend_on_data_far_from_it():
    points, faces, _ = sheet()
    raw = parted(points, faces)
    seam = np.flatnonzero(seam_of(raw, 0))
    near = np.abs(points[faces].mean(axis=1)[:, 0] - points[:, 0].mean()) < 6
    used, local = np.unique(faces[near], return_inverse=True)
    part = Raw(points[used], local.reshape(-1, 3).astype(np.int32), np.ones(len(used)), raw.owner[near])
    soft, soft_part = smoothed(raw), smoothed(part)
    rows = np.searchsorted(used, seam)
    np.testing.assert_array_equal(soft_part[rows], soft[seam])
    np.testing.assert_array_equal(normals_of(soft_part, part.faces)[rows], normals_of(soft, faces)[seam])


def test_a_vertex_whose_faces_have_no_area_takes_its_neighbours_normal():
    points = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0], [2.0, 0, 0], [3.0, 0, 0]])
    normals = normals_of(points, np.array([[0, 1, 2], [2, 3, 4]]))
    np.testing.assert_allclose(normals[:4], [[0, 1, 0]] * 4)
    assert np.isfinite(normals).all()
