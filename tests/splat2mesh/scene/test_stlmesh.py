"""STL: a tetrahedron in both kinds is the same tetrahedron."""

import struct

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.scene.stlmesh import read_stl


def tetrahedron():
    """(4, 3, 3) corners of facets, and (4, 3) normals; each facet has a normal of its own."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    corners = points[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def binary(corners, normals):
    rows = [struct.pack("<12fH", *n, *c.ravel(), 0) for n, c in zip(normals, corners, strict=True)]
    return bytes(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def text(corners, normals):
    lines = ["solid made here"]
    for normal, triangle in zip(normals, corners, strict=True):
        lines += ["facet normal {!r} {!r} {!r}".format(*normal.tolist()), "outer loop"]
        lines += ["vertex {!r} {!r} {!r}".format(*corner.tolist()) for corner in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid"]).encode()


def stored(tmp_path, content):
    (tmp_path / "a.stl").write_bytes(content)
    return tmp_path / "a.stl"


@pytest.mark.parametrize("make", [binary, text])
def test_every_facet_comes_back_with_its_normal(tmp_path, make):
    corners, normals = tetrahedron()
    found = read_stl(stored(tmp_path, make(corners, normals)))
    np.testing.assert_array_equal(found.points[found.faces], corners)
    np.testing.assert_allclose(found.normals[found.faces], np.repeat(normals[:, None], 3, axis=1), rtol=1e-7)
    # Facets of a solid with sharp edges share places, not normals: nothing is joined.
    assert len(found.points) == 12 and found.colors is None


def test_facets_of_one_plane_share_their_corners(tmp_path):
    corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    found = read_stl(stored(tmp_path, binary(corners, np.tile([0.0, 0, 1], (2, 1)))))
    assert found.points.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert found.faces.tolist() == [[0, 1, 2], [0, 2, 3]]


@pytest.mark.parametrize("make", [binary, text])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_what_is_cut_short_is_refused(tmp_path, make, share):
    content = make(*tetrahedron())
    with pytest.raises(InputError, match="cut short"):
        read_stl(stored(tmp_path, content[: int(share * len(content))]))


def test_bytes_after_the_last_facet_of_a_binary_file_are_its_writers(tmp_path):
    corners, normals = tetrahedron()
    found = read_stl(stored(tmp_path, binary(corners, normals) + b"more"))
    np.testing.assert_array_equal(found.points[found.faces], corners)
