"""The score of relit splats and of meshes against their truth."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scenes import build
from scenes.__main__ import main as make
from scenes.pictures import Pictures, psnr
from scenes.score import read_truth, score
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import Splats

ROOT = Path(__file__).parents[2]


def command(*arguments):
    """Result of scripts/score."""
    words = [sys.executable, ROOT / "scripts" / "score", *arguments]
    return subprocess.run(
        list(map(str, words)), capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
    )


@pytest.fixture(scope="module")
def nook(tmp_path_factory):
    """A generated place with pictures under another light."""
    folder = tmp_path_factory.mktemp("score") / "nook"
    words = ["--kind", "nook", "--splats", "3000", "--vertices", "3000", "--views", "12", "--env", "overcast"]
    assert make([str(folder), *words, "--relit", "noon", "-q"]) == 0
    return folder


def test_a_gain_is_found_and_what_remains_is_the_error():
    wanted = [np.random.default_rng(view).uniform(0.1, 0.6, (500, 3)) for view in range(2)]
    linear = [linear_from_srgb(each) for each in wanted]
    assert psnr(linear, wanted).psnr > 100
    darker = psnr([each / 1.7 for each in linear], wanted)
    assert darker.gain == pytest.approx(1.7, rel=1e-3)
    assert darker.psnr < 25 and darker.psnr_gain > 60
    tinted = psnr([each / [1.3, 1.0, 0.7] for each in linear], wanted)
    assert tinted.psnr < tinted.psnr_gain < 35 and tinted.psnr_wb > 55
    # 1/50 off in every channel, up in one view and down in the other: no gain helps.
    off = psnr([linear_from_srgb(each + sign / 50) for each, sign in zip(wanted, (1, -1), strict=True)], wanted)
    assert off.psnr == pytest.approx(20 * np.log10(50), abs=0.01)


def test_the_true_colours_come_nearer_than_those_of_the_capture(nook):
    splat = nook / "point_cloud" / "iteration_30000" / "point_cloud.ply"
    captured, pictures = read_splats(splat), Pictures(nook)
    s = captured
    true = Splats(s.means, s.scales, s.quats_wxyz, s.opacities, np.load(nook / "truth_noon.npz")["splat_sh"])
    assert pictures.score(true, "noon").psnr > pictures.score(captured, "noon").psnr_gain + 1.0
    assert pictures.score(captured, "capture").psnr > pictures.score(true, "capture").psnr


def test_pictures_of_test_views_are_read_by_light_and_by_case(nook, tmp_path):
    pictures = Pictures(nook)
    views, inside, linear = pictures.under("noon")
    one = {
        "w2c": np.stack([view.camera_from_world for view in views]),
        "K": np.stack([[[v.fx, 0, v.cx], [0, v.fy, v.cy], [0, 0, 1]] for v in views]),
        "alpha": np.stack(inside) * np.uint8(255),
        "lin_noon": np.stack(linear),
    }
    np.savez(tmp_path / "test_views.npz", **one)
    np.savez(tmp_path / "lamps.npz", alpha_night=one["alpha"], lin_night=one["lin_noon"])
    splats = read_splats(nook / "point_cloud" / "iteration_30000" / "point_cloud.ply")
    expected = pictures.score(splats, "noon")
    assert Pictures(tmp_path).score(splats, "noon") == expected
    assert Pictures(tmp_path).score(splats, "lamps:night") == expected
    for light in ("dusk", "lamps:dusk", "lit:night"):
        with pytest.raises(InputError, match=light):
            Pictures(tmp_path).under(light)


def test_only_what_lies_in_the_sphere_counts(tmp_path):
    truth = build("tabletop", 1, 2000)
    mesh, far = (truth.vertices, truth.faces), truth.vertices.copy()
    radius = 0.4 * np.linalg.norm(np.ptp(far, axis=0))
    outside = np.linalg.norm(far - far[0], axis=1) > 1.5 * radius
    far[outside] += 0.5 * radius
    sphere = far[0], radius
    assert score((far, truth.faces), mesh, samples=5000)["F@0.01"] < 0.95
    kept = score((far, truth.faces), mesh, samples=5000, sphere=sphere)["F@0.01"]
    assert kept == pytest.approx(score(mesh, mesh, samples=5000, sphere=sphere)["F@0.01"], abs=0.03)


def test_the_command_prints_one_object_and_refuses_in_one_line(nook, tmp_path):
    splat = nook / "point_cloud" / "iteration_30000" / "point_cloud.ply"
    done = command("splat", splat, nook, "noon", "--json")
    assert done.returncode == 0, done.stderr
    assert set(json.loads(done.stdout)) == {"psnr", "psnr_gain", "psnr_wb", "gain"}
    for words, says in [
        (("splat", splat, nook, "dusk"), "dusk: expected a light of"),
        (("splat", splat, tmp_path, "noon"), "expected test_views.npz"),
        (("mesh", nook / "truth.ply", tmp_path), "expected the true mesh"),
    ]:
        failed = command(*words)
        assert failed.returncode == 2 and says in failed.stderr and failed.stderr.count("\n") == 1


def test_the_truth_scores_itself(nook):
    truth = read_truth(nook)
    assert truth.sphere is None and len(truth.centers) == 12
    assert score(truth.mesh, truth.mesh, truth.centers)["F@0.01"] > 0.95


def test_a_sphere_is_read_from_the_facts_of_a_capture(nook, tmp_path):
    (tmp_path / "sparse").symlink_to(nook / "sparse")
    (tmp_path / "gt_mesh.ply").symlink_to(nook / "truth.ply")
    (tmp_path / "meta.json").write_text(json.dumps({"roi": {"center": [1, 2, 3], "radius": 4}}))
    center, radius = read_truth(tmp_path).sphere
    assert center.tolist() == [1, 2, 3] and radius == 4.0
