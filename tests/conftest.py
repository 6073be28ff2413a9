"""What the tests share."""

import os
import signal

# A shell that starts the tests in the background has them ignore Ctrl-C, nohup a hang-up; what they start would too.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)  # the tests go on; what they start has its own say

# As the commands set them, before any library reads them: waiting threads must not take the cores of other tests.
os.environ.setdefault("NUMBA_THREADING_LAYER_PRIORITY", "omp tbb workqueue")
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest


@pytest.fixture(scope="session", autouse=True)
def small_pictures():
    """Pictures that commands write beside their results take a second each in full size; no test looks at them. To
    find out where a capture stood takes 640,000 rays, of which a twelfth tell a room from an object as well."""
    with pytest.MonkeyPatch.context() as patch:
        shrink(patch)
        yield patch


def shrink(patch):
    import relight.output.catcher
    import relight.output.results
    import relight.writing
    import splat2mesh.render.beside
    import splat2mesh.views.standpoints

    patch.setattr(splat2mesh.render.beside, "WIDTH", 96)
    patch.setattr(splat2mesh.views.standpoints, "PLACES", 500)
    patch.setattr(splat2mesh.views.standpoints, "RAYS", 96)
    patch.setattr(relight.output.catcher, "SIDE", 32)
    patch.setattr(relight.output.catcher, "DIRECTIONS", 64)
    patch.setattr(relight.output.results, "PICTURE_SIZE", (96, 72))
    patch.setattr(relight.writing, "PICTURE_SIZE", (96, 72))


@pytest.fixture
def full_pictures(small_pictures):
    """For tests that compare files with those of a process of its own."""
    small_pictures.undo()
    yield
    shrink(small_pictures)


@pytest.fixture(scope="module")
def fewer_samples():
    """A third of the places and a quarter of the suns for estimates of the capture's light: the same in less time."""
    from relight.albedo import samples, sun

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "SAMPLES", 800)
        patch.setattr(sun, "CANDIDATES", 2048)
        yield


@pytest.fixture
def vtk_is_silent(capfd):
    """No test that uses this may make VTK complain: it tells errors to stderr alone."""
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
