"""relight.splats.albedo, and the files of `--format albedo-splat`: the capture's light is gone, normals are there."""

import hashlib
import json

import numpy as np
import pytest
from gltf_check import validator_issues
from lit_ball import TILT, albedo_at, ball_scene, received_at, splats_of_ball

from relight import LightingOptions
from relight.engine.appearance import Appearance
from relight.jobs.job import Job
from relight.jobs.writer import Writer
from relight.request import RelightRequest
from relight.splats import Binding, albedo_splats, normals_of
from relight.splats.write import HIDDEN
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.formats.ply import Ply

NOWHERE = np.zeros(0, np.int64)


@pytest.fixture(scope="module")
def ball():
    scene, albedo = ball_scene()
    splats, normals = splats_of_ball()
    received = received_at(scene.normals).astype(np.float32)
    look = Appearance(albedo, scene.colors_linear, received)
    return scene, splats, normals, Binding(splats, scene, views=()), look


def test_the_light_of_the_capture_is_gone_from_the_colours(ball):
    _, splats, normals, binding, look = ball
    bare = albedo_splats(splats, binding, look, NOWHERE)
    truth = srgb_from_linear(albedo_at(normals).astype(np.float32))
    before, after = (np.abs(each.colors_diffuse - truth).mean() for each in (splats, bare))
    # Gaussians take the mean of seven points about them, and divisions by little light are softened.
    assert after < 0.02 < 0.1 < before
    assert bare.degree == 0 and len(bare) == len(splats)


def test_harmonics_can_be_kept(ball):
    _, splats, _, binding, look = ball
    kept = albedo_splats(splats, binding, look, NOWHERE, harmonics="keep")
    assert kept.degree == 1 and np.abs(kept.sh[:, 1:]).max() > 0
    np.testing.assert_array_equal(kept.sh[:, :1], albedo_splats(splats, binding, look, NOWHERE).sh)


def test_the_captured_colours_as_albedo_change_no_bit(ball):
    scene, splats, _, binding, _ = ball
    captured = Appearance(scene.colors_linear, scene.colors_linear, np.ones_like(scene.colors_linear))
    np.testing.assert_array_equal(albedo_splats(splats, binding, captured, NOWHERE, "keep").sh, splats.sh)


def test_the_far_background_goes_or_stays_as_captured(ball):
    _, splats, _, binding, look = ball
    far = np.array([2, 5])
    dropped = albedo_splats(splats, binding, look, far)
    assert (dropped.opacities[far] == 0.0).all() and (np.delete(dropped.opacities, far) > 0.0).all()
    kept = albedo_splats(splats, binding, look, far, "keep", "keep")
    np.testing.assert_array_equal(kept.sh[far], splats.sh[far])
    np.testing.assert_array_equal(kept.opacities, splats.opacities)


def test_a_scene_that_stays_as_captured_keeps_its_colours(ball):
    _, splats, _, _, look = ball
    np.testing.assert_array_equal(albedo_splats(splats, None, look, NOWHERE, "keep").sh, splats.sh)


def test_normals_are_those_of_the_surface_in_the_frame_of_the_splats(ball):
    _, _, normals, binding, _ = ball
    found = normals_of(binding)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-5)
    cosine = np.einsum("nc,nc->n", found @ TILT[:3, :3].T, normals)
    assert cosine.min() > np.cos(np.radians(6.0))  # faces of the ball are 9 degrees wide


def test_one_pass_writes_splat_proxy_and_collision_mesh(tmp_path, monkeypatch):
    monkeypatch.setattr("relight.splats.binding.VIEWS", 4)
    scene, albedo = ball_scene(10)
    splats, normals = splats_of_ball(300)
    file = tmp_path / "ball.compressed.ply"
    write_splats(file, splats, "compressed.ply")
    scene.source = {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest(), "path": str(file)}
    options = LightingOptions("analytic", bands=3)
    formats = ("albedo-splat", "splat-glb", "glb")
    job = Job(RelightRequest(scene, "noon", options, albedo=albedo, formats=formats, live_mesh=True, sky="drop"))
    (shaded,) = job.shaded()
    report = Writer(job).write(shaded, tmp_path / "out")
    names = {"relit.glb", "live.glb", "albedo_splat.ply", "proxy.glb", "albedo_splat.collision.glb", "relit_splat.glb"}
    assert set(report["files"]) == names and {p.name for p in (tmp_path / "out").iterdir()} == {*names, "report.json"}
    bare = read_splats(tmp_path / "out" / "albedo_splat.ply")
    assert len(bare) == 300 and bare.degree == 0
    rows = Ply.open(tmp_path / "out" / "albedo_splat.ply").rows("vertex")
    found = np.stack([rows[name] for name in ("nx", "ny", "nz")], axis=1)
    assert np.einsum("nc,nc->n", found @ TILT[:3, :3].T, normals).mean() > 0.98
    for name in ("live.glb", "proxy.glb", "albedo_splat.collision.glb"):
        assert validator_issues(tmp_path / "out" / name)["messages"] == []
    assert json.loads((tmp_path / "out" / "report.json").read_text())["files"] == report["files"]


def test_what_is_hidden_is_written_hidden(ball, tmp_path):
    from relight.splats import write_relit_ply

    _, splats, _, binding, look = ball
    write_splats(tmp_path / "a.ply", splats)
    bare = albedo_splats(splats, binding, look, np.array([4]))
    write_relit_ply(tmp_path / "b.ply", bare, tmp_path / "a.ply", normals_of(binding))
    rows = Ply.open(tmp_path / "b.ply").rows("vertex")
    assert rows["opacity"][4] == HIDDEN and "f_rest_0" not in rows.dtype.names
    np.testing.assert_array_equal(rows["nx"], normals_of(binding)[:, 0])


def test_usd_without_its_library_is_reported_before_any_work(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pxr", None)
    scene, albedo = ball_scene(8)
    splat = splats_of_ball(50)[0]
    job = Job(RelightRequest(scene, "noon", LightingOptions("analytic", bands=3), albedo=albedo, formats=("usd",)))
    job.inputs.__dict__["splats"] = (splat, [])
    with pytest.raises(InputError, match="USD needs usd-core, which is not installed"):
        job.known.relighter  # noqa: B018
