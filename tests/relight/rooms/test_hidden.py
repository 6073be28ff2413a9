"""Volumes of a room that nobody saw: sky through them is hidden, light through windows and between surfaces is not."""

from dataclasses import replace

import numpy as np
import pytest

from relight.engine.relighter import Relighter
from relight.rooms import hidden
from relight.transfer.occluder import Frame, Occluder
from relight.transfer.store import Cache, geometry_key
from splat2mesh.base.sphere import texel_directions
from splat2mesh.scene.measured import SKY_HEIGHT, SKY_WIDTH, CapturedSky, Measured
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

N = 24
EYES = [[0.0, 1.2, 0.0], [0.6, 1.4, 0.5], [-0.6, 1.3, -0.5]]


def wall(corner, right, up, hole=lambda u, v: np.zeros_like(u, bool)):
    """A square grid from a corner along two edges, its front to right x up, without faces whose centre is in a hole."""
    corner, right, up = (np.asarray(each, np.float32) for each in (corner, right, up))
    u, v = np.meshgrid(np.linspace(0, 1, N + 1), np.linspace(0, 1, N + 1), indexing="ij")
    vertices = corner + u.reshape(-1, 1) * right + v.reshape(-1, 1) * up
    at = np.arange((N + 1) ** 2).reshape(N + 1, N + 1)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2).reshape(-1, 3)
    middle = np.repeat((np.arange(N) + 0.5) / N, N), np.tile((np.arange(N) + 0.5) / N, N)
    keep = ~np.repeat(hole(*middle), 2)
    normal = np.cross(right, up)
    normals = np.tile(normal / np.linalg.norm(normal), (len(vertices), 1))
    return vertices.astype(np.float32), normals.astype(np.float32), faces[keep]


def scene_of(parts, seen_from="inside"):
    starts = np.cumsum([0, *(len(part[0]) for part in parts)])
    vertices, normals = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    faces = np.concatenate([part[2] + start for part, start in zip(parts, starts, strict=False)]).astype(np.int32)
    colors = np.full((len(vertices), 3), 128, np.uint8)
    return Scene([Mesh(vertices, normals, faces, colors)], capture={"from": seen_from, "eyes": EYES})


def room(cupboard=True, ceiling=True, hole=False):
    """4 x 2.6 x 4, a window in the wall to +z; no wall behind the cupboard at -x, which has no top; a hole above."""

    def window(u, v):
        return (abs(u - 0.5) < 0.15) & (abs(v - 0.5) < 0.2)

    def behind(u, v):
        return (abs(u - 0.5) < 0.2) & (v < 0.55)

    parts = [
        wall((-2, 0, 2), (4, 0, 0), (0, 0, -4)),
        wall((2, 0, 2), (-4, 0, 0), (0, 2.6, 0), window),
        wall((-2, 0, -2), (4, 0, 0), (0, 2.6, 0)),
        wall((-2, 0, 2), (0, 0, -4), (0, 2.6, 0), behind if cupboard else lambda u, v: u < 0),
        wall((2, 0, -2), (0, 0, 4), (0, 2.6, 0)),
    ]
    if ceiling:
        above = [lambda u, v: (abs(u - 0.5) < 0.1) & (abs(v - 0.3) < 0.1)] * hole
        parts.append(wall((-2, 2.6, -2), (4, 0, 0), (0, 0, 4), *above))
    if cupboard:  # its front, and its sides
        parts += [
            wall((-1.3, 0, 1), (0, 0, -2), (0, 1.7, 0)),
            wall((-2, 0, 1), (0.7, 0, 0), (0, 1.7, 0)),
            wall((-1.3, 0, -1), (-0.7, 0, 0), (0, 1.7, 0)),
        ]
    return scene_of(parts)


def caster_of(scene):
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    return occluder, Frame.around(scene.vertices, scene.faces)


def ray(frame, start, end):
    start = frame.unit(np.array([start]))
    return np.hstack([start, frame.unit(np.array([end])) - start]).astype(np.float32)


def test_no_sky_shines_through_an_open_cupboard_and_all_of_it_through_the_window():
    scene = room()
    occluder, frame = caster_of(scene)
    through_cupboard = ray(frame, (-0.9, 2.55, 0), (-2, 0.9, 0))  # from the ceiling, over its front, out at its back
    through_window = ray(frame, (0, 0.1, -1), (0, 1.3, 2.0))
    assert not occluder.occluded(through_cupboard).any() and not occluder.occluded(through_window).any()
    occluder.shut(hidden.hidden_volumes(scene, occluder))
    assert occluder.occluded(through_cupboard).all()
    assert not occluder.occluded(through_window).any()


