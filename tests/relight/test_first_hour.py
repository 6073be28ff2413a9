"""What a new user meets: one command from a splat to a picture of it in a new light, and what it says on the way."""

import json
import shutil
from pathlib import Path

import imagecodecs
import numpy as np
import open3d as o3d
import pytest
from ball_splats import GREEN, RADIUS, RED, solid_ball
from viewer_scenes import ball_on_plate

import relight.jobs.meshing
from relight.cli import main
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.jobs.writer import Writer
from relight.light import skies
from relight.options import LightingOptions
from relight.request import RelightRequest
from relight.texture.baking import Baked
from relight.transfer import store
from relight.transfer.store import Cache
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import read_splats, write_inria_ply

FAST = "--method", "analytic", "--tolerance", "10%", "--albedo", "captured"
"""One light in no time: what is tested is the way to it."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a splat, ball.ply, and the scene made of it, ball/."""
    folder = tmp_path_factory.mktemp("hour")
    write_inria_ply(folder / "ball.ply", solid_ball())
    meshed(folder / "ball.ply").save(folder / "ball")
    return folder


def meshed(path, **_):
    """What stands for the conversion of the ball, which takes seconds."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(RADIUS, 16)
    vertices = np.asarray(mesh.vertices).astype(np.float32)
    colors = np.round(255 * np.where(vertices[:, 1:2] < 0, RED, GREEN)).astype(np.uint8)
    faces = np.asarray(mesh.triangles).astype(np.int32)
    return Scene.from_mesh(
        Mesh(vertices, vertices / np.float32(RADIUS), faces, colors),
        source=describe(path),
        settings={"up_from": "assumed -y"},
        statistics={"vertices": len(vertices), "faces": len(faces), "splats": 3000},
        picture=np.zeros((4, 8, 3), np.uint8),
    )


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    """A copy of it as the current folder."""
    folder = shutil.copytree(made, tmp_path / "hour")
    monkeypatch.chdir(folder)
    return folder


def run(capsys, *arguments):
    code = main(list(map(str, arguments)))
    printed = capsys.readouterr()
    return code, printed.out, printed.err


def test_one_command_meshes_keeps_the_scene_and_shows_the_relit_splat(here, capsys, monkeypatch):
    shutil.rmtree(here / "ball")
    asked = []
    monkeypatch.setattr("relight.jobs.meshing.meshed", lambda path, *_: asked.append(path) or meshed(path))
    code, out, err = run(capsys, "ball.ply", "--env", "SUNSET", "--sheet", *FAST)
    assert code == 0 and "error" not in err
    assert (here / "ball" / "scene.json").is_file() and (here / "ball" / "preview.png").is_file()
    folder = here / "ball" / "relit" / "sunset_0"
    report = json.loads((folder / "report.json").read_text())
    assert report["files"] == ["relit.glb", "relit_splat.ply", "preview.png", "sheet.png"]
    assert report["preview"]["shows"] == "splat" and all((folder / name).is_file() for name in report["files"])
    assert "ball: " in out and "  up: assumed -y (--up overrules)" in out and "preview.png" in out
    # The second light finds the scene, and that it is of this very splat.
    code, out, _ = run(capsys, "ball.ply", "--env", "noon", *FAST)
    assert code == 0 and len(asked) == 1 and "the existing scene of" in out
    write_inria_ply("ball.ply", solid_ball(500))
    code, _, err = run(capsys, "ball.ply", "--env", "noon", *FAST, "--overwrite")
    assert code == 2 and "another splat, or of an older one" in err and "splat2mesh ball.ply -o NAME" in err


def test_a_plan_of_a_splat_meshes_nothing(here, capsys):
    shutil.rmtree(here / "ball")
    code, out, _ = run(capsys, "ball.ply", "--plan")
    assert code == 0 and "splat2mesh ball.ply --plan" in out
    assert [path.name for path in here.iterdir()] == ["ball.ply"]


def test_splats_and_meshes_are_recognised_by_their_content(here, tmp_path):
    ball_on_plate().save(tmp_path / "scene")
    assert relight.jobs.meshing.is_splat("ball.ply") and not relight.jobs.meshing.is_splat("ball")
    assert not relight.jobs.meshing.is_splat(tmp_path / "scene" / "chunks" / "0000.ply")
    (tmp_path / "tiles").mkdir()
    assert relight.jobs.meshing.is_splat(tmp_path / "tiles")


def test_a_folder_that_is_in_the_way_is_left_alone(here, capsys):
    shutil.rmtree(here / "ball")
    (here / "ball").mkdir()
    code, _, err = run(capsys, "ball.ply")
    assert code == 2 and "ball exists and is not a scene folder" in err and not list((here / "ball").iterdir())


def test_lights_given_one_by_one_and_in_a_folder_are_lit_in_their_order(here, capsys):
    lights = here / "hdris"
    lights.mkdir()
    (lights / "grey.hdr").write_bytes(imagecodecs.rgbe_encode(np.full((8, 16, 3), 0.5, np.float32)))
    assert run(capsys, "ball", "--env", "noon", "--env", "hdris", "--format", "npy", *FAST)[0] == 0
    assert run(capsys, "ball", "--env", "hdris", "--format", "npy", "-o", "alone", *FAST)[0] == 0
    together, alone = (np.load(here / name) for name in ("ball/relit/grey_0/radiance.npy", "alone/radiance.npy"))
    assert np.array_equal(together, alone)
    assert sorted(path.name for path in (here / "ball" / "relit").iterdir()) == ["grey_0", "noon_0"]


def test_every_light_of_a_folder_is_lit_and_shown_on_one_sheet(here, capsys):
    lights = here / "hdris"
    lights.mkdir()
    for name, color in (("red", [1.0, 0.1, 0.1]), ("blue", [0.1, 0.1, 1.0])):
        image = imagecodecs.rgbe_encode(np.tile(np.float32(color), (16, 32, 1)))
        (lights / f"{name}.hdr").write_bytes(image)
    (lights / "notes.txt").write_text("no light")
    code, out, _ = run(capsys, "ball", "--env", "hdris", "--format", "npy,png", "--sheet", *FAST)
    assert code == 0 and str(Path("ball/relit/sheet.png")) in out.splitlines()
    found = {name: np.load(here / "ball" / "relit" / f"{name}_0" / "radiance.npy") for name in ("red", "blue")}
    red, blue = (found[name].mean(axis=0) for name in ("red", "blue"))
    assert red[0] > 5 * blue[0] and blue[2] > 5 * red[2]
    assert (here / "ball" / "relit" / "sheet.png").is_file()
    (lights / "red.hdr").unlink()
    (lights / "blue.hdr").unlink()
    code, _, err = run(capsys, "ball", "--env", "hdris")
    assert code == 2 and "the folder holds no .exr and no .hdr file" in err


def test_format_splat_alone_shows_a_picture_too(here, capsys):
    code, _, _ = run(capsys, "ball", "--format", "splat", "-o", "out", *FAST)
    assert code == 0 and {path.name for path in (here / "out").iterdir()} == {
        "relit_splat.ply",
        "preview.png",
        "report.json",
    }
    assert len(read_splats(here / "out" / "relit_splat.ply")) == 3000


def test_without_its_splat_a_scene_shows_its_mesh_and_says_so(here):
    (here / "ball.ply").unlink()
    job = Job(RelightRequest("ball", "noon", LightingOptions("analytic", bands=3), albedo="captured", caching="none"))
    with pytest.warns(DataWarning, match="does not exist.*the picture shows the mesh"):
        assert job.inputs.formats == ("glb", "png")
    (shaded,) = job.shaded()
    assert Writer(job).write(shaded, here / "out")["preview"]["shows"] == "mesh"
    with pytest.raises(InputError, match="does not exist"):
        Job(RelightRequest("ball", "noon", formats=("splat",))).inputs.splats  # noqa: B018


def test_a_session_of_a_scene_from_a_splat_shows_the_splat(here):
    options = LightingOptions("analytic", bands=3)
    shown = session_of(Job(RelightRequest("ball", "noon", options, albedo="captured", caching="none"))).splats
    assert len(shown.captured) == 3000 and set(shown.looks) == {"captured"}
    assert len(shown.far(shown.captured).rows) == 0  # it has no sky


def test_a_plan_estimates_no_albedo_and_says_so(here, capsys):
    code, out, _ = run(capsys, "ball", "--plan", "--tolerance", "20%", "--json")
    result = json.loads(out)
    assert code == 0 and "planned with the captured colours" in result["note"]
    assert result["plan"]["tolerance"] == 0.2 and not (here / "ball" / "cache").exists()


def test_the_summary_says_what_is_kept_and_what_a_budget_left_out(here, capsys, monkeypatch):
    monkeypatch.setattr(Cache, "size_bytes", property(lambda self: 5 * 2**20))  # less than a megabyte is not reported
    arguments = "ball", "--albedo", "captured", "--format", "npy", "--overwrite", "-o", "out"
    code, out, _ = run(capsys, *arguments, "--budget", "0.2", "--effects", "shadows", "--rays", "4", "--bands", "3")
    assert code == 0 and "covers the light; everything else took" in out and "keeps 5 MB for the next light" in out
    kept = {(path, path.stat().st_mtime_ns) for path in (here / "ball" / "cache").iterdir()}
    assert kept
    code, out, _ = run(capsys, *arguments, *FAST, "--clear-cache")
    after = {(path, path.stat().st_mtime_ns) for path in (here / "ball" / "cache").glob("*")}
    assert code == 0 and not kept & after


def test_the_cache_has_a_cap_and_what_was_used_last_stays(tmp_path, monkeypatch):
    cache = Cache(tmp_path / "cache", "geometry")
    block = np.zeros(1000)
    for number in range(4):
        cache.put("transfer", number, block=block)
    one = cache.size_bytes / 4
    monkeypatch.setattr(store, "MOST_BYTES", round(2.5 * one))
    small = Cache(tmp_path / "cache", "geometry")
    small.put("transfer", 4, block=block)
    assert cache.size_bytes <= 2.5 * one and cache.get("transfer", 4) is not None and cache.get("transfer", 0) is None
    cache.clear()
    assert cache.size_bytes == 0 and Cache().size_bytes == 0


def test_a_mesh_without_a_splat_is_shown_in_the_texture_that_is_baked(here, capsys):
    mesh = "ball/chunks/0000.ply"
    arguments = mesh, "--bake", "texture", "--texture-size", "64", "--format", "png", "-o", "out", *FAST
    assert run(capsys, *arguments)[0] == 0
    assert json.loads((here / "out" / "report.json").read_text())["preview"]["shows"] == "texture"


def test_texels_are_baked_once_for_all_lights(here, capsys, monkeypatch):
    arguments = "ball", "--bake", "texture", "--texture-size", "64", "--format", "npy", *FAST
    assert main([*arguments, "--env", "noon", "-q"]) == 0
    monkeypatch.setattr("relight.texture.bake", None)
    assert main([*arguments, "--env", "noon", "-q", "-o", "again"]) == 0
    for name in ("relit_texture.glb", "albedo_texture.glb"):
        first, second = (here / folder / name for folder in ("ball/relit/noon_0", "again"))
        assert first.read_bytes() == second.read_bytes()


def test_a_baked_texture_comes_back_from_its_arrays():
    from relight.texture import bake

    baked = bake(ball_on_plate(), size=64)
    again = Baked.of_arrays(baked.arrays())
    assert again.atlas.chunks == baked.atlas.chunks and again.atlas.size == 64
    np.testing.assert_array_equal(again.relit(), baked.relit())


def test_names_of_skies_do_not_depend_on_case():
    from relight import Environment

    assert {Environment.load(name.upper()).formula for name in skies.BUILTIN} == set(skies.BUILTIN)
