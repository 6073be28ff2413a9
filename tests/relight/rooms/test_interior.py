"""Closed rooms seen from within stay as captured; open ones and objects do not."""

import numpy as np
import pytest

from relight import Environment, Relighter
from relight.engine.appearance import appearance_of
from relight.engine.relighter import Shaded, Shading
from relight.jobs.job import Job
from relight.jobs.results import Results
from relight.jobs.writer import report_of
from relight.request import RelightRequest
from relight.rooms.interior import MOST_CLOSED, closed_part, within
from relight.transfer.bounces import visible_fraction
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

CELLS = 12
INSIDE = {"from": "inside", "eyes": [[0.0, 0.0, 0.0], [0.3, -0.2, 0.1]], "focal_px": 60.0}


def box(opening=lambda center: False, capture=INSIDE):
    """A cube from -1 to 1, its normals inward; faces whose centre is in the opening are left out."""
    u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(-1, 1, CELLS + 1)] * 2))
    first = (np.arange(CELLS)[:, None] * (CELLS + 1) + np.arange(CELLS)).reshape(-1, 1)
    quads = (first + np.array([0, CELLS + 1, CELLS + 2, 0, CELLS + 2, 1])).reshape(-1, 3)
    vertices, normals, faces = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            wall = np.insert(np.stack([u, v], axis=1), axis, side, axis=1)
            faces.append(quads + len(u) * len(vertices))
            vertices.append(wall)
            normals.append(np.tile(-side * np.eye(3)[axis], (len(u), 1)))
    vertices, normals, faces = (np.concatenate(each) for each in (vertices, normals, faces))
    faces = faces[[not opening(vertices[face].mean(axis=0)) for face in faces]]
    colors = np.random.default_rng(0).integers(60, 200, vertices.shape).astype(np.uint8)
    mesh = Mesh(vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32), colors)
    return Scene([mesh], capture=dict(capture))


def window(center):
    """A window of a ninth of a wall."""
    return center[0] > 0.99 and (np.abs(center[1:]) < 0.34).all()


def no_ceiling(center):
    return center[1] > 0.99


def part_of(scene):
    relighter = Relighter(scene)
    return closed_part(scene, relighter.precomputed.occluder, visible_fraction(relighter.transfer))


def results_of(relighter, look, splats):
    """The Results of splats of a scene whose appearance is known."""
    job = Job(RelightRequest(relighter.scene, "sunset", formats=("splat",)))
    vars(job.inputs).update(splats=(splats, []))
    vars(job.known).update(relighter=relighter, appearance=look, mirror=None)
    return Results(job)


def some_splats(count=30):
    rng = np.random.default_rng(1)
    means = rng.uniform(-1, 1, (count, 3)).astype(np.float32)
    quats = np.tile(np.float32([1, 0, 0, 0]), (count, 1))
    sh = rng.normal(0, 0.3, (count, 4, 3)).astype(np.float32)
    return Splats(means, np.full((count, 3), 0.05, np.float32), quats, np.full(count, 0.9, np.float32), sh)


def test_how_much_of_the_sky_reaches_what_is_seen():
    assert part_of(box()) == 0.0
    # A window of 1/54 of the walls: by symmetry of the cube the mean form factor is near its share of the walls.
    assert 0.01 < part_of(box(window)) < 0.03 < MOST_CLOSED
    assert part_of(box(no_ceiling)) is None  # open: about a fifth


@pytest.mark.parametrize("capture", [{}, {**INSIDE, "from": "outside"}, {**INSIDE, "from": "both"}])
def test_only_what_was_captured_inside_a_place_closed_in_is_a_room(capture):
    assert not len(within(box(capture=capture))) and part_of(box(capture=capture)) is None


@pytest.mark.parametrize("opening", [lambda center: False, window])
def test_a_closed_room_stays_as_captured_and_says_so(opening):
    scene, splats = box(opening), some_splats()
    relighter = Relighter(scene)
    with pytest.warns(DataWarning, match=r"closed room, where \d.*`albedo` captured"):
        look = appearance_of("estimated", None, relighter)
    assert look.as_captured and look.capture["left_as_captured"] and not look.capture["separable"]
    dark = np.zeros_like(look.captured)
    np.testing.assert_allclose(look.received(dark, 0.5) * 0.5, look.irradiance)
    relit = results_of(relighter, look, splats).relit.relit(shaded_by("sunset", dark, 3.0))
    np.testing.assert_array_equal(relit.sh, splats.sh)


def test_the_sky_in_its_windows_is_new():
    scene, splats = box(window), some_splats()
    scene.background_splats = np.array([3])
    relighter = Relighter(scene)
    with pytest.warns(DataWarning, match="closed room"):
        look = appearance_of("estimated", None, relighter)
    relit = results_of(relighter, look, splats).relit.relit(shaded_by("sunset", np.zeros_like(look.captured), 3.0))
    changed = (relit.sh != splats.sh).any(axis=(1, 2))
    np.testing.assert_array_equal(np.flatnonzero(changed), [3])


def test_a_room_is_lit_where_that_is_asked_for():
    relighter = Relighter(box(window))
    assert not appearance_of("captured", None, relighter).as_captured
    assert not appearance_of("white", None, relighter).as_captured


def test_a_job_reports_it():
    job = Job(RelightRequest(box(), "noon", albedo="estimated", formats=("npy",), caching="none"))
    with pytest.warns(DataWarning, match="closed room"):
        report = report_of(job, next(iter(job.shaded())))
    assert report["capture"]["left_as_captured"]


def shaded_by(name, radiance, exposure):
    return Shaded(Environment.load(name), Shading(radiance, 0, [], None), exposure)
