"""Animated objects in a place that stands still."""

import json

import imageio.v3 as iio
import numpy as np
import pygltflib
import pytest
import trimesh
from insert_places import disc, floor_place, request

from relight.animation.film import Acting
from relight.cli import main
from relight.insert.inserts import ShadowedSplats, shadowed
from relight.jobs.folders import relight_files
from relight.jobs.job import Job
from splat2mesh.base.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


@pytest.fixture
def place(tmp_path):
    return floor_place(tmp_path)


@pytest.fixture
def sliding(tmp_path):
    """A box that slides by 2 along x within a second, and a part of it that stands."""
    parts = trimesh.Scene([trimesh.creation.box((0.4, 0.4, 0.4))])
    parts.add_geometry(trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation([0, 0, 1.5]))
    data = pygltflib.GLTF2.load_from_bytes(parts.export(file_type="glb"))
    times, shifts = np.float32([0, 1]), np.float32([[0, 0, 0], [2, 0, 0]])
    blob = data.binary_blob() + times.tobytes() + shifts.tobytes()
    start = len(data.binary_blob())
    first = len(data.bufferViews)
    data.bufferViews.append(pygltflib.BufferView(buffer=0, byteOffset=start, byteLength=8))
    data.bufferViews.append(pygltflib.BufferView(buffer=0, byteOffset=start + 8, byteLength=24))
    accessors = len(data.accessors)
    data.accessors.append(pygltflib.Accessor(bufferView=first, componentType=5126, count=2, type="SCALAR"))
    data.accessors.append(pygltflib.Accessor(bufferView=first + 1, componentType=5126, count=2, type="VEC3"))
    node = next(number for number, each in enumerate(data.nodes) if each.mesh == 0)
    data.nodes[node].matrix, data.nodes[node].translation = None, [0.0, 0.0, 0.0]
    sampler = pygltflib.AnimationSampler(input=accessors, output=accessors + 1)
    target = pygltflib.AnimationChannelTarget(node=node, path="translation")
    channel = pygltflib.AnimationChannel(sampler=0, target=target)
    data.animations.append(pygltflib.Animation(name="slide", samplers=[sampler], channels=[channel]))
    data.buffers[0].byteLength = len(blob)
    data.set_binary_blob(blob)
    data.save_binary(str(tmp_path / "box.glb"))
    return tmp_path / "box.glb"


def lights(job, acting, times):
    around = next(job.shaded()).inserted
    return [acting.at(time_s).under(around.around, around.received) for time_s in times]


@pytest.mark.slow
def test_a_pose_is_lit_as_the_object_that_stands_there(place, sliding, tmp_path):
    """To the bit, on mesh and splats, against the box as a file of its own at the place that it has slid to."""
    job = Job(request(place, [f"{sliding} at=-1,.3,0 albedo=.3"], None))
    acting = Acting(job.known.inserts)
    assert (acting.duration_s, acting.name) == (1.0, "slide")
    start, middle = lights(job, acting, (0.0, 0.5))
    moved = middle.standing.vertices - start.standing.vertices
    assert {tuple(each) for each in np.round(moved, 5)} == {(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)}
    still = [f"{sliding.parent / name} at={x},.3,{z} albedo=.3" for name, x, z in (("a.obj", 0, 0), ("b.obj", -1, 1.5))]
    for name, side in (("a.obj", 0.4), ("b.obj", 0.1)):
        (tmp_path / name).write_text(trimesh.exchange.obj.export_obj(trimesh.creation.box((side,) * 3)))
    other = next(Job(request(place, still, None)).shaded()).inserted
    # Rays start by the position within the whole of the objects, so that noise differs: 1.5% of the light, 32 rays.
    difference = middle.ratio - other.ratio
    assert np.sqrt(np.mean(difference[(other.ratio != 1).any(axis=1)] ** 2)) < 0.015
    splats = job.inputs.splats[0]
    np.testing.assert_array_equal(ShadowedSplats([middle], splats).under(middle).sh, shadowed(middle, splats).sh)
    both = ShadowedSplats([start, middle], splats)
    for light in (start, middle):  # finer elsewhere too, so that splats are bound a little differently
        np.testing.assert_allclose(both.under(light).sh, shadowed(light, splats).sh, atol=0.1)
        changed = (both.under(light).sh != splats.sh).any(axis=(1, 2))
        x = -1.0 if light is start else 0.0
        assert not changed[np.linalg.norm(splats.means[:, [0, 2]] - [x, 0], axis=1) > 3.9].any()


@pytest.mark.slow
def test_the_film_shows_box_and_shadow_move(place, sliding, tmp_path):
    out = tmp_path / "film"
    asked = request(place, [f"{sliding} at=-1,.2,0 albedo=.02"], out, animated=True, fps=2.0)
    done = relight_files(asked)
    frames = [iio.imread(out / f"000{number}.png").astype(int) for number in range(3)]
    report = json.loads((out / "report.json").read_text())
    assert (report["frames"], report["fps"], report["animation"]) == (3, 2.0, "slide")
    assert done.reports[0]["inserted"][0]["name"] == "box.glb"
    places = np.array([np.argwhere(frame.sum(axis=2) < 120).mean(axis=0) for frame in frames])  # row, column
    first, second = np.diff(places, axis=0)
    assert min(np.linalg.norm(first), np.linalg.norm(second)) > 3  # in pixels of 72 rows: it slides towards the camera
    assert first @ second > 0.9 * np.linalg.norm(first) * np.linalg.norm(second)


def test_what_does_not_move_is_refused_in_one_line(place, tmp_path, capsys):
    job = Job(request(place, [f"{disc(tmp_path)} at=0,.5,0"], None))
    with pytest.raises(InputError, match="no inserted object has an animation"):
        Acting(job.known.inserts)
    words = [str(place), "--insert", str(disc(tmp_path)), "--at", "0,.5,0", "--albedo", "captured", "--animate"]
    assert main([*words, "-o", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
