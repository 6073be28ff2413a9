"""Nothing is lost and nothing is left: killed runs, two runs at once, signals, and faults at every file operation."""

import os
import signal
import subprocess
import sys
import textwrap
import time
import warnings
from pathlib import Path

import pytest

from splat2mesh.base import leftovers
from splat2mesh.base.console import EXIT_INTERRUPTED
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.interrupts import Interrupted, shielded, stopping_in_order
from splat2mesh.base.outputs import check_output, staged_file, staged_folder

ROOT = Path(__file__).parents[3]

WRITER = """
    import os, sys, time
    from splat2mesh.base import console
    from splat2mesh.base.outputs import check_output, staged_folder

    def work():
        check_output("out", {overwrite}, "mark")
        with staged_folder("out", {overwrite}, "mark") as folder:
            (folder / "mark").write_text("new")
            print("writing", flush=True)
            {meanwhile}
        return [], None

    sys.exit(console.run(work, console.Display(quiet=True)))
"""


def writer(folder, meanwhile="time.sleep(60)", overwrite=True):
    """A command that writes out/ in a folder, started, and in the midst of it."""
    code = textwrap.dedent(WRITER).replace("{meanwhile}", meanwhile).replace("{overwrite}", str(overwrite))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    process = subprocess.Popen([sys.executable, "-c", code], cwd=folder, text=True, env=environment, **pipes)
    assert process.stdout.readline() == "writing\n", process.stderr.read()
    return process


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def old_output(folder):
    (folder / "out").mkdir()
    (folder / "out" / "mark").write_text("old")


def test_what_a_killed_run_left_is_named_and_removed_by_the_next(tmp_path):
    old_output(tmp_path)
    process = writer(tmp_path)
    process.kill()
    process.communicate()
    assert names(tmp_path) == [".out.unfinished", "out"]
    with pytest.warns(DataWarning, match=r"removed .*\.out\.unfinished, left by a run that was killed"):
        check_output(tmp_path / "other", False)
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "mark").read_text() == "old"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_stopped_run_leaves_what_was_there(tmp_path, number):
    old_output(tmp_path)
    process = writer(tmp_path)
    process.send_signal(number)
    process.send_signal(number)  # once more, into the clean-up
    _, error = process.communicate(timeout=60)
    assert process.returncode == EXIT_INTERRUPTED and error.startswith("error: ") and error.count("\n") == 1
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "mark").read_text() == "old"


def test_of_two_runs_at_once_the_second_is_refused_and_nothing_is_lost(tmp_path):
    first = writer(tmp_path)
    with pytest.raises(InputError, match="another run is writing"), staged_folder(tmp_path / "out"):
        pytest.fail("it must not begin")
    first.terminate()
    first.communicate(timeout=60)
    assert names(tmp_path) == []


def test_an_output_that_appears_while_the_work_runs_is_spared(tmp_path):
    with pytest.raises(InputError, match="exists already"), staged_folder(tmp_path / "out", overwrite=False):
        old_output(tmp_path)
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "mark").read_text() == "old"
    with (
        pytest.raises(InputError, match="holds no mark"),
        staged_folder(tmp_path / "mine", overwrite=True, marker="mark"),
    ):
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "letters").write_text("dear")
    assert names(tmp_path) == ["mine", "out"] and (tmp_path / "mine" / "letters").read_text() == "dear"


def crashed(folder, *, new, old, target):
    """What a run leaves that was killed between its two renames."""
    workspace = leftovers.workspace_of(folder / "out")
    workspace.mkdir()
    for name, there in (("new", new), ("old", old)):
        if there:
            (workspace / name).mkdir()
            (workspace / name / "mark").write_text(name)
    if target:
        (folder / "out").mkdir()
        (folder / "out" / "mark").write_text(target)


def test_what_had_been_moved_aside_is_put_back(tmp_path):
    crashed(tmp_path, new=True, old=True, target=None)
    with pytest.warns(DataWarning, match="put .*out back"):
        check_output(tmp_path / "out", True)
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "mark").read_text() == "old"


def test_what_was_replaced_is_removed(tmp_path):
    crashed(tmp_path, new=False, old=True, target="new")
    with pytest.warns(DataWarning, match="removed"):
        check_output(tmp_path / "out", True)
    assert names(tmp_path) == ["out"] and (tmp_path / "out" / "mark").read_text() == "new"


def test_a_folder_of_somebody_else_is_let_alone(tmp_path):
    (tmp_path / ".a.unfinished").mkdir()
    (tmp_path / ".a.unfinished" / "novel").write_text("chapter 1")
    (tmp_path / ".b.unfinished").symlink_to(tmp_path)
    check_output(tmp_path / "out", False)
    assert names(tmp_path) == [".a.unfinished", ".b.unfinished"]


@pytest.mark.parametrize(
    "fault", [OSError(28, "No space left on device"), OSError(5, "Input/output error"), Interrupted]
)
def test_a_fault_at_any_operation_loses_nothing(tmp_path, monkeypatch, fault):
    """Every call of the system that `outputs` makes fails in turn; after the next run all is in order."""
    done = False
    for number in range(200):
        folder = tmp_path / str(number)
        folder.mkdir()
        old_output(folder)
        calls = Failing(monkeypatch, number, fault, folder)
        try:
            with calls, staged_folder(folder / "out", True, "mark") as staging:
                (staging / "mark").write_text("new")
                calls.counting = True
        except (OSError, Interrupted, InputError):
            pass
        else:
            done = not calls.failed
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)
            check_output(folder / "out", True, "mark")
        assert names(folder) == ["out"], number
        assert (folder / "out" / "mark").read_text() in ("old", "new")
        if done:
            assert number > 5 and (folder / "out" / "mark").read_text() == "new"
            return
    pytest.fail("it never came to an end")


class Failing:
    """Within it, call number `number` of the system's file operations below a folder raises a fault, once."""

    def __init__(self, monkeypatch, number, fault, folder):
        self._patch, self._left, self._fault, self._folder = monkeypatch, number, fault, str(folder)
        self.failed, self.counting = False, True

    def __enter__(self):
        self._context = self._patch.context()
        patch = self._context.__enter__()
        for name in ("mkdir", "rename", "replace", "rmdir", "open", "unlink", "listdir"):
            patch.setattr(os, name, self._failing(getattr(os, name)))

    def __exit__(self, *details):
        return self._context.__exit__(*details)

    def _failing(self, call):
        def attempt(path, *arguments, **more):
            if self.counting and not self.failed and str(path).startswith(self._folder):
                if self._left == 0:
                    self.failed = True
                    raise self._fault
                self._left -= 1
            return call(path, *arguments, **more)

        return attempt


def test_names_that_no_disk_takes_are_refused_before_the_work(tmp_path):
    with pytest.raises(InputError, match="too long a name"):
        check_output(tmp_path / ("n" * 250), False)
    check_output(tmp_path / ("n" * 240), False)
    with staged_file(tmp_path / ("m" * 236 + ".png")) as file:
        assert file.suffix == ".png"
        file.touch()
    assert [len(name) for name in names(tmp_path)] == [240]


def test_a_signal_waits_for_the_end_of_a_shield():
    with pytest.raises(Interrupted), stopping_in_order():
        with shielded():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.01)
            passed = True
        pytest.fail("the signal arrived when the shield ended")
    assert passed
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_a_signal_that_was_ignored_stays_so():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping_in_order():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
