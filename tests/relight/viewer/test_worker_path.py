"""The helper of a session imports nothing from the current folder, wherever it is started."""

import json
import os
import subprocess
import sys

from relight.viewer import worker


def test_a_module_in_the_current_folder_is_not_run(tmp_path, monkeypatch):
    for name in ("queue", "numpy", "json", "relight", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').write({name!r})\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", ".", *sys.path])
    command = worker.worker_command()
    assert "-I" in command and not {"", ".", str(tmp_path)} & set(command)
    at = command.index("-c") + 1
    command[at] = command[at].replace(
        "main()", "import queue, json; print(json.dumps([queue.__file__, json.__file__]))"
    )
    finished = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert not (tmp_path / "ran").exists()
    assert all(not path.startswith(str(tmp_path)) for path in json.loads(finished.stdout))


def test_the_current_folder_comes_last_where_it_was_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [os.getcwd(), *sys.path])
    assert worker.worker_command()[-1] == os.getcwd()
