"""Up from the floor of a place: used where the evidence is strong, never guessed for an object."""

import numpy as np
import pytest
from ball_splats import solid_ball
from scipy.spatial.transform import Rotation

from splat2mesh.splats.joining import joined
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.splats.splats import Splats
from splat2mesh.views.ground import FLOOR, ground_of, largest_plane
from splat2mesh.views.upright import scene_from_splat, upright

AXES = {"+y": [0, 1, 0], "-y": [0, -1, 0], "+z": [0, 0, 1], "-z": [0, 0, -1], "+x": [1, 0, 0]}


def dots(points, size=0.03):
    """Solid round splats at points."""
    n = len(points)
    return Splats(points, np.full((n, 3), size), np.tile([1, 0, 0, 0], (n, 1)), np.full(n, 0.9), np.zeros((n, 1, 3)))


def sheet(rng, count, low, high):
    """Points all over a box, which is flat where low equals high."""
    return rng.uniform(low, high, (count, 3))


def things(rng, low=-1.5, high=1.5):
    """Boxes and stems that stand on y = 0."""
    found = []
    for _ in range(12):
        x, z = rng.uniform(low, high, 2)
        found.append(sheet(rng, 250, [x, 0.05, z], [x + 0.3, rng.uniform(0.2, 1.0), z + 0.3]))
    return np.concatenate(found)


def garden(surroundings=True, seed=0):
    """A lawn with things on it, y up, and far trees all around."""
    rng = np.random.default_rng(seed)
    lawn = sheet(rng, 9000, [-3, 0, -3], [3, 0, 3]) + rng.normal(0, 0.01, (9000, 3))
    parts = [dots(lawn), dots(things(rng))]
    if surroundings:
        angle = rng.uniform(0, 2 * np.pi, 900)
        far = np.stack([np.cos(angle), rng.uniform(0, 0.4, 900), np.sin(angle)], axis=1) * rng.uniform(20, 40, (900, 1))
        parts.append(dots(far, 1.0))
    return joined(parts)


def room(ceiling=True, seed=0):
    """Four walls, a floor at y = 0, things on it, and a ceiling."""
    rng = np.random.default_rng(seed)
    x, y, z = 3.0, 2.4, 2.5
    floors = [sheet(rng, 6000, [-x, h, -z], [x, h, z]) for h in ((0, y) if ceiling else (0,))]
    walls = [sheet(rng, 2500, [-x, 0, side], [x, y, side]) for side in (-z, z)]
    walls += [sheet(rng, 2500, [side, 0, -z], [side, y, z]) for side in (-x, x)]
    return dots(np.concatenate([*floors, *walls, things(rng)]))


def turned(splats, up, lean_deg=0.0):
    """Splats whose +y comes to lie along an axis, after leaning about x."""
    turn = Rotation.align_vectors([AXES[up]], [[0, 1, 0]])[0] * Rotation.from_euler("x", lean_deg, degrees=True)
    return placed(splats, similarity(rotation=turn.as_matrix()))


@pytest.mark.parametrize("up", ["+y", "-y", "+z"])
def test_a_garden_with_surroundings_shows_its_up(up):
    found = ground_of(turned(garden(), up))
    np.testing.assert_array_equal(found.up, AXES[up])
    assert found.reason.endswith(f"degrees from {up}") and found.reason.startswith("the floor")


@pytest.mark.parametrize("up", ["-z", "+x"])
def test_what_may_be_a_facade_is_no_floor(up):
    assert ground_of(turned(garden(), up)).up is None


def test_a_table_top_without_surroundings_is_never_turned_over():
    np.testing.assert_array_equal(ground_of(garden(surroundings=False)).up, AXES["-y"])
    np.testing.assert_array_equal(ground_of(turned(garden(surroundings=False), "-y")).up, AXES["-y"])
    assert ground_of(turned(garden(surroundings=False), "+z")).up is None


@pytest.mark.parametrize("up", ["+y", "-y"])
def test_between_floor_and_ceiling_the_usual_frame_decides(up):
    found = ground_of(turned(room(), up))
    np.testing.assert_array_equal(found.up, AXES["-y"])
    assert ground_of(turned(room(), "+z")).up is None


