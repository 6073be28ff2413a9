"""Objects over a floor that mirrors in the splats: they stand on it, it shows images of them, and their shadows."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from mirrored_rooms import EYES, floor, room, scene_of, splats_of, walls

from relight.insert.polished import floor_under, images_of
from relight.insert.shadowed import shadowed
from relight.jobs.job import Job
from relight.options import LightingOptions
from relight.output.inserted_picture import PictureAsked, with_objects
from relight.request import RelightRequest
from relight.splats.floor_mirror import floor_mirror
from splat2mesh.base.errors import DataWarning
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import write_splats
from splat2mesh.splats.splats import SH_C0

WHERE = np.array([-0.6, -0.5])
"""x and z of the box, far from the floor that the mesh has."""


@pytest.fixture(scope="module")
def put(tmp_path_factory):
    """A Job of a room with a mirror world and a box on its floor, the Shaded, and the splats as captured."""
    path = tmp_path_factory.mktemp("put")
    _, splats = room()
    inwards = [(points, -normals, colors, faces[:, ::-1]) for points, normals, colors, faces in walls()]
    scene = scene_of([*inwards, floor(True)])
    write_splats(path / "room.ply", splats, "ply")
    Scene(scene.chunks, capture=scene.capture, source=describe(path / "room.ply")).save(path / "room")
    trimesh.creation.box((0.3, 0.6, 0.3)).export(path / "box.obj")
    box = f"{path / 'box.obj'} at={WHERE[0]},.8,{WHERE[1]} on=floor albedo=.8"
    fast = LightingOptions("raytraced", bands=3, rays=32, captured=0.1, placed=["0.6,2.0,0.4"])
    job = Job(RelightRequest(path / "room", "captured", fast, albedo="captured", formats=("splat",), inserted=[box]))
    with pytest.warns(DataWarning, match="lit evenly from all around"):
        return job, next(job.shaded()), splats


def test_an_object_stands_on_the_floor_that_closes_the_hole(put):
    job, shaded, _ = put
    assert shaded.inserted.standing.vertices[:, 1].min() == pytest.approx(0.0, abs=0.01)
    behind = WHERE - [0.36, 0.27]  # as the lamp sees it
    near = np.linalg.norm(job.known.scene.vertices[:, [0, 2]] - behind, axis=1) < 0.1
    level = np.abs(job.known.scene.vertices[:, 1]) < 0.01
    assert (near & level).any() and shaded.inserted.ratio[near & level].mean() < 0.5


def test_reflections_take_its_shadow_on_the_floor_and_nothing_else_of_it(put):
    job, shaded, splats = put
    polished = floor_under(job.known.mirror, shaded.inserted, shaded.exposure)
    after = shadowed(shaded.inserted, splats, polished)
    change = np.abs(after.sh[:, 0] - splats.sh[:, 0]).max(axis=1)
    below = splats.means[:, 1] < -job.known.mirror.margin
    apart = np.linalg.norm(splats.means[:, [0, 2]] - WHERE, axis=1)
    assert change[below & (apart < 1.5)].max() > 0.02  # the floor's own part, and the foot of what stands near
    alone = shadowed(shaded.inserted, splats, polished._replace(own=np.zeros(3)))
    assert (after.sh[below, 0] - splats.sh[below, 0]).mean() < (alone.sh[below, 0] - splats.sh[below, 0]).mean()


def test_the_floor_near_an_object_has_its_light(put):
    job, shaded, _ = put
    light = replace(shaded.inserted, received=2.0 * shaded.inserted.received)
    one, two = (floor_under(job.known.mirror, each, 0.5) for each in (shaded.inserted, light))
    np.testing.assert_allclose(two.own, 2.0 * one.own)
    unknown = SimpleNamespace(
        inserts=SimpleNamespace(relighter=job.known.relighter, look=SimpleNamespace(irradiance=None))
    )
    assert floor_under(job.known.mirror, unknown, 1.0) is job.known.mirror


def test_images_of_splats_lie_below_and_are_dimmer():
    scene, splats = room()
    mirror = floor_mirror(splats, scene)
    points = np.array([[0.3, 0.5, 0.2], [0.3, 1.0, 0.2], [0.3, -0.2, 0.2]])
    put_in = splats_of(points, np.tile([1.0, 0.0, 0.0], (3, 1)), np.full((3, 3), 0.6))
    found = images_of(put_in, mirror, scene)
    heights = 2.0 * (points[:2] @ mirror.normal - mirror.offset)[:, None] * mirror.normal
    np.testing.assert_allclose(found.means, points[:2] - heights, atol=1e-5)
    shown = linear_from_srgb(np.clip(0.5 + SH_C0 * found.sh[:, 0], 0.0, 1.0))
    np.testing.assert_allclose(shown, np.tile(mirror.own + mirror.reflectance * 0.6, (2, 1)), rtol=0.02)


def test_a_picture_has_the_image_of_a_mesh(put):
    job, shaded, splats = put
    eye, target = np.array(EYES[2]), np.array([WHERE[0], 0.0, WHERE[1]])
    view = View.look_at(eye, target, [0, 1, 0], 60.0, 64)
    asked = splats, shaded.inserted, PictureAsked(job.known.scene, view, shaded.exposure)
    plain = with_objects(*asked)
    both = with_objects(*asked, floor=job.known.mirror)
    assert len(both) > len(plain) > len(splats)
    added = both.means[len(plain) :]
    assert (added[:, 1] < 0.0).all() and added[:, 1].min() > -0.61
    assert (np.abs(added[:, [0, 2]] - WHERE) < 0.151).all()
    np.testing.assert_array_equal(both.sh[: len(plain)], plain.sh)
