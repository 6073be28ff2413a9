"""The first hour of a new user, played through the installed wheel in a fresh environment, away from the checkout."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from ball_splats import solid_ball
from browser import Browser, chromium

from splat2mesh.base.version import VERSION
from splat2mesh.splats.formats import read_splats, write_inria_ply

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PACKAGES = "splat2mesh", "relight"

SMALL = "--albedo", "captured", "--method", "analytic", "--tolerance", "10%"
"""Light in no time, for the steps that only show that there is some."""

HASTE = "TESTS_IN_HASTE"
"""Environment variable of processes that convert in haste, whatever the detail; all else of them is the wheel's."""

IN_HASTE = """
import splat2mesh.pipeline
from shrunk import shrink
from splat2mesh.surface.extract import EFFORTS, Effort
shrink(setattr)
splat2mesh.pipeline.DEFAULT_VERTICES = 5000
for detail in EFFORTS:
    EFFORTS[detail] = Effort(views=12, pixels=96, cells=80)
"""


@pytest.fixture(scope="module")
def bin_folder(tmp_path_factory):
    """The commands of an environment into which the wheel was installed; what it needs is that of this Python."""
    pytest.importorskip("setuptools", minversion="77", reason="builds the wheel")
    folder = tmp_path_factory.mktemp("wheel")
    source, env = folder / "source", folder / "env"
    for name in PACKAGES:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = "from setuptools import build_meta; build_meta.build_wheel('.')"
    _done([sys.executable, "-c", build], cwd=source)
    (wheel,) = source.glob("*.whl")
    assert wheel.stat().st_size < 8e6
    _done([sys.executable, "-m", "venv", "--without-pip", env])
    python = env / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps", "--no-index", wheel]
    _done(install)
    (site,) = (env / "lib").glob("python*/site-packages")
    paths = dict.fromkeys(sysconfig.get_path(name) for name in ("purelib", "platlib"))
    (site / "needs.pth").write_text("\n".join(paths) + "\n")
    shutil.copy(ROOT / "tests" / "support" / "shrunk.py", site)
    (site / "in_haste.py").write_text(IN_HASTE)
    (site / "zz_haste.pth").write_text(f"import os; os.environ.get({HASTE!r}) and __import__('in_haste')\n")
    _compiled_before(site)
    return env / "bin"


def _done(command, **options):
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}  # pip looks for packages there
    done = subprocess.run(command, capture_output=True, text=True, env=env, **options)
    assert done.returncode == 0, done.stdout + done.stderr


def _compiled_before(site):
    """Give the environment what this checkout has compiled already: the same code, which would take a minute more."""
    for source in (path for name in PACKAGES for path in (ROOT / name).glob("**/*.py")):
        kept = list((source.parent / "__pycache__").glob(f"{source.stem}.*.nb?"))
        if kept:
            installed = site / source.relative_to(ROOT)
            assert installed.read_bytes() == source.read_bytes()
            times = source.stat()
            os.utime(installed, ns=(times.st_atime_ns, times.st_mtime_ns))
            (installed.parent / "__pycache__").mkdir(exist_ok=True)
            for path in kept:
                shutil.copy2(path, installed.parent / "__pycache__")


@pytest.fixture(scope="module")
def home(tmp_path_factory, bin_folder):
    """The user's folder, with a splat and the scene that one command made of it."""
    folder = tmp_path_factory.mktemp("home")
    write_inria_ply(folder / "garden.ply", solid_ball(1500))
    return folder


@pytest.fixture(scope="module")
def surroundings(bin_folder):
    """Environment variables of a process that knows nothing of the checkout."""
    ours = "PYTHON", "PYTEST", "COV", "NUMBA_CACHE", "VTK_"  # which kind of window a test without a display chose
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    return kept | {"PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}"}


@pytest.fixture(scope="module")
def run(home, surroundings):
    """Runs a command there, which must end with the exit code: (stdout, stderr)."""

    def run(*command, code=0, haste=False):
        env = surroundings | ({HASTE: "1"} if haste else {})
        done = subprocess.run(command, cwd=home, env=env, capture_output=True, text=True, timeout=600)
        assert done.returncode == code, (command, done.stdout, done.stderr)
        return done.stdout, done.stderr

    return run


@pytest.fixture(scope="module")
def first(run, home):
    """What the first command says."""
    return run("relight", "garden.ply", "--env", "sunset", haste=True)


def test_what_runs_is_the_wheel(run, bin_folder):
    where = "import relight, splat2mesh; print(splat2mesh.__file__, relight.__file__, splat2mesh.__version__)"
    out, _ = run("python", "-c", where)
    *files, version = out.split()
    assert all(Path(file).is_relative_to(bin_folder.parent) for file in files) and version == VERSION
    for name in PACKAGES:
        assert run(name, "--version")[0] == run("python", "-m", name, "--version")[0] == f"{name} {VERSION}\n"
        assert "examples:" in run(name, "--help")[0]


def test_one_command_makes_a_relit_splat_and_names_the_next_step(first, home):
    out, err = first
    assert "Traceback" not in err and "up: assumed -y" in out
    folder = home / "garden" / "relit" / "sunset_0"
    assert {path.name for path in folder.iterdir()} == {"relit.glb", "relit_splat.ply", "preview.png", "report.json"}
    assert len(read_splats(folder / "relit_splat.ply")) == 1500
    report = json.loads((folder / "report.json").read_text())
    assert report["version"] == VERSION and report["preview"]["shows"] == "splat"