@pytest.mark.parametrize("lean_deg", [3.0, 12.0, 25.0])
def test_a_leaning_capture_is_levelled(lean_deg):
    for place, up in ((garden(), "+y"), (garden(), "-y"), (room(), "-y")):
        splats = turned(place, up, lean_deg)
        found = ground_of(splats).up
        expected = turned_axis(up, lean_deg)
        # Half a cell over the width of the floor is half a degree.
        assert np.degrees(np.arccos(min(1.0, found @ expected))) < 0.7
        matrix = scene_from_splat("auto", floor_up=found)
        np.testing.assert_allclose(matrix[:3, :3] @ found, [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)


def turned_axis(up, lean_deg):
    turn = Rotation.align_vectors([AXES[up]], [[0, 1, 0]])[0] * Rotation.from_euler("x", lean_deg, degrees=True)
    return turn.apply([0, 1, 0])


def test_what_leans_too_far_for_an_object_stays_as_it_is():
    found = ground_of(turned(garden(surroundings=False), "-y", 25.0))
    assert found.up is None and found.reason == "the largest plane leans by 25 degrees"


def test_objects_have_no_floor():
    assert ground_of(solid_ball()).up is None
    rng = np.random.default_rng(0)
    cloud = dots(rng.normal(size=(5000, 3)))
    assert ground_of(cloud).up is None
    assert ground_of(dots(rng.normal(size=(20, 3)))).up is None and largest_plane(dots(np.zeros((100, 3)))) is None


def test_things_on_both_sides_show_nothing():
    both = garden()
    mirrored = placed(things_alone(), similarity(rotation=np.diag([1.0, -1.0, -1.0])))
    found = ground_of(joined([both, mirrored]))
    assert found.up is None and found.reason == "things stand on both sides of the largest plane"


def things_alone():
    return dots(things(np.random.default_rng(0)))


def test_the_order_of_the_splats_changes_nothing():
    splats = garden()
    order = np.random.default_rng(1).permutation(len(splats))
    first, second = largest_plane(splats), largest_plane(splats.take(order))
    np.testing.assert_array_equal(first.normal, second.normal)
    assert (first.cover, first.lead, first.sided, first.opposite) == (
        second.cover,
        second.lead,
        second.sided,
        second.opposite,
    )


def test_auto_asks_cameras_then_the_floor_then_assumes():
    matrix, reason = upright("auto", [], garden())
    np.testing.assert_array_equal(matrix, np.eye(4))
    assert reason == "the floor, 0.0 degrees from +y" or reason.startswith("the floor, 0.")
    assert not np.signbit(upright("auto", [], turned(garden(), "-y"))[0][matrix == 0]).any()
    matrix, reason = upright("auto", [], solid_ball())
    np.testing.assert_array_equal(matrix, scene_from_splat("-y"))
    assert reason.startswith("assumed -y, since no plane stands out as a floor")
    matrix, reason = upright("+z", [], garden())
    np.testing.assert_array_equal(matrix, scene_from_splat("+z"))
    assert reason == "asked for"


def bare(splats):
    """A garden whose lawn fills less of its outline, as between towers: most of what is seen from above is roofs."""
    rng = np.random.default_rng(3)
    tower = sheet(rng, 5000, [-5.5, 0.0, -3.0], [-3.1, 6.0, 3.0])
    return joined([splats, dots(tower)])


@pytest.mark.parametrize("lean_deg", [0.0, 4.0])
def test_a_place_whose_largest_plane_faces_along_z_stands_on_it(lean_deg):
    for place in (garden(surroundings=False), room()):
        lying = turned(place, "+z", lean_deg)
        found = ground_of(lying)
        assert found.up is None
        assert np.degrees(np.arccos(min(1.0, found.of_place @ turned_axis("+z", lean_deg)))) < 0.7
        matrix, reason = upright("auto", [], lying, lambda: True)
        np.testing.assert_allclose(matrix[:3, :3] @ found.of_place, [0, 1, 0], atol=1e-12)
        assert reason.startswith("the floor, ") and reason.endswith("from +z, since the capture looked from within")
        matrix, reason = upright("auto", [], lying)
        np.testing.assert_array_equal(matrix, scene_from_splat("-y"))
        assert reason.startswith("assumed -y")


@pytest.mark.parametrize("up", ["+y", "-y", "-z", "+x"])
def test_nothing_is_asked_for_other_planes_and_where_the_floor_is_clear(up):
    def asked():
        raise AssertionError

    for place in (garden(), room()) if up[1] == "y" else (garden(),):
        lying = turned(place, up)
        assert ground_of(lying).of_place is None
        assert upright("auto", [], lying, asked)[0].shape == (4, 4)


def test_between_towers_less_floor_will_do_for_a_place():
    lying = turned(bare(garden(surroundings=False)), "+z")
    floor = largest_plane(lying)
    assert FLOOR.cover_in_place < floor.cover
    np.testing.assert_allclose(ground_of(lying).of_place, AXES["+z"], atol=0.02)
    assert ground_of(solid_ball()).of_place is None


def test_nothing_is_searched_where_cameras_decide(monkeypatch):
    from splat2mesh.render.view import View
    from splat2mesh.views import upright as module

    monkeypatch.setattr(module, "ground_of", None)
    views = [View.look_at([0, 0, -3], [0, 0, 0], [0, 1, 0], 50.0, 16)]
    matrix, reason = upright("auto", views, garden())
    np.testing.assert_allclose(matrix, np.eye(4), atol=1e-12)
    assert reason == "the cameras"


def test_thresholds_are_between_what_was_measured():
    """Margins of the constants: a place and an object of each kind, as largest_plane sees them."""
    floor, closed, ball = largest_plane(garden()), largest_plane(room()), largest_plane(solid_ball())
    assert floor.cover > FLOOR.least_cover > ball.cover or floor.lead > FLOOR.least_lead > ball.lead
    assert closed.opposite > FLOOR.ceiling > floor.opposite
    assert floor.in_place and not closed.in_place
