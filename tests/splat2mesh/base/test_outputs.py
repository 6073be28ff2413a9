"""What the commands share: outputs that appear whole or not at all, timed stages, one-line errors."""

import json
import os
import stat
import time
import warnings
from types import SimpleNamespace

import pytest

from splat2mesh.base import console
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.outputs import check_output, staged_folder
from splat2mesh.base.progress import Stages


def tree(folder):
    """Every file below a folder with its content, and every folder with None."""
    paths = folder.rglob("*")
    return {str(p.relative_to(folder)): p.read_text() if p.is_file() else None for p in paths}


def options(**changes):
    return console.Display(**changes)


def test_a_new_output_is_accepted_wherever_it_can_be_made(tmp_path):
    check_output(tmp_path / "new", overwrite=False)
    check_output(tmp_path / "a" / "b" / "new", overwrite=True)
    assert tree(tmp_path) == {}


@pytest.mark.parametrize("kind", ["file", "folder", "dangling link"])
def test_an_existing_output_needs_overwrite(tmp_path, kind):
    path = tmp_path / "out"
    {"file": path.touch, "folder": path.mkdir, "dangling link": lambda: path.symlink_to("nowhere")}[kind]()
    with pytest.raises(InputError, match=r"out exists already.*`output`.*`overwrite`"):
        check_output(path, overwrite=False)
    check_output(path, overwrite=True)


def test_with_a_marker_only_folders_of_that_kind_and_empty_ones_are_replaced(tmp_path):
    for name in ("ours", "theirs", "empty"):
        (tmp_path / name).mkdir()
    (tmp_path / "ours" / "scene.json").touch()
    (tmp_path / "theirs" / "thesis.tex").touch()
    (tmp_path / "file").touch()
    for name in ("ours", "empty", "new"):
        check_output(tmp_path / name, True, "scene.json")
    for name in ("theirs", "file"):
        with pytest.raises(InputError, match=r"holds no scene\.json"):
            check_output(tmp_path / name, True, "scene.json")


def test_an_output_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cannot write to .*file, where .*out would be: choose another `output`"):
        check_output(tmp_path / "file" / "out", overwrite=False)


def test_a_staged_folder_appears_only_when_the_block_is_done(tmp_path):
    target = tmp_path / "deep" / "out"
    with staged_folder(target) as staging:
        (staging / "a.txt").write_text("a")
        assert not target.exists()
        assert staging.stat().st_dev == tmp_path.stat().st_dev  # a rename, not a copy
    assert tree(tmp_path) == {"deep": None, "deep/out": None, "deep/out/a.txt": "a"}


def test_a_staged_folder_replaces_all_of_the_old_one(tmp_path):
    with staged_folder(tmp_path / "out") as staging:
        (staging / "old.txt").write_text("old")
    with staged_folder(tmp_path / "out") as staging:
        (staging / "new.txt").write_text("new")
        assert tree(tmp_path / "out") == {"old.txt": "old"}
    assert tree(tmp_path) == {"out": None, "out/new.txt": "new"}


