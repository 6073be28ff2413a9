"""Completions and manual pages know every option of both commands, and programs that read them accept them."""

import re
import shutil
import subprocess

import pytest

import relight.cli
import splat2mesh.cli
from relight.arguments import BUILTIN as NAMED
from relight.light.skies import BUILTIN
from splat2mesh.base.manual import SHELLS, completion, manual

PARSERS = {"relight": relight.cli.parser, "splat2mesh": splat2mesh.cli.parser}


def options_of(parser):
    return [option for action in parser._actions for option in action.option_strings]


@pytest.mark.parametrize("command", PARSERS)
@pytest.mark.parametrize("shell", SHELLS)
def test_every_option_is_completed(command, shell):
    parser = PARSERS[command]()
    script = completion(parser, shell)
    for option in options_of(parser):
        shown = option if shell != "fish" else f"-l {option[2:]}" if option.startswith("--") else f"-s {option[1:]}"
        assert re.search(rf"(?<![\w-]){re.escape(shown)}(?![\w-])", script), option


BEGUN = [("{command} --over", ["--overwrite"]), ("{command} a.ply --completion z", ["zsh"])]
"""What is typed, and what completes its last word."""


@pytest.mark.parametrize("command", PARSERS)
@pytest.mark.parametrize(("line", "offered"), BEGUN)
def test_bash_completes_what_was_begun(command, line, offered):
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash")
    words = line.format(command=command).split()
    script = completion(PARSERS[command](), "bash")
    script += f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _shtab_{command}; echo ${{COMPREPLY[@]}}"
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == offered and done.stderr == ""


def test_bash_completes_options_after_one_that_takes_several_and_files_elsewhere():
    """shtab's own way offers either the one or the other."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash")
    script = completion(PARSERS["relight"](), "bash")
    script += "COMP_WORDS=(relight a.ply --format glb --rot); COMP_CWORD=4; _shtab_relight; echo ${COMPREPLY[@]}\n"
    script += "COMP_WORDS=(relight a); COMP_CWORD=1; _shtab_relight; echo ${#COMPREPLY[@]}; complete -p relight"
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines() == ["--rotate", "0", "complete -o default -F _shtab_relight relight"]


VALUES = {
    "--env s": ["studio", "sunset"],
    "--format glb sp": ["splat", "splat-glb"],
    "--method neu": ["neural-gash"],
    "--detail d": ["draft"],
    "--open c": ["ceiling"],
    "--env x": [],
}
"""Words typed after a splat, and the values that bash offers for the last one; without any it offers files."""


def test_bash_offers_the_words_that_options_take():
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash")
    script = completion(PARSERS["relight"](), "bash")
    for line in VALUES:
        words = ["relight", "a.ply", *line.split()]
        script += f"COMPREPLY=(); COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; _shtab_relight\n"
        script += 'echo "${COMPREPLY[@]}"\n'
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, timeout=60)
    assert [line.split() for line in done.stdout.splitlines()] == list(VALUES.values())


def test_words_that_are_offered_are_those_of_the_library():
    assert NAMED == tuple(BUILTIN)
    for name, parser in PARSERS.items():
        for action in parser()._actions:
            assert not hasattr(action, "offered") or all(action.offered), (name, action.dest)
    assert "\\fIceiling\\fR" in manual(PARSERS["relight"]())


def test_fish_completes_what_was_begun(tmp_path):
    fish = shutil.which("fish")
    if fish is None:
        pytest.skip("there is no fish")
    (tmp_path / "scene.ply").touch()
    for command in PARSERS:
        (tmp_path / "script").write_text(completion(PARSERS[command](), "fish"))
        for line, offered in [*BEGUN, ("{command} sce", ["scene.ply"])]:
            asked = f"source script; complete -C '{line.format(command=command)}'"
            done = subprocess.run([fish, "-c", asked], capture_output=True, text=True, timeout=60, cwd=tmp_path)
            assert [row.split("\t")[0] for row in done.stdout.splitlines()] == offered


@pytest.mark.parametrize("command", PARSERS)
def test_the_manual_has_every_option_and_no_line_that_troff_would_obey(command):
    parser = PARSERS[command]()
    page = manual(parser)
    for option in options_of(parser):
        assert "\\fB" + option.replace("-", "\\-") + "\\fR" in page, option
    macros = {line.split()[0] for line in page.splitlines() if line.startswith((".", "'"))}
    assert macros == {".TH", ".SH", ".TP", ".nf", ".fi"} and "%(" not in page


def test_the_commands_print_them(capsys):
    for arguments, start in (
        (["--man"], ".TH RELIGHT 1"),
        (["--completion", "bash"], "# AUTOMATICALLY GENERATED by "),
    ):
        with pytest.raises(SystemExit) as ended:
            relight.cli.main(arguments)
        assert not ended.value.code and capsys.readouterr().out.startswith(start)
