"""What a file says beside its Gaussians: by comments and back, in another frame, of several files together."""

import numpy as np
import pytest
from splat_samples import assert_same, basis_oracle, make_splats, unit_vectors

from splat2mesh.splats.facts import NO_FACTS, FileFacts, comments_of, common, facts_of_comments
from splat2mesh.splats.joining import joined
from splat2mesh.splats.placing import placed, reframed, similarity


@pytest.mark.parametrize(
    "facts",
    [
        NO_FACTS,
        FileFacts(antialiased=True),
        FileFacts(antialiased=False),
        FileFacts(up=(0.6, 0.0, -0.8), up_from="'Vertical axis: 0.6 0 -0.8'"),
    ],
)
def test_comments_say_what_they_were_written_for(facts):
    assert facts_of_comments(comments_of(facts)) == facts


@pytest.mark.parametrize(
    ("comment", "up"),
    [
        ("Vertical Axis: z", (0, 0, 1)),  # nerfstudio
        ("Vertical axis: y", None),  # Brush, where it knows nothing
        ("Vertical axis: 0 0 2", (0, 0, 1)),  # Brush
        ("vertical AXIS: [0, -1, 0]", (0, -1, 0)),
        ("Vertical axis: -z", (0, 0, -1)),
        ("Vertical axis: 1e-1 0 0", (1, 0, 0)),
        ("Vertical axis: 0 0 0", None),
        ("Vertical axis: 1 2", None),
        ("Vertical axis: nan 1 2", None),
        ("Vertical axis: 1e999 1 2", None),
        ("Vertical axis:", None),
        ("the vertical axis: z", None),
    ],
)
def test_the_vertical_axis(comment, up):
    assert facts_of_comments(["made by hand", comment]).up == up


@pytest.mark.parametrize(
    ("comment", "antialiased"),
    [
        ("SplatRenderMode: mip", True),
        ("splatrendermode:  default", False),
        ("SplatRenderMode: 2dgs", None),
        ("antialiased 1", True),  # Postshot
        ("antialiased 0", False),
        ("antialiased", None),
    ],
)
def test_the_render_mode(comment, antialiased):
    assert facts_of_comments([comment]).antialiased is antialiased


def test_up_and_offset_turn_with_the_splats():
    facts = FileFacts(True, (0.0, 0.0, 1.0), "x", offset=(10.0, 20.0, 30.0))
    matrix = similarity(2.0, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], (5, 6, 7))
    splats = make_splats(20, 1)
    object.__setattr__(splats, "facts", facts)
    moved = placed(splats, matrix)
    assert moved.facts.up == (0, 1, 0) and moved.facts.antialiased
    # What a place is in the file's own numbers, the moved one is of the moved numbers.
    whole = splats.means.astype(np.float64) + facts.offset
    expected = whole @ matrix[:3, :3].T + matrix[:3, 3]
    np.testing.assert_allclose(moved.means + np.array(moved.facts.offset), expected, atol=1e-5)


def test_a_fact_on_which_two_files_differ_is_none():
    one, other = FileFacts(True, (0.0, 0.0, 1.0), "a"), FileFacts(False, (0.0, 0.0, 1.0), "b")
    assert common([one, one]) == one
    assert common([one, other]) == FileFacts(up=(0.0, 0.0, 1.0), up_from="a")
    assert common([one, NO_FACTS]) == NO_FACTS


def test_joined_splats_stand_at_one_offset():
    parts = [make_splats(10, 0, seed) for seed in (1, 2, 3)]
    for part, offset in zip(parts, [(0.0, 0.0, 0.0), (5e6, 1.0, 0.0), (5e6 + 3, 0.0, 0.0)], strict=True):
        object.__setattr__(part, "facts", FileFacts(offset=offset))
    whole = np.concatenate([part.means.astype(np.float64) + part.facts.offset for part in parts])
    found = joined(list(parts))
    assert found.facts.offset == (5e6, 1.0, 0.0)
    np.testing.assert_allclose(found.means[10:] + np.array(found.facts.offset), whole[10:], atol=1e-6)
    np.testing.assert_allclose(found.means[:10] + np.array(found.facts.offset), whole[:10], atol=0.5)


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("axes", ["120", "012", "102", "021"])
def test_a_mirrored_splat_looks_mirrored(axes, degree):
    """Colours and covariances at mirrored places and directions, for permutations and signs of both handednesses."""
    splats = make_splats(40, degree)
    directions = unit_vectors(30)
    for signs in ((1, 1, 1), (-1, 1, 1), (-1, -1, -1), (1, -1, 1)):
        matrix = np.diag(signs)[[int(axis) for axis in axes]].astype(float)
        found = reframed(splats, matrix)
        np.testing.assert_allclose(found.means, splats.means @ matrix.T, atol=1e-6)
        shape = matrix @ splats.covariances().astype(np.float64) @ matrix.T
        np.testing.assert_allclose(found.covariances(), shape, atol=1e-5 * np.abs(shape).max())
        before = basis_oracle(directions, degree) @ splats.sh
        after = basis_oracle(directions @ matrix.T, degree) @ found.sh
        np.testing.assert_allclose(after, before, atol=1e-5)
    assert reframed(splats, np.eye(3)) is splats
    assert_same(reframed(reframed(splats, -np.eye(3)), -np.eye(3)), splats)
