"""How much of a scene objects change, and that what is taken out again leaves nothing behind."""

import json

import numpy as np
import pytest
from insert_places import disc, floor_place, grid_floor, request, rows

from relight import plan_relight
from relight.cli import main
from relight.insert.gathering import Casting, change_at
from relight.insert.insert_plan import evenly_lit, plan_inserts
from relight.insert.surroundings import Receiving
from relight.jobs.folders import relight_files
from relight.jobs.job import Job

pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


@pytest.fixture
def place(tmp_path):
    return floor_place(tmp_path)


@pytest.mark.slow
def test_an_object_put_in_and_taken_out_again_leaves_every_bit(place, tmp_path):
    """Though the cache of the scene has been through it."""
    relight_files(request(place, [], tmp_path / "before", env="captured"))
    asked = f"{disc(tmp_path, 0.2)} at=-2,.3,-2"
    relight_files(request(place, [asked], tmp_path / "with", env="captured"))
    relight_files(request(place, [], tmp_path / "after", env="captured"))
    before, between, after = (tmp_path / name / "relit_splat.ply" for name in ("before", "with", "after"))
    assert between.read_bytes() != before.read_bytes() == after.read_bytes()
    np.testing.assert_array_equal(rows(after), rows(tmp_path / "floor.ply"))
    assert not (after.parent / "inserted.glb").exists()


def test_shares_are_those_of_the_whole_scene(place, tmp_path):
    job = Job(request(place, [f"{disc(tmp_path, 0.3)} at=1,.4,0"], None))
    inserts, occluder = job.known.inserts, job.known.relighter.occluder
    around = evenly_lit(job.known.scene, occluder)
    plan = plan_inserts(inserts.standing, job.known.scene, around, job.inputs.splats[0])
    at, sent = Receiving(occluder.origins, occluder.normals), inserts.standing.albedo
    change = np.abs(change_at(around, inserts.standing, sent, Casting(32), at)).max(axis=1)
    assert plan.changed == pytest.approx((change > 0.0042).mean(), abs=0.01)  # all are in the sample
    assert (change > 0.0).mean() <= plan.reach < 1.0
    distance = np.linalg.norm(job.inputs.splats[0].means - [1, 0.4, 0], axis=1)
    radius = np.hypot(0.3, 0.005)
    assert plan.splats == pytest.approx((distance < 20 * radius).mean(), abs=0.005)
    assert plan.rays == 32 * round(plan.reach * len(job.known.scene.vertices)) + 256 * len(inserts.standing.vertices)


def test_an_object_that_nothing_sees_changes_nothing(place, tmp_path):
    planned = plan_relight(request(place, [f"{disc(tmp_path, 0.3)} at=0,-2,0"], None)).inserts
    assert (planned.objects, planned.changed) == (1, 0.0)


def test_the_command_reports_it(place, tmp_path, capsys):
    words = [str(place), "--insert", str(disc(tmp_path)), "--at", "0,.5,0", "--albedo", "captured", "--plan"]
    assert main(words) == 0
    assert "objects: 1 object; " in capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    planned = json.loads(capsys.readouterr().out)["inserts"]
    assert 0.0 < planned["changed"] <= planned["reach"] <= 1.0
    assert grid_floor().vertices.shape[0] * planned["reach"] > 10
