"""The relight command at its wall: a plan writes nothing, errors name options, the host stays as it was."""

import json
import os
import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from viewer_scenes import ball_on_plate

from relight import LightingOptions, cli
from relight.cli import main
from relight.engine.light_mix import LightKind


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A saved scene that stands for one made of a splat: its albedo is estimated."""
    path = tmp_path_factory.mktemp("wall") / "ball"
    ball_on_plate().save(path)
    return path


def tree(folder):
    """Every path below a folder, and the bytes of its files."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def test_a_plan_writes_nothing_not_even_a_cache(folder, monkeypatch, capsys):
    before = tree(folder.parent)
    monkeypatch.chdir(folder.parent)
    assert main([str(folder), "--env", "noon", "--plan", "--tolerance", "0.05", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)["plan"]
    assert plan["tolerance"] == 0.05 and plan["settings"]["method"]
    assert tree(folder.parent) == before


def test_a_mesh_takes_the_colour_of_its_material(tmp_path):
    made = trimesh.creation.icosphere(2)
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    made.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(made.vertices), 2)), material=material)
    made.export(tmp_path / "red.glb")
    words = [str(tmp_path / "red.glb"), "--env", "overcast", "--format", "npy", "-q", "-o", str(tmp_path / "out")]
    assert main(words) == 0
    light = np.load(tmp_path / "out" / "radiance.npy")
    assert light[:, 0].min() > 0.0 and not light[:, 1:].any()


@pytest.mark.parametrize("wish", [[], ["--tolerance", ".05"], ["--budget", "2"]])
def test_a_body_without_shadows_can_be_traced(wish, tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "ball.ply")
    words = [str(tmp_path / "ball.ply"), "--method", "raytraced", *wish, "--env", "overcast", "--format", "npy", "-q"]
    assert main([*words, "-o", str(tmp_path / "out")]) == 0


def test_a_plan_reads_what_was_kept_and_leaves_it_alone(folder, tmp_path, capsys):
    arguments = [str(folder), "--env", "overcast", "--tolerance", "0.05", "-q", "--format", "npy"]
    assert main([*arguments, "-o", str(tmp_path / "out")]) == 0
    before = tree(folder)
    assert any(name.startswith("cache/plan-") for name in before)
    times = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert main([*arguments, "--plan", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["plan"]["checked_error"] is not None
    assert tree(folder) == before and times == {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "0"], "--budget must be a number above 0, found 0.0"),
        (["--budget", "1", "--tolerance", "0.1"], "--tolerance and --budget: expected one of them"),
        (["--env", "noon", "--env", "sunset", "--plan"], "--env sunset: one light is expected here; give noon alone"),
        (["--env", "noon", "--env", "sunset", "--view"], "--env sunset: one light is expected here; give noon alone"),
        (["--rays", "0"], "--rays per vertex must be a whole number"),
        (["--effects", "sun"], "--effects sun: sun, bounces and volume need shadows too"),
        (["--capture-env", "noon", "--albedo", "white"], "--capture-env: it needs an estimated albedo"),
        (["--albedo", "nowhere.npy"], "--albedo nowhere.npy: expected estimated, captured, white or a .npy file"),
        (["-o", "SCENE/chunks"], "exists already: choose another --output, or replace it with --overwrite"),
    ],
)
def test_errors_name_the_options_of_the_command(folder, capsys, arguments, message):
    before = tree(folder)
    code = main([str(folder), *(text.replace("SCENE", str(folder)) for text in arguments)])
    printed = capsys.readouterr()
    assert code == 2 and message in printed.err and "`" not in printed.err and printed.out == ""
    assert tree(folder) == before


def test_the_command_leaves_warnings_as_they_were(folder, tmp_path):
    shown, filters = warnings.showwarning, list(warnings.filters)
    assert main([str(folder), "--method", "analytic", "--format", "npy", "-q", "-o", str(tmp_path / "out")]) == 0
    assert warnings.showwarning is shown and warnings.filters == filters


def test_every_option_of_the_light_reaches_the_job_unchanged(folder, monkeypatch):
    seen = []

    class Job:
        inputs = SimpleNamespace(asked_lamps=())
        known = SimpleNamespace(gloss=None, mirrored_floor=None, scene=SimpleNamespace(capture={}))
        light_kind = LightKind.ALONE

        def __init__(self, request, stages, at_hand):
            seen.append((request.lighting, request.angles_deg, request.caching))

        def planned(self):
            return type("Plan", (), {"table": lambda self: [], "as_dict": lambda self: {}})(), ""

    monkeypatch.setattr("relight.api.Job", Job)
    given = "--method raytraced --bands 4 --rays 32 --effects shadows,sun --budget 2 --seed 7 --rotate 0:20:10 --plan"
    assert main([str(folder), "-q", *given.split()]) == 0
    wanted = LightingOptions(method="raytraced", bands=4, rays=32, effects="shadows,sun", budget_s=2.0, seed=7)
    assert seen == [(wanted, (0.0, 10.0, 20.0), "read")]


IMPORTS = """
import os, sys, warnings
before = dict(os.environ), warnings.showwarning, list(warnings.filters), os.fstat(1)[:3], os.fstat(2)[:3]
import relight, splat2mesh
{use}
after = dict(os.environ), warnings.showwarning, list(warnings.filters), os.fstat(1)[:3], os.fstat(2)[:3]
print([name for name, a, b in zip(("environ", "showwarning", "filters", "stdout", "stderr"), before, after) if a != b])
"""

USES = {
    "the packages": "",
    "every public name": "[getattr(package, name) for package in (relight, splat2mesh) for name in dir(package)]",
}


@pytest.mark.parametrize("use", USES)
def test_importing_changes_nothing_in_the_process(use):
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("OMP_", "NUMBA_"))}
    clean["PYTHONPATH"] = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS.format(use=USES[use])], capture_output=True, text=True, timeout=200, env=clean
    )
    assert done.returncode == 0, done.stderr
    # What numba, open3d and others add to the filters of warnings as they are imported is theirs.
    changed = done.stdout.strip().replace("'filters'", "").replace(", ]", "]").replace("[, ", "[")
    assert changed == "[]" and "splat2mesh" not in done.stderr


def test_the_angles_of_a_range():
    assert cli.angles_from("0:90:45") == [0.0, 45.0, 90.0] and np.allclose(cli.angles_from("405"), [45.0])
