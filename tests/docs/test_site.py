"""The documentation as a site: it builds without a warning, its pages hold what they are called, its commands run."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from ball_splats import solid_ball

import relight
import relight.cli
import splat2mesh
import splat2mesh.cli
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The site, built with warnings as errors."""
    pytest.importorskip("mkdocs")
    pytest.importorskip("material")
    pytest.importorskip("mkdocstrings")
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--strict",
        "-q",
        "-f",
        str(ROOT / "mkdocs.yml"),
        "-d",
        str(folder),
    ]
    built = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("index.html", "relight garden.ply --env sunset"),
        ("python/index.html", "relight_scene"),
        ("options/index.html", "--max-chunk-vertices"),
        ("limits/index.html", "Highlights move"),
        ("integrations/blender/index.html", "Install from Disk"),
        ("reference/relight/index.html", "relight.Relighter"),
        ("reference/splat2mesh/index.html", "Make a scene from a trained splat"),
        ("models/neural-gash/index.html", "neural-gash"),
    ],
)
def test_a_page_holds_what_it_is_called(site, page, words):
    text = re.sub(r"<[^>]+>", "", (site / page).read_text("utf-8"))
    assert words in text


def test_pictures_of_the_readme_are_in_the_site(site):
    shown = re.findall(r'<img[^>]+src="([^":]+)"', (site / "index.html").read_text("utf-8"))
    assert shown and all((site / name).is_file() for name in shown)


@pytest.mark.parametrize("package", [splat2mesh, relight])
def test_the_reference_has_what_is_public(package):
    text = (ROOT / "docs" / "reference" / f"{package.__name__}.md").read_text("utf-8")
    listed = re.findall(rf"^::: {package.__name__}\.(\w+)$", text, re.MULTILINE)
    elsewhere = {"__version__"} | ({"Scene"} if package is relight else set())  # splat2mesh documents Scene
    assert sorted(listed) == sorted(set(package.__all__) - elsewhere)


def test_the_commands_of_the_first_hour_run(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "first_hour.md").read_text("utf-8")
    lines = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).splitlines()
    commands = [shlex.split(line, comments=True) for line in lines if line.startswith(("relight ", "splat2mesh "))]
    assert len(commands) >= 7
    monkeypatch.chdir(tmp_path)
    for name in ("normal", "draft"):
        monkeypatch.setitem(EFFORTS, name, Effort(views=12, pixels=96, cells=80))
    monkeypatch.setattr("relight.jobs.inputs.DEFAULT_TOLERANCE", 0.1)
    write_inria_ply(Path("garden.ply"), solid_ball(600))
    for name, *arguments in commands:
        command = relight.cli.main if name == "relight" else splat2mesh.cli.main
        assert command(arguments) == 0, (name, arguments, capsys.readouterr().err)
    assert Path("garden/relit/sunset_0/relit_splat.ply").is_file() and Path("turned/sheet.png").is_file()
