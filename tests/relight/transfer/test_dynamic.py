import numpy as np
import pytest
from moving_meshes import ball, grid, mesh

from relight.animation.animation import face_normals
from relight.light.environment import Suns
from relight.sh.normals import unit_normals
from relight.transfer import lobes, sampling
from relight.transfer.analytic import analytic
from relight.transfer.dynamic import Anchor, DynamicTransfer
from relight.transfer.dynamic_suns import DynamicSunlight
from relight.transfer.filtering import average, steps_for
from relight.transfer.neighbors import Neighbors
from relight.transfer.occluder import Occluder
from relight.transfer.reach import Box, NodeRays, blocked
from relight.transfer.rings import Rings
from relight.transfer.sunlight import sunlight
from relight.transfer.visibility import raytraced_scene
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

BANDS, RAYS = 4, 24


def table_scene():
    """A table (chunks 0 and 3, in two separate halves of height) with a ball (1) and a smaller one (2) over it."""
    return Scene(
        [
            mesh(*grid(26)),
            mesh(*ball(0.3, [-0.4, 0.35, 0.1])),
            mesh(*ball(0.2, [0.5, 0.3, 0.2], 9)),
            mesh(grid(6)[0] * 0.2 + [0.0, 0.9, -0.5], grid(6)[1]),
        ]
    )


def posed(scene, changes):
    chunks = [
        Mesh(*changes.get(number, (chunk.vertices, chunk.normals)), chunk.faces, chunk.colors_srgb)
        for number, chunk in enumerate(scene.chunks)
    ]
    return Scene(chunks)


def bent(chunk, amount):
    """A chunk sheared and squeezed, so that its normals change too."""
    vertices = chunk.vertices.copy()
    vertices[:, 0] += amount * (vertices[:, 1] - 0.2) ** 2 + 0.1 * amount
    vertices[:, 1] = 0.35 + (vertices[:, 1] - 0.35) * (1.0 + 0.3 * amount)
    return vertices, face_normals(vertices, chunk.faces)


@pytest.fixture(scope="module")
def scene():
    return table_scene()


@pytest.fixture(scope="module")
def suns():
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(21, 3))
    return Suns(directions / np.linalg.norm(directions, axis=1, keepdims=True), rng.random((21, 3)))


def test_before_anything_moves_it_is_the_transfer_of_the_scene(scene, suns):
    occluder = Occluder(scene.vertices, scene.normals, scene.faces)
    expected = raytraced_scene(occluder, BANDS, RAYS, 7)
    one = DynamicTransfer(scene, [], BANDS, RAYS, 7)
    np.testing.assert_array_equal(one.transfer, expected)
    # No body touches another here, so that averaging within each of them leaves nobody out. A ray through an edge
    # may slip between two faces in one tree of boxes and not in another: at most a few in a thousand vertices.
    several = DynamicTransfer(scene, [1, 2], BANDS, RAYS, 7)
    assert (several.transfer != expected).any(axis=1).mean() < 5e-3
    light = DynamicSunlight(several, suns).radiance
    assert (light != sunlight(occluder, slice(None), suns)).any(axis=1).mean() < 5e-3


def test_after_motion_it_is_to_the_bit_that_of_the_moved_scene(scene, suns):
    live = DynamicTransfer(scene, [1, 2], BANDS, RAYS, 3)
    light = DynamicSunlight(live, suns)
    previous = live.transfer.copy()
    steps = [
        {1: bent(scene.chunks[1], 0.2)},
        {2: (scene.chunks[2].vertices + np.float32([-0.3, 0.1, 0.0]), scene.chunks[2].normals)},
        {1: bent(scene.chunks[1], 0.5), 2: (scene.chunks[2].vertices + np.float32(0.05), scene.chunks[2].normals)},
        {1: (scene.chunks[1].vertices, scene.chunks[1].normals)},
    ]
    state = {}
    for changes in steps:
        state |= changes
        rows = live.update_all(changes)
        sun_rows = light.update()
        moved = posed(scene, state)
        fresh = DynamicTransfer(moved, [1, 2], BANDS, RAYS, 3, anchor=live.anchor)
        np.testing.assert_array_equal(live.transfer, fresh.transfer)
        fresh_light = DynamicSunlight(fresh, suns)
        np.testing.assert_array_equal(light.radiance, fresh_light.radiance)
        others = np.setdiff1d(np.arange(len(live.transfer)), rows)
        np.testing.assert_array_equal(live.transfer[others], previous[others])
        assert 0 < len(others) < len(previous) and 0 < len(sun_rows) < len(previous)
        assert (live.transfer[rows] != previous[rows]).any()
        previous = live.transfer.copy()


