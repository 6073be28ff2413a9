"""Kernels compiled ahead: from a list, by a process that ends with the command, and never where it would not help."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import relight.cli
import splat2mesh.cli
from splat2mesh.base import ahead
from splat2mesh.base.ahead import compiled_ahead, listed, missing_seconds
from splat2mesh.base.ahead_worker import dispatcher_of
from splat2mesh.base.compiling import PACKAGES, cache_kind
from splat2mesh.base.kernel_types import type_of

pytest.importorskip("fcntl")

LISTS = splat2mesh.cli.KERNELS, relight.cli.KERNELS

ATLAS = "splat2mesh.texture.atlas"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """An empty folder for Numba, two cores, and Numba as it was afterwards."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", str(PACKAGES))
    monkeypatch.delenv(ahead.SWITCH, raising=False)
    monkeypatch.setattr(ahead, "_cores", lambda: 2)
    monkeypatch.setattr(Dispatcher, "compile", Dispatcher.compile)
    return tmp_path / "cache"


def row_of(whole, name):
    return next(row for row in whole["kernels"] if row[:2] == [ATLAS, name])


@pytest.fixture
def few(tmp_path):
    """A list of a kernel that there is not, one for every scene, and one for places."""
    whole = json.loads(LISTS[0].read_text())
    areas = row_of(whole, "_areas")
    kernels = [[ATLAS, "_no_such", [], 9, "every"], areas, [*row_of(whole, "_interpolate")[:4], "place"]]
    (tmp_path / "few.json").write_text(json.dumps({"types": whole["types"], "kernels": kernels}))
    return tmp_path / "few.json"


def begun(*lists, expect=""):
    """What `compiled_ahead` starts within its block, where nothing more is expected."""
    process = ahead._begun(lists)
    if process is not None:
        process.stdin.write(f"{expect}\n".encode())
        process.stdin.flush()
    return process


def wait_until(true, seconds=60.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize("path", LISTS, ids=lambda path: path.parent.name)
def test_every_listed_kernel_is_there_and_takes_so_many_arguments_of_types_that_there_are(path):
    kernels = listed(path)
    assert len(kernels) > 30
    for kernel in kernels:
        dispatcher = dispatcher_of(kernel.module, kernel.name)
        assert dispatcher.py_func.__code__.co_argcount == len(kernel.arguments), kernel
        for text in kernel.arguments:
            type_of(text)


def test_no_kernel_is_listed_twice():
    for path in LISTS:
        whole = [(kernel.module, kernel.name, json.dumps(kernel.arguments)) for kernel in listed(path)]
        assert len(set(whole)) == len(whole)


def test_the_process_fills_the_cache_and_ends_with_its_list(cache, few):
    process = begun(few)
    assert process.wait(60) == 0
    assert [path.name.split("-")[0] for path in cache.rglob("*.nbi")] == ["atlas._areas"]
    kind = cache_kind()
    assert missing_seconds([few], kind) == 9
    ahead._ended(process)


def test_what_is_expected_is_compiled_too(cache, few):
    with compiled_ahead(few):
        ahead.expect("place")
        wait_until(lambda: len(list(cache.rglob("*.nbc"))) == 2)
    ahead.expect("place")  # nobody hears


def test_what_was_compiled_ahead_is_read_and_gives_the_same(cache, few):
    code = "import sys, numpy as np; from splat2mesh.texture import atlas; areas = np.zeros(1); "
    code += "p, f = np.eye(3), np.array([[0, 1, 2]]); p.flags.writeable = f.flags.writeable = False; "
    code += "atlas._areas(p, f, areas); print(areas.tobytes().hex(), *atlas._areas.stats.cache_hits.values())"

    def printed():
        return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()

    begun(few).wait(60)
    (ahead_bytes, hits), files = printed(), sorted(cache.rglob("*.nbc"))
    assert hits == "1"
    for path in cache.rglob("*.nb?"):
        path.unlink()
    assert printed() == [ahead_bytes]
    assert sorted(cache.rglob("*.nbc")) == files


@pytest.mark.parametrize("error", [None, RuntimeError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_when_the_block_ends_in_whatever_way(cache, monkeypatch, error):
    started = []
    start = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *of, **more: started.append(start(*of, **more)) or started[-1])
    try:
        with compiled_ahead(*LISTS):
            assert started[0].poll() is None
            if error:
                raise error
    except BaseException as raised:
        assert type(raised) is error
    assert started[0].returncode is not None
    assert not list(cache.rglob("*.tmp.*"))


def test_it_ends_when_the_command_is_killed(cache):
    code = "import sys, time; from pathlib import Path; from splat2mesh.base import ahead; ahead._cores = lambda: 2; "
    code += "print(ahead._begun([Path(sys.argv[1])]).pid, flush=True); time.sleep(600)"
    with subprocess.Popen([sys.executable, "-c", code, str(LISTS[0])], stdout=subprocess.PIPE) as command:
        helper = int(command.stdout.readline())
        command.send_signal(signal.SIGKILL)
    wait_until(lambda: not alive(helper))


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_stop_of_the_terminal_does_not_reach_it(cache):
    process = begun(LISTS[0])
    assert os.getpgid(process.pid) != os.getpgid(0)
    ahead._ended(process)


@pytest.mark.parametrize("reason", ["one core", "switched off", "no list", "small", "compiled", "no cache", "no jit"])
def test_nothing_is_begun_where_it_would_not_help(cache, few, monkeypatch, reason):
    lists = [few]
    if reason == "one core":
        monkeypatch.setattr(ahead, "_cores", lambda: 1)
    elif reason == "switched off":
        monkeypatch.setenv(ahead.SWITCH, "0")
    elif reason == "no list":
        lists = []
    elif reason == "small":
        monkeypatch.setattr(ahead, "WORTH_SECONDS", 60.0)
    elif reason == "compiled":
        monkeypatch.setattr(ahead, "_compiled", lambda source, kind: {"_areas", "_no_such"})
    elif reason == "no cache":
        monkeypatch.setattr(ahead, "cache_kind", lambda: None)
    else:
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    assert begun(*lists) is None


def test_a_damaged_list_or_no_such_list_is_passed_over(cache, tmp_path):
    (tmp_path / "damaged.json").write_text("{")
    for name in ("damaged.json", "none.json"):
        with compiled_ahead(tmp_path / name):
            pass


def test_a_kernel_whose_source_is_newer_counts_as_missing(cache, few, monkeypatch):
    begun(few).wait(60)
    areas = next(kernel for kernel in listed(few) if kernel.name == "_areas")
    kind = cache_kind()
    there = missing_seconds([few], kind)
    for path in cache.rglob("*.nbi"):
        os.utime(path, (1, 1))
    assert missing_seconds([few], kind) == pytest.approx(there + areas.seconds)


def test_a_full_cache_is_seen_in_a_twentieth_of_a_second(cache, monkeypatch):
    monkeypatch.setattr(ahead, "WORTH_SECONDS", 1e9)
    spent = time.process_time()
    assert begun(*LISTS) is None
    assert time.process_time() - spent < 0.05
