"""What commands print cannot steer a terminal, whatever files are called and hold, and never fails the command."""

import errno
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from relight.cli import main as relight
from splat2mesh.base import console
from splat2mesh.base.console import printable
from splat2mesh.base.errors import InputError
from splat2mesh.cli import main as splat2mesh

OPTIONS = console.Display()
HOSTILE = ["\x1b]0;owned\x07", "\x9b31m", "a\rb", "\u202eylp", "\x08\x08", "\udcff", "\u2028"]


@given(st.text())
def test_nothing_that_steers_gets_through_and_words_stay(text):
    shown = printable(text)
    assert all(letter.isprintable() or letter in " \u00a0\u200c\u200d\u3000" or letter.isspace() for letter in shown)
    assert not set(shown) & set("\x1b\r\n\x07\x08\x9b\u202a\u202b\u202d\u202e\u2066\u2067\u2068\u2028\u2029")
    shown.encode("utf-8")


def test_words_of_all_scripts_stay_as_they_are():
    for text in ("out/noon_0: 1,200 splats, 45°", "Größe 漢字 नमस्ते \u0645\u06cc\u200c\u062e", "👩\u200d🚀 a\u00a0b"):
        assert printable(text) == text


@pytest.mark.parametrize("main", [splat2mesh, relight])
@pytest.mark.parametrize("name", HOSTILE)
def test_names_of_files_are_spelled_out(main, name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([f"{name}.ply"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1 and error.rstrip("\n").isprintable()


def test_so_is_what_files_hold(tmp_path, capsys):
    path = tmp_path / "a.ply"
    path.write_bytes(b"ply\nformat \x1b[2Jbinary 1.0\nelement vertex 1\nproperty \x1b[31mfloat x\nend_header\n")
    assert splat2mesh([str(path), "--plan"]) == 2
    assert capsys.readouterr().err.rstrip("\n").isprintable()


def test_results_and_errors_of_work_are_spelled_out_too(capsys):
    assert console.run(lambda: (["a\x1b[2Jb", "c"], None), OPTIONS) == 0
    assert capsys.readouterr().out == "a\\x1b[2Jb\nc\n"

    def fail(error):
        raise error

    full = OSError(errno.ENOSPC, "No space left on device", "out/\x1b.png")
    assert console.run(lambda: fail(full), OPTIONS) == 1
    assert capsys.readouterr().err.startswith("error: out/\\x1b.png: No space left on device (")
    assert console.run(lambda: fail(InputError("a\u202eb")), OPTIONS) == 2
    assert capsys.readouterr().err == "error: a\\u202eb\n"


def test_a_full_disk_behind_stdout_is_one_line(monkeypatch, capsys):
    class Full:
        encoding = "ascii"

        def write(self, text):
            text.encode("ascii")

        def flush(self):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(console, "_drop_stdout", lambda: None)
    monkeypatch.setattr(sys, "stdout", Full())
    assert console.run(lambda: (["größe"], None), OPTIONS) == 1
    assert capsys.readouterr().err == "error: cannot write to the standard output: No space left on device\n"
