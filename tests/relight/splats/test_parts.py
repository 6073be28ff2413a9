"""Shares of a new light, their rim, and what they blend."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from splat_samples import make_splats

from relight.splats.part_spec import SplatFile
from relight.splats.parts import NEXT, AskedPart, PartShares, blended, blended_splats, with_rim
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0


def lattice(count=12):
    """Points of a plane, each with six others at distance 1."""
    i, j = (each.ravel() for each in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    return np.stack([i + j / 2, j * np.sqrt(0.75), 0 * i], axis=1).astype(np.float32), i, j


def lit_pair(seed=0):
    """Splats as captured and in another light: colours well above the toe of the sRGB curve."""
    rng = np.random.default_rng(seed)
    captured = make_splats(300, 2, seed)
    looks = [rng.uniform(0.1, 1.2, (300, 3)).astype(np.float32) for _ in range(2)]
    sh = [captured.sh.copy() for _ in range(2)]
    for each, colors in zip(sh, looks, strict=True):
        each[:, 0] = (colors - 0.5) / SH_C0
    sh[1][:, 1:] *= 0.5
    return replace(captured, sh=sh[0]), replace(captured, sh=sh[1], opacities=0.5 * captured.opacities)


def test_what_has_no_share_keeps_every_bit_and_what_has_all_takes_the_other():
    captured, relit = lit_pair()
    shares = np.tile(np.array([0, 1, 0.5], np.float32), 100)
    found = blended_splats(captured, relit, shares)
    for share, of in ((0, captured), (1, relit)):
        rows = shares == share
        assert found.sh[rows].tobytes() == of.sh[rows].tobytes()
        assert found.opacities[rows].tobytes() == of.opacities[rows].tobytes()
    for name in ("means", "scales", "quats_wxyz"):
        assert getattr(found, name) is getattr(captured, name)


def test_colours_between_are_mixed_in_linear_light():
    captured, relit = lit_pair()
    shares = np.linspace(0.01, 0.99, 300).astype(np.float32)
    found = blended_splats(captured, relit, shares)
    light = [linear_from_srgb(each.colors_diffuse) for each in (captured, relit, found)]
    expected = light[0] + shares[:, None] * (light[1] - light[0])
    np.testing.assert_allclose(light[2], expected, rtol=2e-5)  # float32 coefficients
    rest = captured.sh[:, 1:] + shares[:, None, None] * (relit.sh[:, 1:] - captured.sh[:, 1:])
    np.testing.assert_allclose(found.sh[:, 1:], rest, rtol=1e-5, atol=1e-6)


def test_colours_beyond_black_and_white_are_mixed_too():
    captured, relit = lit_pair()
    dark = replace(captured, sh=captured.sh - 3.0)
    found = blended_splats(dark, relit, np.full(300, 0.5, np.float32)).sh[:, 0]
    assert np.isfinite(found).all()
    low, high = np.minimum(dark.sh[:, 0], relit.sh[:, 0]), np.maximum(dark.sh[:, 0], relit.sh[:, 0])
    assert ((found > low) & (found < high)).all()


def test_vertices_are_mixed_as_they_are_linear():
    rng = np.random.default_rng(1)
    first, second = rng.uniform(0, 2, (2, 9, 3)).astype(np.float32)
    shares = np.array([0, 0, 0, 1, 1, 1, 0.25, 0.25, 0.25], np.float32)
    found = blended(first, second, shares)
    assert found[:3].tobytes() == first[:3].tobytes() and found[3:6].tobytes() == second[3:6].tobytes()
    np.testing.assert_allclose(found[6:], 0.75 * first[6:] + 0.25 * second[6:], rtol=1e-6)


def test_the_rim_is_as_wide_as_points_are_apart():
    points, i, j = lattice()
    for spacing in (1.0, 0.01):
        found = with_rim(points * np.float32(spacing), (i >= 6).astype(np.float32))
        inner = (j > 0) & (j < 11) & (i > 0) & (i < 11)
        assert (found[i >= 6] == 1.0).all() and (found[(i <= 3) & inner] == 0.0).all()
        np.testing.assert_allclose(found[(i == 5) & inner], 2 / NEXT, rtol=1e-6)  # of six, two lie in the part
        assert (found[(i == 4) & inner] == 0.0).all()


def test_the_rim_is_the_mean_of_the_nearest():
    rng = np.random.default_rng(2)
    points, shares = rng.normal(size=(200, 3)), (rng.uniform(size=200) < 0.3).astype(np.float32)
    apart = cdist(points, points)
    np.fill_diagonal(apart, np.inf)
    mean = shares[np.argsort(apart, axis=1)[:, :NEXT]].mean(axis=1)
    np.testing.assert_allclose(with_rim(points, shares), np.where(shares == 1, 1, mean), atol=1e-6)


def test_shares_with_a_rim_of_their_own_stay():
    points, i, _ = lattice()
    shares = (i / 11).astype(np.float32)
    assert with_rim(points, shares) is shares


def scene_of(points, turn=None):
    """A Scene whose vertices are points, turned and scaled from the frame of its splats."""
    matrix = np.eye(4) if turn is None else turn
    vertices = (points @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    faces = np.array([[0, 1, 12]], np.int32)
    normals, colors = np.tile(np.float32([0, 0, 1]), (len(points), 1)), np.full((len(points), 3), 99, np.uint8)
    return Scene([Mesh(vertices, normals, faces, colors)], scene_from_splat=matrix)


def flat_splats():
    """Splats on the lattice."""
    points, i, j = lattice()
    return replace(make_splats(len(points), 0), means=points), i, j


TURN = np.array([[0, -2, 0, 5], [2, 0, 0, -1], [0, 0, 2, 3], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("kind", ["box", "rows"])
def test_vertices_take_the_share_of_their_place_or_of_the_nearest_splats(kind):
    splats, _, _ = flat_splats()
    inside = (splats.means[:, 0] <= 6.2) & (splats.means[:, 1] <= 5)
    given = "box:at=0,0,0,size=12.4,10,1" if kind == "box" else inside
    asked, file = AskedPart.parse([given], []), SplatFile(splats)
    part = PartShares.of(asked, scene_of(splats.means, TURN), file, asked.of_splats(file))
    np.testing.assert_array_equal(part.splats, with_rim(splats.means, inside.astype(np.float32)))
    clear = (part.splats == 0.0) | (part.splats == 1.0)
    assert 0.3 < clear.mean() < 1.0
    if kind == "box":
        np.testing.assert_array_equal(part.vertices, part.splats)
    else:
        deep = with_rim(splats.means, 1 - inside.astype(np.float32)) == 0.0
        assert (part.vertices[deep] == 1.0).all() and (part.vertices[part.splats == 0.0] < 0.35).all()
    assert part.report["splats"] == {"all": 144, "rim": int((~clear).sum()), "part": int(inside.sum())}


def test_what_is_kept_is_the_rest_of_what_takes_the_light():
    splats, i, _ = flat_splats()
    file, scene = SplatFile(splats), scene_of(splats.means)
    only, keep = AskedPart.parse([i < 4], []), AskedPart.parse([], [i < 4])
    first, second = (PartShares.of(each, scene, file, each.of_splats(file)) for each in (only, keep))
    np.testing.assert_array_equal(first.splats + second.splats, 1)
    np.testing.assert_array_equal(first.vertices + second.vertices, 1)
    assert (second.splats[i < 4] == 0).all() and not first.kept and second.kept


def test_several_parts_are_one():
    splats, i, j = flat_splats()
    asked = AskedPart.parse([i < 3, j < 3], [])
    np.testing.assert_array_equal(asked.of_splats(SplatFile(splats)), ((i < 3) | (j < 3)).astype(np.float32))


def test_splats_that_are_not_finite_have_no_rim_and_change_none():
    splats, i, _ = flat_splats()
    means = splats.means.copy()
    means[(i == 5)] = np.nan
    broken, asked = replace(splats, means=means), AskedPart.parse([i >= 6], [])
    part = PartShares.of(asked, scene_of(splats.means), SplatFile(broken), asked.of_splats(SplatFile(broken)))
    assert (part.splats[i == 5] == 0).all() and (part.splats[i >= 6] == 1).all()


def test_empty_parts_are_refused_by_name():
    splats, i, _ = flat_splats()
    with pytest.raises(InputError, match="`keep` sphere:at=99,0,0,radius=1: none of 144 splats lies in it"):
        AskedPart.parse([], ["sphere:at=99,0,0,radius=1"]).of_splats(SplatFile(splats))
    asked = AskedPart.parse(["sphere:at=99,0,0,radius=1"], [])
    with pytest.raises(InputError, match="`only`: none of 144 vertices lies in the part"):
        PartShares.of(asked, scene_of(splats.means), None, None)
    with pytest.raises(InputError, match="give one of them"):
        AskedPart.parse([i < 3], [i > 3])