def test_what_is_seen_through_a_window_is_no_part_of_the_room(monkeypatch):
    """A wall across the street: between it and the window nobody saw the sky, which steep light comes from."""
    yard = scene_of([(part.vertices, part.normals, part.faces) for part in room().chunks] + [street()])
    steep = ray(caster_of(yard)[1], (0, 0.1, 1.0), (0, 1.6, 2.0))
    for outdoors, blocked in ((hidden.OUTDOORS, False), (2.0, True)):
        monkeypatch.setattr(hidden, "OUTDOORS", outdoors)
        occluder, _ = caster_of(yard)
        occluder.shut(hidden.hidden_volumes(yard, occluder))
        assert occluder.occluded(steep).all() == blocked


def street():
    """A wall 6 m before the window of `room`, 8 m high."""
    return wall((6, -2, 8), (-12, 0, 0), (0, 8, 0))


def under_sky(scene, shown):
    """The scene with a sky captured where `shown` (D, 3) -> (D,) says so."""
    bound = np.repeat(shown(texel_directions(SKY_HEIGHT, SKY_WIDTH))[..., None], 3, axis=2).astype(np.float32)
    sky = CapturedSky(0.5 * bound, bound, np.zeros_like(bound))
    return replace(scene, measured=Measured(sky, np.zeros(0, np.float32), np.zeros(len(scene.vertices), np.float32)))


@pytest.mark.parametrize(
    ("shown", "closed"),
    [
        (lambda toward: toward[..., 2] > 0.3, True),
        (lambda toward: toward[..., 0] < 2.0, False),
        (lambda toward: toward[..., 2] < -0.9, False),  # no opening shows it: nothing is known of any
    ],
)
def test_an_opening_that_shows_no_sky_is_a_hole_where_another_shows_some(shown, closed):
    scene = under_sky(room(cupboard=False, hole=True), shown)
    occluder, frame = caster_of(scene)
    through_hole, through_window = ray(frame, (0, 0.1, 0.5), (0, 2.6, -0.8)), ray(frame, (0, 0.1, -1), (0, 1.3, 2.0))
    assert not occluder.occluded(through_hole).any()
    occluder.shut(hidden.hidden_volumes(scene, occluder))
    assert occluder.occluded(through_hole).all() == closed
    assert not occluder.occluded(through_window).any()


def test_without_a_captured_sky_no_opening_is_a_hole():
    scene = room(cupboard=False, hole=True)
    occluder, frame = caster_of(scene)
    occluder.shut(hidden.hidden_volumes(scene, occluder))
    assert not occluder.occluded(ray(frame, (0, 0.1, 0.5), (0, 2.6, -0.8))).any()


def test_volumes_of_another_sky_do_not_serve():
    scene = room()
    skies = [under_sky(scene, lambda toward, least=least: toward[..., 2] > least) for least in (0.0, 0.5)]
    assert len({geometry_key(each) for each in (scene, *skies)}) == 3


def test_between_surfaces_nothing_is_hidden():
    scene = room()
    occluder, frame = caster_of(scene)
    occluder.shut(hidden.hidden_volumes(scene, occluder))
    assert not occluder.occluded(ray(frame, (-0.9, 2.55, 0), (-1.9, 1.0, 0)), 1.0).any()


@pytest.mark.parametrize("scene", [room(ceiling=False), replace(room(), capture={"from": "both", "eyes": EYES})])
def test_open_places_have_none(scene):
    occluder, _ = caster_of(scene)
    assert hidden.hidden_volumes(scene, occluder).shape == (0, 3, 3)


def test_what_was_computed_for_other_standpoints_does_not_serve():
    inside, moved = room(), replace(room(), capture={"from": "inside", "eyes": EYES[:2]})
    outside, other = (replace(room(), capture={"from": "outside", "eyes": eyes}) for eyes in (EYES, EYES[:2]))
    assert geometry_key(inside) == geometry_key(room()) != geometry_key(moved)
    assert geometry_key(outside) == geometry_key(other)


def test_kept_volumes_serve_the_next_run_and_damaged_ones_do_not(tmp_path, monkeypatch):
    scene = room()
    first = precomputed_of(scene, tmp_path)
    through = ray(Frame.around(scene.vertices, scene.faces), (-0.9, 2.55, 0), (-2, 0.9, 0))
    assert first.occluder.occluded(through).all()
    with monkeypatch.context() as patch:
        patch.setattr(hidden, "hidden_volumes", lambda *_: pytest.fail("they were kept"))
        again = precomputed_of(scene, tmp_path)
        assert again.occluder.occluded(through).all()
    Cache(tmp_path, geometry_key(scene)).put("hidden", triangles=np.zeros((2, 3), np.float32))
    assert precomputed_of(scene, tmp_path).occluder.occluded(through).all()


def precomputed_of(scene, folder):
    return Relighter(scene, cache=Cache(folder, geometry_key(scene))).precomputed