def test_a_staged_folder_replaces_a_file_and_a_link_but_not_the_links_target(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "a.txt").write_text("a")
    (tmp_path / "link").symlink_to(tmp_path / "kept")
    (tmp_path / "file").write_text("file")
    for name in ("link", "file"):
        with staged_folder(tmp_path / name) as staging:
            (staging / "b.txt").write_text(name)
        assert tree(tmp_path / name) == {"b.txt": name} and not (tmp_path / name).is_symlink()
    assert tree(tmp_path / "kept") == {"a.txt": "a"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_the_old_folder_and_nothing_else(tmp_path, error):
    with staged_folder(tmp_path / "out") as staging:
        (staging / "old.txt").write_text("old")
    with pytest.raises(error), staged_folder(tmp_path / "out") as staging:
        (staging / "new.txt").write_text("new")
        raise error
    assert tree(tmp_path) == {"out": None, "out/old.txt": "old"}


def test_the_old_folder_comes_back_when_the_last_rename_fails(tmp_path, monkeypatch):
    with staged_folder(tmp_path / "out") as staging:
        (staging / "old.txt").write_text("old")
    rename = type(tmp_path).rename

    def refuse_the_new(self, target):
        if self.name == "new":
            raise OSError("no")
        return rename(self, target)

    monkeypatch.setattr(type(tmp_path), "rename", refuse_the_new)
    with pytest.raises(OSError, match="no"), staged_folder(tmp_path / "out"):
        pass
    assert tree(tmp_path) == {"out": None, "out/old.txt": "old"}


def test_the_folder_has_the_rights_that_the_user_asks_for(tmp_path):
    before = os.umask(0o027)
    try:
        with staged_folder(tmp_path / "out"):
            pass
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o750


def test_stages_are_timed_in_order_and_add_up():
    stages = Stages()
    with stages.stage("second", total=2) as advance:
        time.sleep(0.02)
        advance()
        advance(1)
    with stages.stage("first"):
        pass
    with stages.stage("second"):
        time.sleep(0.02)
    assert list(stages.seconds) == ["second", "first"]
    assert 0.04 <= stages.seconds["second"] < 1.0 and 0.0 <= stages.seconds["first"] < 0.02
    stages.close()


def test_a_stage_that_fails_is_timed_too():
    stages = Stages()
    with pytest.raises(KeyError), stages.stage("fails"):
        raise KeyError
    assert list(stages.seconds) == ["fails"]


@pytest.mark.parametrize("show", [False, True])
def test_progress_never_touches_stdout_and_is_silent_unless_shown(capfd, monkeypatch, show):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes the captured stream for a terminal
    stages = Stages(show=show)
    with stages.stage("looking", total=3) as advance:
        for _ in range(3):
            advance()
    stages.close()
    stages.close()  # once too often does no harm
    out, err = capfd.readouterr()
    assert out == ""
    assert ("looking" in err) == show


def test_a_result_is_text_or_one_json_object_or_nothing(capsys):
    def command():
        return ["first", "second"], {"vertices": 3}

    assert console.run(command, options()) == 0
    assert capsys.readouterr() == ("first\nsecond\n", "")
    assert console.run(command, options(json=True, quiet=True)) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == {"vertices": 3} and out.count("\n") == 1 and err == ""
    assert console.run(command, options(quiet=True)) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("error", "code", "line"),
    [
        (InputError("a.ply: two\n  lines"), 2, "error: a.ply: two lines\n"),
        (RuntimeError("bad luck"), 1, "error: RuntimeError: bad luck (run again with -v for the traceback)\n"),
        (MemoryError(), 1, "error: MemoryError (run again with -v for the traceback)\n"),
        (ValueError("not ours"), 1, "error: ValueError: not ours (run again with -v for the traceback)\n"),
        (KeyboardInterrupt(), 130, "error: interrupted\n"),
    ],
)
def test_errors_are_one_line_on_stderr_with_their_code(capsys, error, code, line):
    def command():
        raise error

    assert console.run(command, options()) == code
    assert capsys.readouterr() == ("", line)
    assert console.run(command, options(verbose=True, json=True)) == code
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("Traceback") and err.endswith(line)


def test_data_warnings_are_one_line_shown_once_and_other_warnings_are_hidden(capsys):
    def command():
        for _ in range(2):
            warnings.warn("dropped 3 splats", DataWarning, stacklevel=1)
        warnings.warn("of no interest to the user", DeprecationWarning, stacklevel=1)
        return ["done"], {}

    assert console.run(command, options()) == 0
    assert capsys.readouterr() == ("done\n", "warning: dropped 3 splats\n")


@pytest.mark.parametrize(
    ("terminal", "quiet", "wanted"), [(True, False, True), (True, True, False), (False, False, False)]
)
def test_progress_is_for_terminals_that_did_not_ask_for_quiet(monkeypatch, terminal, quiet, wanted):
    monkeypatch.setattr("sys.stderr", SimpleNamespace(isatty=lambda: terminal))
    assert options(quiet=quiet).progress is wanted


def test_a_staged_folder_may_keep_what_it_does_not_write(tmp_path):
    (tmp_path / "out" / "sub").mkdir(parents=True)
    for name in ("old.txt", "both.txt", "sub/old.txt", "sub/both.txt"):
        (tmp_path / "out" / name).write_text("old")
    (tmp_path / "out" / "link").symlink_to("old.txt")
    (tmp_path / "out" / "kind").mkdir()
    with staged_folder(tmp_path / "out", keep=True) as staging:
        (staging / "sub").mkdir()
        for name in ("both.txt", "sub/both.txt", "kind"):
            (staging / name).write_text("new")
    found = tree(tmp_path / "out")
    assert found.pop("link") == "old" and (tmp_path / "out" / "link").is_symlink()
    old = {"old.txt": "old", "sub/old.txt": "old"}
    assert found == {"sub": None, "both.txt": "new", "sub/both.txt": "new", "kind": "new"} | old


def test_what_is_kept_is_copied_where_there_are_no_hard_links(tmp_path, monkeypatch):
    def unable(*_, **__):
        raise PermissionError

    monkeypatch.setattr("os.link", unable)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old.txt").write_text("old")
    (tmp_path / "out" / "link").symlink_to("nowhere")
    with staged_folder(tmp_path / "out", keep=True) as staging:
        (staging / "new.txt").write_text("new")
    assert (tmp_path / "out" / "old.txt").read_text() == "old" and os.readlink(tmp_path / "out" / "link") == "nowhere"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"old.txt", "new.txt", "link"}


def test_a_folder_to_be_kept_is_as_it_was_when_the_block_fails(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old.txt").write_text("old")
    with pytest.raises(ZeroDivisionError), staged_folder(tmp_path / "out", keep=True) as staging:
        (staging / "old.txt").write_text("new")
        raise ZeroDivisionError
    assert tree(tmp_path) == {"out": None, "out/old.txt": "old"}
