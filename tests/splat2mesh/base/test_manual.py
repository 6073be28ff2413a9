"""Completions and manual pages know every option of both commands, and programs that read them accept them."""

import re
import shutil
import subprocess

import pytest

import relight.cli
import splat2mesh.cli
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


@pytest.mark.parametrize("command", PARSERS)
def test_bash_completes_what_was_begun(command):
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("there is no bash")
    script = completion(PARSERS[command](), "bash")
    script += f"COMP_WORDS=({command} --over); COMP_CWORD=1; _{command}; echo ${{COMPREPLY[@]}}"
    done = subprocess.run([bash, "-c", script], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["--overwrite"] and done.stderr == ""


@pytest.mark.parametrize("command", PARSERS)
def test_the_manual_has_every_option_and_no_line_that_troff_would_obey(command):
    parser = PARSERS[command]()
    page = manual(parser)
    for option in options_of(parser):
        assert "\\fB" + option.replace("-", "\\-") + "\\fR" in page, option
    macros = {line.split()[0] for line in page.splitlines() if line.startswith((".", "'"))}
    assert macros == {".TH", ".SH", ".TP", ".nf", ".fi"} and "%(" not in page


def test_the_commands_print_them(capsys):
    for arguments, start in ((["--man"], ".TH RELIGHT 1"), (["--completion", "bash"], "_relight() {")):
        with pytest.raises(SystemExit) as ended:
            relight.cli.main(arguments)
        assert not ended.value.code and capsys.readouterr().out.startswith(start)