def test_the_moved_scene_traced_by_other_code_gives_the_same(scene):
    """Twin from the parts of the renderer that stands still: one Embree scene of everything, its own neighbours."""
    live = DynamicTransfer(scene, [1, 2], BANDS, RAYS, 0)
    # The ball stays within the bounds of the table: the frame of the moved scene is the same.
    change = {2: (scene.chunks[2].vertices + np.float32([-0.2, 0.05, 0.1]), scene.chunks[2].normals)}
    live.update_all(change)
    moved = posed(scene, change)
    occluder = Occluder(moved.vertices, moved.normals, moved.faces)
    neighbors = Neighbors(occluder.origins, occluder.normals, occluder.faces)
    rows = neighbors.vertices
    origins, normals = occluder.origins[rows], occluder.normals[rows]
    offsets = sampling.ranked_offsets(np.arange(len(moved.vertices)), 0)[live.ranks[rows]]
    rays = np.zeros((len(rows), RAYS, 6), np.float32)
    sampling.shoot_at(origins, normals, sampling.fibonacci_azimuths(RAYS), offsets, rays)
    model, rest = np.zeros((len(rows), 4), np.float32), np.zeros((len(moved.vertices), BANDS**2), np.float32)
    summed = np.zeros((len(rows), BANDS**2), np.float32)
    sampling.gather(rays, occluder.occluded(rays), normals, model, summed)
    rest[rows] = summed
    average(neighbors, normals, model, rest, RAYS, steps_for(RAYS, BANDS))
    transfer = analytic(normals, BANDS)
    lobes.add_model(normals, model, rest[rows], transfer)
    transfer = transfer[neighbors.node]
    # Nodes stand in another order along the curve, so that sums over rings round otherwise; see also above for rays.
    off = np.abs(transfer - live.transfer).max(axis=1)
    assert np.quantile(off, 0.995) < 1e-6 and off.max() < 0.05


def test_only_what_a_body_can_reach_is_computed_again(scene):
    """A ball below the table moves: the flat table above it, whose normals point up, must not be touched."""
    below = Scene([scene.chunks[0], mesh(*ball(0.2, [0.0, -0.6, 0.0])), scene.chunks[1]])
    live = DynamicTransfer(below, [1, 2], BANDS, RAYS)
    chunk = below.chunks[1]
    rows = live.update(1, chunk.vertices + np.float32([0.1, 0, 0]), chunk.normals)
    table = len(below.chunks[0].vertices)
    own = np.arange(table, table + len(chunk.vertices))
    np.testing.assert_array_equal(rows[rows < table], [])
    assert np.isin(own, rows).all()
    assert len(live.update_all({})) == 0
    # What moves back and forth between two looks leaves what others see as it was.
    transfer = live.transfer.copy()
    live.update(1, chunk.vertices, chunk.normals)
    live.update(1, chunk.vertices + np.float32([0.1, 0, 0]), chunk.normals)
    np.testing.assert_array_equal(live.transfer, transfer)


