"""Solids of which places are built: areas, volumes and directions by closed forms."""

import numpy as np
import pytest

from scenes.albedo import DARKEST, LIGHTEST, checker, patches, random_colors, stripes
from scenes.places import cards
from scenes.places.courtyard import arch
from scenes.places.solids import block, ground, joined, limb, moved, panel, slab
from scenes.places.walls import walls


def areas(solid):
    """(F, 3) areas of faces as vectors along their fronts."""
    points, faces = solid
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a) / 2


def volume(solid):
    points, faces = solid
    a, b, c = (points[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_a_panel_has_the_area_of_its_sides_less_its_holes_and_faces_along_their_product():
    whole = panel(np.array([1.0, 2.0, 3.0]), (4.0, 0, 0), (0, 0, 2.0), 0.3)
    np.testing.assert_allclose(areas(whole).sum(axis=0), [0, -8, 0], atol=1e-12)
    cut = panel(np.zeros(3), (4.0, 0, 0), (0, 0, 2.0), 0.3, [((1.0, 0.5), (2.0, 1.5))])
    np.testing.assert_allclose(areas(cut).sum(axis=0), [0, -7, 0], atol=1e-12)
    points, faces = cut
    middles = points[faces].mean(axis=1)
    assert not ((middles[:, 0] > 1) & (middles[:, 0] < 2) & (middles[:, 2] > 0.5) & (middles[:, 2] < 1.5)).any()
    larger = panel(np.zeros(3), (4.0, 0, 0), (0, 0, 2.0), 9.0, overlap=0.5)
    np.testing.assert_allclose(areas(larger).sum(axis=0), [0, -15, 0], atol=1e-12)


def test_a_closed_solid_has_no_area_on_the_whole_and_keeps_its_volume_wherever_it_stands():
    box = slab((0, 0, 0), (1, 2, 3), 0.4, bevel=1e-6)
    assert volume(box) == pytest.approx(6.0, rel=1e-4)
    turned = moved(box, (5.0, -2.0, 1.0), turn_deg=33.0, tilt_deg=-70.0)
    assert volume(turned) == pytest.approx(volume(box), rel=1e-9)
    for solid in (box, turned, limb([[0, 0, 0], [0, 3, 0]], [0.5, 0.5], 0.2)):
        np.testing.assert_allclose(areas(solid).sum(axis=0), 0, atol=1e-9)
    both = joined([box, turned])
    assert volume(both) == pytest.approx(2 * volume(box)) and both[1].max() == len(both[0]) - 1


def test_a_block_is_its_sides_seen_from_outside():
    whole = block((0, 1, 2), (1, 3, 5), 0.4)
    assert volume(whole) == pytest.approx(6.0, rel=1e-9)
    np.testing.assert_allclose(areas(whole).sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(areas(block((0, 1, 2), (1, 3, 5), 0.4, "Xy")).sum(axis=0), [6, -3, 0], atol=1e-12)


def test_an_arch_leaves_out_its_opening():
    front, back, soffit = arch(2.0, 1.5, 3.0, 0.2, 0.3, 0.02)
    left = 2.0 * 1.5 - np.pi * 0.8**2 / 2  # a polygon of edges 0.02 in the half disc misses less than 1e-3
    np.testing.assert_allclose(areas(front).sum(axis=0), [0, 0, left], atol=1e-3)
    np.testing.assert_allclose(areas(back).sum(axis=0), [0, 0, -left], atol=1e-3)
    np.testing.assert_allclose(areas(soffit).sum(axis=0), [0, -2.0 * 0.3, 0], atol=1e-9)  # closed above by a roof


def test_a_limb_is_a_prism_about_its_path():
    sides = round(2 * np.pi * 0.5 / 0.05)
    tube = limb([[0, 0, 0], [0, 3, 0]], [0.5, 0.5], 0.05)
    polygon = sides / 2 * 0.25 * np.sin(2 * np.pi / sides)
    assert volume(tube) == pytest.approx(3 * polygon, rel=1e-9)


def test_ground_lies_at_its_height_and_looks_up():
    land = ground(20.0, 0.5, lambda flat: 0.1 * flat[:, 0])
    points, _ = land
    np.testing.assert_allclose(points[:, 1], 0.1 * points[:, 0], atol=1e-12)
    assert np.linalg.norm(points[:, [0, 2]], axis=1).max() == pytest.approx(20.0)
    assert (areas(land)[:, 1] > 0).all()


def test_walls_look_inwards_and_windows_are_left_out():
    low, high = (0.5, 1.0), (1.5, 2.0)
    solids, openings = walls((2.0, 3.0), 2.5, 0.25, [("+x", low, high)])
    inward = {"-x": (1, 0, 0), "+x": (-1, 0, 0), "-z": (0, 0, 1), "+z": (0, 0, -1)}
    size = {"-x": 6 * 2.5, "+x": 6 * 2.5 - 1.0, "-z": 4 * 2.5, "+z": 4 * 2.5}
    for name, direction in inward.items():
        np.testing.assert_allclose(areas(solids[name]).sum(axis=0), size[name] * np.array(direction), atol=1e-9)
    np.testing.assert_allclose(areas(solids["floor"]).sum(axis=0), [0, 24, 0], atol=1e-9)
    np.testing.assert_allclose(areas(solids["ceiling"]).sum(axis=0), [0, -24, 0], atol=1e-9)
    (opening,) = openings
    np.testing.assert_allclose(np.cross(opening[1], opening[2]), [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(opening[0], [2.0, 1.0, -2.5], atol=1e-12)


def test_patterns_repeat_and_use_no_other_colours():
    rng = np.random.default_rng(0)
    points, pair = rng.uniform(-3, 3, (500, 3)), np.array([[0.1, 0.2, 0.3], [0.6, 0.5, 0.4]])
    np.testing.assert_array_equal(
        stripes(points, pair, (0, 2, 0), 0.5), stripes(points + np.array([1, 0.5, 1]), pair, (0, 1, 0), 0.5)
    )
    turned = stripes(points + np.array([0, 0.25, 0]), pair, (0, 1, 0), 0.5)
    np.testing.assert_array_equal(
        turned, pair[::-1][(stripes(points, pair, (0, 1, 0), 0.5) == pair[1]).all(axis=1) * 1]
    )
    shown = checker(points, pair, 0.5)
    np.testing.assert_array_equal(shown, checker(points + np.array([0.5, 0.5, 0]), pair, 0.5))
    assert (np.abs(shown - checker(points + np.array([0.5, 0, 0]), pair, 0.5)).max(axis=1) > 0).all()
    colors = random_colors(rng, 40)
    assert colors.min() >= DARKEST and colors.max() <= LIGHTEST
    mosaic = patches(points, colors, rng)
    assert {tuple(row) for row in mosaic} <= {tuple(row) for row in colors}


def test_cards_stand_on_their_feet_and_boxes_face_outwards():
    rng = np.random.default_rng(1)
    feet = rng.uniform(-1, 1, (50, 3))
    grass = cards.blades(feet, 0.3, 0.01, rng, lean=0.0)
    np.testing.assert_allclose(grass[:, :2].mean(axis=1), feet, atol=1e-12)
    np.testing.assert_allclose(grass[:, 2:].mean(axis=1)[:, [0, 2]], feet[:, [0, 2]], atol=1e-12)
    assert (grass[:, 2:, 1].mean(axis=1) > feet[:, 1]).all()
    points, outward = cards.on_box((0, 0, 0), (2, 1, 3), 400, rng, depth=0.0)
    towards = np.where(outward > 0, points - [2, 1, 3], points)
    np.testing.assert_allclose(np.abs(towards[outward != 0]), 0, atol=1e-12)
    out, normal = cards.in_ellipsoid((0, 0, 0), np.array([1.0, 2.0, 3.0]), 200, rng, shell=1.0)
    np.testing.assert_allclose(((out / [1, 2, 3]) ** 2).sum(axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(normal, out / np.array([1.0, 4.0, 9.0])), 0, atol=1e-12)
