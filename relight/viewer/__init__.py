"""An interactive session: a window in which to turn, compare and switch the light.

    from relight.viewer import view
    view(scene, "sunset")

Modules: `session` state and light, `worker` and `lighting` the heavy work in a process of its own, `modes` what
colours the surface, `controls` the keys, `window`, `stage`, `panel` and `camera` what VTK draws, `recording` films.
"""

from splat2mesh.base.errors import InputError

__all__ = ["record_turntable", "view"]


def view(
    scene,  # splat2mesh.Scene
    environment="studio",  # Environment, or what Environment.load takes
    *,
    albedos=None,  # dict of name -> (V, 3) linear or None for white; the first is shown first
    environments_folder=None,  # its .exr and .hdr files can be chosen too
    screenshot=None,  # PNG to write instead of opening a window, with the panel
    off_screen=False,  # no window: returns the Window for a loop of its own
    size=None,  # width, height
    exposure=None,  # display value per unit of radiance
    tolerance=0.02,
    state=None,  # dict of fields of `session.State` to start with
    **options,  # of Relighter: method, effects, seed, bands, rays
):
    """Open the session. Returns when it is closed; in a notebook at once, with what shows it.

    With `screenshot` no window opens: the picture is written when its light is complete. Raises InputError for
    input that cannot be used, a missing PyVista and a missing display.
    """
    from .window import SIZE, Window, in_notebook, load_pyvista

    notebook = in_notebook() and not (screenshot or off_screen)
    off_screen = bool(off_screen or screenshot or notebook)
    load_pyvista(off_screen)
    session = _session(scene, environment, albedos, environments_folder, exposure, tolerance, state, options)
    try:
        window = Window(session, size or SIZE, off_screen)
        if notebook:
            from .notebook import shown

            return shown(window)
        if screenshot:
            from ..output.mesh_files import write_png

            window.finish()
            write_png(screenshot, window.picture())
        elif off_screen:
            return window
        else:
            window.run()
    except BaseException:
        session.close()
        raise
    window.close()


def record_turntable(
    path,  # .gif, or .mp4 where imageio-ffmpeg is installed
    scene,
    environment="studio",
    *,
    frames=72,
    what="light",  # or "camera": what turns
    panel=False,  # whether the panel is in the film
    overwrite=False,
    albedos=None,
    size=(960, 720),
    exposure=None,
    tolerance=0.02,
    state=None,
    **options,
):
    """Film a full turn off screen, every picture with its suns and bounces. Arguments as of `view`.

    Raises InputError as `view` does, and for a film that cannot be written.
    """
    import time

    from .recording import check_film
    from .window import IDLE_SECONDS, Window, load_pyvista

    check_film(path, frames, what, overwrite)
    load_pyvista(True)
    session = _session(scene, environment, albedos, None, exposure, tolerance, state, options)
    try:
        window = Window(session, size, off_screen=True)
        window.record(path, frames=frames, what=what, panel=panel, overwrite=overwrite)
        while window.recording:
            if not window.tick():
                time.sleep(IDLE_SECONDS)
        if window.note.startswith("recording dropped"):
            raise InputError(window.note)
    finally:
        session.close()
    window.close()


def _session(scene, environment, albedos, folder, exposure, tolerance, state, options):
    from .session import Session, choices_of

    session = Session(scene, choices_of(environment, folder), albedos, exposure, tolerance, **options)
    if state:
        session.change(**state)
    return session
