import numpy as np
import pytest

from relight.transfer import checks
from splat2mesh.base.errors import InputError

POINTS, FACES = np.zeros((3, 3)), np.array([[0, 1, 2]])


def test_what_fits_comes_back_as_float32():
    for albedo in (np.ones((4, 3)), np.zeros((4, 3), bool), [[0, 0.5, 1]] * 4):
        assert checks.checked_albedo(albedo, 4).dtype == np.float32
    kept = np.full((4, 3), 0.5, np.float32)
    assert checks.checked_albedo(kept, 4) is kept
    checks.check_mesh(POINTS, POINTS)
    checks.check_faces(FACES, 3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: checks.checked_albedo(np.ones((4, 3)), 5), r"the albedo must have shape \(5, 3\), found \(4, 3\)"),
        (lambda: checks.checked_albedo(np.ones((4, 3)) * 2, 4, "albedo 'red'"), r"albedo 'red' must be in \[0, 1\]"),
        (lambda: checks.checked_albedo(np.full((4, 3), np.nan), 4), r"in \[0, 1\], found nan"),
        (lambda: checks.checked_albedo(np.full((4, 3), "a"), 4), "must hold numbers"),
        (lambda: checks.check_shape("the light", 3.0, (9, 3)), r"the light must have shape \(9, 3\), found \(\)"),
        (lambda: checks.check_mesh(POINTS, POINTS[:2]), r"the normals must have shape \(3, 3\), found \(2, 3\)"),
        (lambda: checks.check_vertices(POINTS[:, :2]), r"shape \(V, 3\), found \(3, 2\)"),
        (lambda: checks.check_vertices(np.array([[0, np.inf, 0], [0, 0, 0]])), "1 of 2 vertices are not finite"),
        (lambda: checks.check_faces(FACES[:0], 3), "light needs a surface"),
        (lambda: checks.check_faces(FACES[:, :2], 3), r"shape \(F, 3\)"),
        (lambda: checks.check_faces(FACES, 2), "faces name vertices 0 to 2, the mesh has 2"),
        (lambda: checks.check_faces(FACES - 1, 3), "faces name vertices -1 to 1"),
    ],
)
def test_what_does_not_is_refused_in_one_line(call, message):
    with pytest.raises(InputError, match=message) as found:
        call()
    assert "\n" not in str(found.value)
