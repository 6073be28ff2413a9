"""What the tests share."""

import gc
import os
import signal
import sys
from pathlib import Path

# A shell that starts the tests in the background has them ignore Ctrl-C, nohup a hang-up; what they start would too.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)  # the tests go on; what they start has its own say

# Without Python's bytecode cache, each of a hundred processes would compile all modules again, for a second.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the commands set it, before NumPy reads it

import pytest
from shrunk import shrink

SLOW = (
    "splat2mesh/test_pipeline.py",
    "relight/planning/test_plan.py",
    "scenes/test_places.py",
    "relight/viewer/test_window.py",
    "splat2mesh/tiles/test_city.py",
    "relight/engine/test_relighter.py",
    "splat2mesh/test_layout.py",
    "relight/test_api.py",
    "splat2mesh/test_cli.py",
    "test_new_user.py",
    "examples/test_notebooks.py",
    "docs/test_site.py",
)
"""Files of half a minute and more. They come first, so that no process waits long for the other at the end; the first
two compile different kernels, and those that start processes of their own come when most is compiled."""


def pytest_collection_modifyitems(items):
    """What is slow first, file by file, where `--no-loadscope-reorder` has the processes keep this order."""
    folder = Path(__file__).parent
    rank = {folder / name: place for place, name in enumerate(SLOW)}
    items.sort(key=lambda item: rank.get(item.path, len(SLOW)))


def pytest_collection_finish():
    """What the libraries and the tests are made of stays: to look through all of it takes a third of a second each time
    that somebody asks for the collector."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def small_pictures():
    with pytest.MonkeyPatch.context() as patch:
        shrink(patch.setattr)
        yield patch


@pytest.fixture
def full_pictures(small_pictures):
    """For tests that compare files with those of a process of its own."""
    small_pictures.undo()
    yield
    shrink(small_pictures.setattr)


@pytest.fixture(scope="module")
def fewer_samples():
    """A third of the places for estimates of the capture's light: the same in less time."""
    from relight.albedo import samples

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "SAMPLES", 800)
        yield


@pytest.fixture
def vtk_is_silent(capfd):
    """Fail a test in which VTK logs an error, which it only writes to stderr."""
    yield
    said = capfd.readouterr().err
    assert "ERR|" not in said and "WARN|" not in said and "vtk" not in said.lower(), said


@pytest.fixture
def window(scene):
    """A small window off screen, with the `scene` of the test's own file."""
    from viewer_scenes import SIZE, session_of

    from relight.viewer.window import Window

    window = Window(session_of(scene, exposure=0.35), SIZE, off_screen=True)
    yield window
    window.close()