def test_other_formats_of_the_same_light_are_added_and_another_light_stands_beside_it(first, run, home):
    """The commands of the README, one after the other, with no --overwrite."""
    folder = home / "garden" / "relit" / "sunset_0"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    for kinds in (["web"], ["splat"], ["npy", "albedo-splat", "splat-glb"]):
        run("relight", "garden", "--env", "sunset", "--format", *kinds, haste=True)
    after = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    added = {"relit.html", "radiance.npy", "albedo_splat.ply", "albedo_splat.collision.glb", "proxy.glb"}
    assert after.keys() - before.keys() == {*added, "relit_splat.glb"}
    assert all(after[name] == before[name] for name in ("relit.glb", "relit_splat.ply", "preview.png"))
    assert {*json.loads(after["report.json"])["files"], "report.json"} == after.keys()
    run("relight", "garden", "--env", "sunset", "--rotate", "45", "--format", "png", haste=True)
    out, err = run("relight", "garden", "--env", "sunset", "--exposure", "1", code=2, haste=True)
    assert out == "" and err.count("\n") == 1 and "--exposure not given, now 1" in err and "--overwrite" in err
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == after


def test_the_notebook_of_a_splat_runs_in_the_environment_of_the_wheel(run, home):
    pytest.importorskip("IPython", reason="shows pictures in notebooks")
    cells = json.loads((ROOT / "examples" / "relight_a_splat.ipynb").read_text("utf-8"))["cells"]
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    (home / "notebook.py").write_text(re.sub(r"^COUNT = .*$", "COUNT = 6_000", code, flags=re.MULTILINE))
    run("python", "notebook.py", haste=True)
    assert (home / "relight_a_splat" / "around" / "sheet.png").is_file()
    assert len(read_splats(home / "relight_a_splat" / "sunset.ply")) == 6000


@pytest.fixture(scope="module")
def meshed(run):
    """What the other command says, which makes the scene `small`."""
    return run("splat2mesh", "garden.ply", "-o", "small", "--detail", "draft", "--vertices", "800", haste=True)


def test_both_commands_one_after_the_other(meshed, run, home):
    following = next(line.split("next: ")[1] for line in meshed[0].splitlines() if "next: " in line)
    assert following == "relight small --env sunset"
    run(*following.split(), *SMALL, "--format", "npy,png")
    assert np.isfinite(np.load(home / "small" / "relit" / "sunset_0" / "radiance.npy")).all()
    turned = "--env", "noon", "--rotate", "45", "--format", "npy"
    out, _ = run("python", "-m", "relight", "small", *turned, "--json", *SMALL)
    assert json.loads(out)["outputs"] == ["small/relit/noon_45"]


def test_a_slip_is_one_line_and_leaves_nothing(first, run, home):
    before = sorted(home.rglob("*"))
    for command, expected in (
        (["relight", "garden", "--env", "sunst"], "did you mean sunset?"),
        (["relight", "gadren"], "no such scene folder"),
        (["splat2mesh", "garden.ply", "-o", "garden"], "--overwrite"),
    ):
        out, err = run(*command, code=2)
        assert out == "" and err.count("\n") == 1 and expected in err
    assert sorted(home.rglob("*")) == before


@pytest.mark.parametrize("name", PACKAGES)
def test_the_shell_completes(run, name):
    for shell in ("bash", "zsh", "fish"):
        assert "overwrite" in run(name, "--completion", shell)[0]
    typed = f'eval "$({name} --completion bash)"; COMP_WORDS=({name} --over); COMP_CWORD=1; _shtab_{name}'
    assert run("bash", "-c", typed + '; echo "${COMPREPLY[@]}"')[0] == "--overwrite\n"


@pytest.fixture
def served(home, surroundings):
    """Starts `relight ... --serve` and returns the process and the address that it prints."""
    running = []

    def served(*arguments):
        command = ["relight", *arguments]
        process = subprocess.Popen(command, cwd=home, env=surroundings, stderr=subprocess.PIPE, text=True)
        running.append(process)
        lines = []
        for line in process.stderr:
            lines.append(line)
            if line.startswith("open http://127.0.0.1:"):
                return process, line.split()[1]
        raise AssertionError("".join(lines))

    yield served
    for process in running:
        process.kill()
        process.wait()


def test_the_session_is_served_until_it_is_interrupted(meshed, served):
    pytest.importorskip("trame_pyvista", reason="the extra web is not installed")
    process, url = served("small", "--serve", *SMALL)
    with urllib.request.urlopen(url, timeout=60) as page:
        assert b"<html" in page.read().lower()
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 130


@pytest.mark.skipif(chromium() is None, reason="chromium is not installed")
def test_the_page_opens_by_a_double_click(meshed, run, home):
    run("relight", "small", "--env", "sunset", "--format", "web", "-o", "page", haste=True)
    with Browser(f"file://{home}/page/relit.html#renderer=webgl", (480, 360)) as browser:
        browser.wait("window.relight && relight.drawn")
        assert browser.said == [] and browser.picture().std() > 10


def test_the_window_opens_and_closes(meshed, home, surroundings):
    for program in ("Xvfb", "xdotool"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed")
    pytest.importorskip("pyvista", reason="the extra view is not installed")
    read, write = os.pipe()
    screen = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x1024x24"], pass_fds=[write], stderr=subprocess.DEVNULL
    )
    try:
        os.close(write)
        display = {"DISPLAY": f":{os.read(read, 16).decode().strip()}"}
        window = subprocess.Popen(["relight", "small", "--view", *SMALL], cwd=home, env=surroundings | display)
        find = ["xdotool", "search", "--sync", "--onlyvisible", "--name", "relight", "key", "q"]
        subprocess.run(find, env=surroundings | display, check=True, timeout=120)
        assert window.wait(60) == 0
    finally:
        os.close(read)
        screen.kill()
        screen.wait()