@pytest.mark.parametrize("seed", range(4))
def test_rays_not_handed_on_meet_nothing(seed):
    """Against all rays: boxes of any shape near, far, around and behind the vertices."""
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(400, 3)).astype(np.float32) * np.float32(0.4)
    normals = unit_normals(rng.normal(size=(400, 3)))
    normals[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    rays = NodeRays.over_hemispheres(
        origins, normals, sampling.fibonacci_azimuths(50), rng.random((400, 2)).astype(np.float32)
    )
    center, size = rng.normal(size=3) * 0.5, 10.0 ** rng.uniform(-2.5, -0.3, 3)
    corners = (center + size * rng.uniform(-1, 1, (60, 3))).astype(np.float32)
    box = Box.around(corners)
    all_rays = np.zeros((400, 50, 6), np.float32)
    sampling.shoot_at(*rays[:4], all_rays)
    # The slabs of the points' own box, in float64: without the margin.
    start, step = all_rays[..., :3].astype(np.float64), all_rays[..., 3:].astype(np.float64)
    with np.errstate(divide="ignore"):
        ends = np.sort([(corners.min(axis=0) - start) / step, (corners.max(axis=0) - start) / step], axis=0)
    meets = (ends[0].max(axis=-1) <= ends[1].min(axis=-1)) & (ends[1].min(axis=-1) >= 0)
    handed = []

    def occluded(some):
        handed.append(some.copy())
        return np.ones(len(some), bool)

    none = np.zeros((400, 7), np.uint8)
    bits = np.unpackbits(blocked(rays, box, occluded, none), axis=1, count=50).view(bool)
    assert meets.any() and not (meets & ~bits).any()
    assert bits.sum() <= meets.sum() + 60  # only rays along a face of the box, within the margin
    handed = np.concatenate(handed)
    np.testing.assert_array_equal(handed, all_rays[bits])  # the same rays to the bit
    hidden = np.packbits(rng.random((400, 50)) < 0.5, axis=1)
    again = blocked(rays, box, lambda some: np.ones(len(some), bool), hidden)
    expected = bits & ~np.unpackbits(hidden, axis=1, count=50).view(bool)
    np.testing.assert_array_equal(np.unpackbits(again, axis=1, count=50).view(bool), expected)


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_averaging_around_changes_equals_averaging_everything(steps):
    vertices, faces = ball(1.0, [0, 0, 0], 30)
    normals = unit_normals(face_normals(np.asarray(vertices, np.float32), faces))
    rings = Rings(vertices.astype(np.float32), normals, faces)
    rng = np.random.default_rng(6)
    count = len(rings.vertices)
    own = normals[rings.vertices]
    model, rest = rng.random((count, 4)).astype(np.float32), rng.normal(size=(count, 9)).astype(np.float32) * 0.1

    def everything():
        nodes, *averaged = rings.averaged(own, (model, rest), 16, steps, np.ones(count, bool))
        np.testing.assert_array_equal(nodes, np.arange(count))
        return averaged

    before = everything()
    changed = np.zeros(count, bool)
    changed[rng.integers(0, count, 3)] = True
    model[changed] *= 0.5
    rest[changed] += 0.1
    own[changed] = unit_normals(own[changed] + 0.2)
    rings.bend(own)
    after = everything()
    nodes, *part = rings.averaged(own, (model, rest), 16, steps, changed)
    assert len(nodes) < count / 3
    rest_of_them = np.setdiff1d(np.arange(count), nodes)
    for whole, old, some in zip(after, before, part, strict=True):
        np.testing.assert_array_equal(some, whole[nodes])
        np.testing.assert_array_equal(old[rest_of_them], whole[rest_of_them])


def test_rings_have_the_weights_of_neighbors():
    vertices, faces = ball(1.0, [0, 0, 0])
    rng = np.random.default_rng(7)
    vertices = vertices.astype(np.float32)
    normals = unit_normals(rng.normal(size=vertices.shape) + 2 * vertices)
    plain, rings = Neighbors(vertices, normals, faces), Rings(vertices, normals, faces)
    np.testing.assert_array_equal(plain.vertices, rings.vertices)
    kept = rings.weights > 0
    assert 0 < kept.sum() < len(kept)
    np.testing.assert_array_equal(plain.columns, rings.columns[kept])
    np.testing.assert_array_equal(plain.weights, rings.weights[kept])
    # In another order of the nodes the rows hold the same pairs.
    turned = Rings(vertices, normals, faces, rng.permutation(len(vertices)))

    def pairs(rows):
        first = np.repeat(rows.vertices, np.diff(rows.starts))
        return sorted(zip(first.tolist(), rows.vertices[rows.columns].tolist(), rows.weights.tolist(), strict=True))

    assert pairs(turned) == pairs(rings)
    np.testing.assert_array_equal(turned.vertices[turned.node], rings.vertices[rings.node])
    for row in range(len(turned.vertices)):
        assert (np.diff(turned.columns[turned.starts[row] : turned.starts[row + 1]]) > 0).all()


def test_a_seam_that_tears_is_no_longer_one_vertex(scene):
    live = DynamicTransfer(scene, [1], BANDS, RAYS)
    chunk = scene.chunks[1]
    vertices = chunk.vertices.copy()
    seam = np.flatnonzero((vertices == vertices[30]).all(axis=1))
    others = np.arange(len(vertices)) > len(vertices) // 2
    vertices[others] += np.float32([0.0, 0.02, 0.0])
    live.update(1, vertices, chunk.normals)
    fresh = DynamicTransfer(posed(scene, {1: (vertices, chunk.normals)}), [1], BANDS, RAYS, 0, live.anchor)
    assert len(seam) >= 1 and len(live.bodies[1].nodes) > len(DynamicTransfer(scene, [1], 2, 4).bodies[1].nodes)
    np.testing.assert_array_equal(live.transfer, fresh.transfer)


def test_a_scene_of_bodies_alone_has_nothing_static(scene):
    live = DynamicTransfer(scene, [[0, 3], 1, 2], BANDS, RAYS)
    still = DynamicTransfer(scene, [1, 2], BANDS, RAYS)
    # Which body counts as static decides in what order rays are tested, not what they meet.
    np.testing.assert_array_equal(live.transfer, still.transfer)
    move = {2: (scene.chunks[2].vertices + np.float32([0, 0.05, 0]), scene.chunks[2].normals)}
    live.update_all(move)
    still.update_all(move)
    np.testing.assert_array_equal(live.transfer, still.transfer)


def test_what_cannot_move_is_refused_and_changes_nothing(scene):
    live = DynamicTransfer(scene, [1, 2], 2, 4)
    chunk, before = scene.chunks[1], live.transfer.copy()
    bad = chunk.vertices.copy()
    bad[3, 1] = np.nan
    for call, message in (
        (lambda: live.update(0, scene.chunks[0].vertices, scene.chunks[0].normals), "chunk 0 was not named.* are 1, 2"),
        (lambda: live.update(9, chunk.vertices, chunk.normals), "chunk 9"),
        (lambda: live.update(1, chunk.vertices[:-1], chunk.normals), "vertices of chunk 1 must have shape"),
        (lambda: live.update(1, chunk.vertices, chunk.normals[:5]), "normals of chunk 1 must have shape"),
        (
            lambda: live.update_all({2: (scene.chunks[2].vertices, scene.chunks[2].normals), 1: (bad, chunk.normals)}),
            "1 of",
        ),
        (lambda: live.update(1, chunk.vertices + np.float32(1e3), chunk.normals), "16 diagonals off"),
        (lambda: DynamicTransfer(scene, [4], 2, 4), "from 0 to 3"),
        (lambda: DynamicTransfer(scene, [1, [2, 1]], 2, 4), "one body only"),
        (lambda: DynamicTransfer(scene, [1.5], 2, 4), "from 0 to 3"),
        (lambda: DynamicTransfer(scene, [1], 11, 4), "bands"),
        (lambda: DynamicTransfer(scene, [1], 2, 0), "rays"),
        (lambda: DynamicTransfer(scene, [1], 2, 4, anchor=Anchor(ranks=np.arange(5))), "a rank for each"),
    ):
        with pytest.raises(InputError, match=message):
            call()
    np.testing.assert_array_equal(live.transfer, before)
