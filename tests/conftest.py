"""What the tests of the session share."""

import pytest


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
