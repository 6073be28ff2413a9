"""Job: no work before it is asked for, stage after stage, and for a scene in memory what its folder gives."""

import json
from concurrent.futures import CancelledError

import numpy as np
import pytest
from mirrored_rooms import room
from viewer_scenes import ball_on_plate

from relight import Environment, LightingOptions, Scene
from relight.jobs.job import Job
from relight.jobs.writer import Writer, report_of
from relight.request import RelightRequest
from splat2mesh.base.errors import InputError
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats.write import write_splats

FAST = LightingOptions("analytic", bands=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("job") / "ball"
    ball_on_plate().save(path)
    return path


def test_the_constructor_does_no_work():
    job = Job(
        RelightRequest(
            "nowhere", "no light.exr", albedo="nothing.npy", splat="no splat", capture_env="no sky", animated=True
        )
    )
    assert not job.stages.seconds
    with pytest.raises(InputError, match=r"no light\.exr"):
        job.known.scene  # noqa: B018
    with pytest.raises(InputError, match="nowhere"):
        Job(RelightRequest("nowhere", "noon")).known.scene  # noqa: B018


def test_stages_are_done_once_and_only_as_far_as_they_are_asked_for(folder):
    job = Job(RelightRequest(folder, "noon", FAST, caching="none"))
    assert job.known.scene is job.known.scene and set(job.stages.seconds) == {"environment", "load"}
    assert job.plan is not None and "shade" not in job.stages.seconds
    assert job.plan is job.plan and job.known.appearance is job.known.appearance
    (shaded,) = job.shaded()
    assert "shade" in job.stages.seconds and "write" not in job.stages.seconds
    report = report_of(job, shaded)
    assert report["files"] == [] and json.dumps(report)


def test_a_scene_in_memory_gives_what_its_folder_gives(folder, tmp_path):
    light = Environment.load("noon")
    jobs = (
        Job(
            RelightRequest(
                folder, "noon", FAST, angles_deg=(0.0, 30.0), albedo="captured", formats=("npy",), caching="none"
            )
        ),
        Job(RelightRequest(ball_on_plate(), light, FAST, angles_deg=(0.0, 30.0), formats=("npy",))),
    )
    for job, name in zip(jobs, "ab", strict=True):
        for number, shaded in enumerate(job.shaded()):
            Writer(job).write(shaded, tmp_path / f"{name}{number}")
    for number in range(2):
        one, other = (np.load(tmp_path / f"{name}{number}" / "radiance.npy") for name in "ab")
        np.testing.assert_array_equal(one, other)
    reports = [json.loads((tmp_path / f"{name}1" / "report.json").read_text()) for name in "ab"]
    assert [report["angle_deg"] for report in reports] == [30.0, 30.0]
    assert [report["albedo"] for report in reports] == ["captured", "captured"]
    assert reports[0]["exposure"] == reports[1]["exposure"]


def test_the_albedo_may_be_an_array(folder):
    scene = Scene.load(folder)
    grey = np.full((scene.vertex_count, 3), 0.5, np.float32)
    (shaded,) = Job(RelightRequest(scene, "noon", FAST, albedo=grey)).shaded()
    (white,) = Job(RelightRequest(scene, "noon", FAST, albedo="white")).shaded()
    np.testing.assert_array_equal(shaded.shading.radiance, 0.5 * white.shading.radiance)
    with pytest.raises(InputError, match="`albedo` an array: expected numbers of shape"):
        Job(RelightRequest(scene, "noon", FAST, albedo=grey[1:])).known.appearance  # noqa: B018


def test_a_scene_without_a_splat_is_lit_by_its_own_colours(folder):
    assert Job(RelightRequest(ball_on_plate(), "noon", FAST)).known.appearance.capture is None
    assert Job(RelightRequest(folder, "noon", FAST, caching="none")).known.appearance.capture is not None


def test_splats_alone_take_the_light_of_all_vertices_that_is_kept(tmp_path):
    """Where it is not kept, only what splats show is lit; and what was once lit for them alone goes on so."""
    scene, splats = room(below=None, polished=False)
    file = tmp_path / "room.ply"
    write_splats(file, splats.take(np.arange(len(splats) // 4)))
    scene.source = {"file": file.name, "sha256": fingerprint(file), "path": str(file)}
    options, traced = LightingOptions(bands=3, rays=16, effects="shadows,bounces"), {}
    for name, runs in (("kept", (("ply", "splat"), ("splat",))), ("alone", (("splat",), ("ply", "splat"), ("splat",)))):
        scene.save(tmp_path / name)
        for number, formats in enumerate(runs):
            job = Job(RelightRequest(tmp_path / name, "overcast", options, albedo="captured", formats=formats))
            tuple(job.shaded())
            traced[name, number] = job.known.relighter.rays_traced, job.known.relighter.precomputed.partly
    assert traced["kept", 0][0] > 0 and traced["kept", 1] == (0, False)
    assert 0 < traced["alone", 0][0] < traced["kept", 0][0] and traced["alone", 0][1]
    assert traced["alone", 1][0] > 0 and traced["alone", 2] == (0, True)


def test_what_was_begun_beside_is_given_up_when_a_run_ends_early():
    job = Job(RelightRequest("nowhere", "noon"))
    job.known._go_on(1)
    job.known.leave()
    with pytest.raises(CancelledError):
        job.known._go_on(1)
