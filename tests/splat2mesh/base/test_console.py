"""What commands print cannot steer a terminal, whatever files are called and hold, and never fails the command."""

import errno
import subprocess
import sys

import pytest
from ball_splats import solid_ball
from hypothesis import given
from hypothesis import strategies as st

from relight.cli import main as relight
from splat2mesh.base import console
from splat2mesh.base.console import printable
from splat2mesh.base.errors import InputError
from splat2mesh.cli import main as splat2mesh
from splat2mesh.splats.formats import write_splats

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


CLOSED = """
import os, sys
for number in {numbers}:
    os.close(number)
os.execv(sys.executable, [sys.executable, "-m", *{words}])
"""
PRINTED = """
import os, subprocess, sys
from splat2mesh.base.console import open_streams, quiet_libraries
open_streams()
kept = os.open({kept!r}, os.O_WRONLY | os.O_CREAT)
assert kept > 2
with quiet_libraries():
    print("a", flush=True), print("b", file=sys.stderr, flush=True), sys.stdin.read(1)
subprocess.run("echo c; echo d >&2", shell=True, check=True)
sys.exit(7)
"""


@pytest.mark.parametrize("numbers", [(0,), (1,), (2,), (0, 1, 2)])
def test_streams_that_the_parent_closed_change_neither_work_nor_exit_code(numbers, tmp_path):
    def finished(words):
        code = CLOSED.format(numbers=numbers, words=words)
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)

    write_splats(tmp_path / "a.ply", solid_ball())
    done = finished(["splat2mesh", str(tmp_path / "a.ply"), "--plan"])
    assert done.returncode == 0 and ("views" in done.stdout) == (1 not in numbers)
    done = finished(["relight", str(tmp_path / "b.ply")])
    assert done.returncode == 2 and ("error: " in done.stderr) == (2 not in numbers)
    assert "Traceback" not in done.stderr
    kept = tmp_path / "kept"
    (tmp_path / "printing.py").write_text(PRINTED.format(kept=str(kept)))
    code = CLOSED.format(numbers=numbers, words=[]).replace('"-m"', repr(str(tmp_path / "printing.py")))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert (done.returncode, kept.read_bytes()) == (7, b"")
    assert done.stdout == ("" if 1 in numbers else "a\nc\n") and done.stderr == ("" if 2 in numbers else "b\nd\n")


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
