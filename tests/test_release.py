"""What is released: the source distribution builds, its wheel holds the packages, whose foreign files are in NOTICE."""

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from splat2mesh import __version__

ROOT = Path(__file__).parents[1]
BUILD = "import sys, setuptools.build_meta as b; print(getattr(b, 'build_' + sys.argv[1])(sys.argv[2]))"
TOP = "pyproject.toml", "README.md", "LICENSE", "NOTICE", "MANIFEST.in", "CHANGELOG.md", "CITATION.cff"


def in_tree(package):
    """Files of a package, as paths from the root."""
    files = (path for path in (ROOT / package).rglob("*") if path.is_file() and path.parent.name != "__pycache__")
    return {path.relative_to(ROOT).as_posix() for path in files}


OURS = in_tree("splat2mesh") | in_tree("relight")


def built(kind, source, out):
    done = subprocess.run([sys.executable, "-c", BUILD, kind, str(out)], cwd=source, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return out / done.stdout.split()[-1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel that a copy of the tree gives through its source distribution."""
    pytest.importorskip("setuptools", minversion="77")
    place = tmp_path_factory.mktemp("release")
    copy = place / "tree"
    copy.mkdir()
    for name in TOP:
        shutil.copy(ROOT / name, copy)
    for package in ("splat2mesh", "relight"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    source = built("sdist", copy, place)
    with tarfile.open(source) as archive:
        archive.extractall(place, filter="data") if hasattr(tarfile, "data_filter") else archive.extractall(place)
    return built("wheel", place / source.name.removesuffix(".tar.gz"), place)


def test_the_wheel_holds_every_file_of_the_packages_and_nothing_else(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    info = f"splat2mesh-{__version__}.dist-info"
    assert {name for name in names if not name.startswith(info)} == OURS
    licences = {name.removeprefix(f"{info}/licenses/") for name in names if name.startswith(f"{info}/licenses/")}
    assert licences == {"LICENSE", "NOTICE"} | {name for name in OURS if Path(name).name.startswith("LICENSE")}


def test_the_installed_commands_find_their_files(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    code = "import relight, sys; assert relight.__file__.startswith(sys.argv[1]); relight.Environment.load('noon')"
    code += "; from importlib.resources import files"
    code += "; assert files('relight.live').joinpath('web/viewer/index.js').is_file()"
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        cwd=tmp_path,
        env={"PYTHONPATH": str(tmp_path), "PATH": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_one_version_everywhere():
    assert f'version = "{__version__}"' in (ROOT / "pyproject.toml").read_text("utf-8")
    assert f"version: {__version__}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)[0].split()[0] in (
        __version__,
        "Unreleased",
    )


def test_notice_names_every_file_that_is_no_source_of_ours():
    """Code of others and data: what is neither Python, text, licence, nor the page's own code."""
    notice = set(re.findall(r"^[\w/.-]+$", (ROOT / "NOTICE").read_text("utf-8"), re.MULTILINE))
    own = re.compile(r".*(\.pyi?|\.md|/py\.typed|/LICENSE[\w-]*)|relight/live/web/[\w-]+\.(js|css)")
    texts = {".py", ".md", ".mjs", ".html", ".cs", ".hlsl", ".shader", ".gd", ".gdshader"}
    data = {name for name in in_tree("integrations") if Path(name).suffix not in texts}
    assert {name for name in OURS if not own.fullmatch(name)} | data == notice


def test_every_vendored_file_has_its_licence_beside_it():
    for name in ("relight/live/web/viewer/LICENSE", "relight/live/web/viewer/LICENSE-playcanvas"):
        assert "Permission is hereby granted" in (ROOT / name).read_text("utf-8")
    assert "3-clause BSD" in (ROOT / "relight/light/data/LICENSE").read_text("utf-8")
