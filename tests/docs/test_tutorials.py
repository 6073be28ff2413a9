"""The tutorials: all show commands. Those for a client and for a city run, in order, on fewer splats."""

import re
import shlex
from pathlib import Path

import pytest
from ball_splats import solid_ball

import relight.cli
import scenes.__main__
import splat2mesh.cli
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort
from splat2mesh.tiles import survey

TUTORIALS = Path(__file__).parents[2] / "docs" / "tutorials"
SHOWN = "--serve", "--view"
"""Options that wait for a person."""


def commands(name):
    text = (TUTORIALS / f"{name}.md").read_text("utf-8")
    lines = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).splitlines()
    split = [shlex.split(line, comments=True) for line in lines]
    return [words for words in split if words and not {*SHOWN} & {*words}]


def test_every_tutorial_shows_commands():
    names = [path.stem for path in TUTORIALS.glob("*.md")]
    assert len(names) >= 8
    assert all(len(commands(name)) >= 2 for name in names)


# The two that take least; that the commands of the others are understood is tested in test_commands.py.
@pytest.mark.slow
def test_the_commands_of_a_page_for_a_client_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for effort in ("normal", "draft"):
        monkeypatch.setitem(EFFORTS, effort, Effort(views=12, pixels=96, cells=80))
    monkeypatch.setattr("relight.jobs.inputs.DEFAULT_TOLERANCE", 0.1)
    write_inria_ply(Path("garden.ply"), solid_ball(600))
    for program, *arguments in commands("client"):
        command = relight.cli.main if program == "relight" else splat2mesh.cli.main
        assert command(arguments) == 0, (program, arguments, capsys.readouterr().err)
    assert Path("garden/relit/sunset_0/relit.html").is_file() and Path("with_lamp/relit.html").is_file()


@pytest.mark.slow
def test_the_commands_of_a_city_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(survey.PIXELS, "draft", 40)
    mains = {"python": scenes.__main__.main, "relight": relight.cli.main, "splat2mesh": splat2mesh.cli.main}
    for program, *arguments in commands("city"):
        arguments = ["6000" if word == "100000" else word for word in arguments if word not in ("-m", "scenes")]
        assert mains[program](arguments) == 0, (program, arguments, capsys.readouterr().err)
    for light in ("sunset_0", "captured_0"):
        assert Path(f"town/scene/relit/{light}/sog/lod-meta.json").is_file()
    assert Path("town/scene/relit/sunset_0/tileset.json").is_file()
