"""The session in a notebook or a browser, drawn here and streamed there by trame."""

import asyncio

from splat2mesh.base.errors import InputError

from .window import IDLE_SECONDS

_MISSING = 'the session in a notebook needs trame: pip install "splat2mesh[view]" "trame-pyvista[jupyter]"'


def shown(window):
    """A widget that shows a Window in the notebook's cell; its loop runs beside the notebook's own."""
    try:
        from trame_pyvista.ui import get_viewer
    except ImportError:
        raise InputError(_MISSING) from None
    window.tick()
    widget = window.plotter.show(jupyter_backend="server", return_viewer=True, auto_close=False)
    window.loop = asyncio.get_running_loop().create_task(ticking(window, get_viewer(window.plotter).update))
    return widget


def serve(window, port=0, announce=lambda url: None):
    """Serve a Window to browsers until it is closed; `announce` is told the address. Only this machine can reach it.

    Raises InputError where trame is missing.
    """
    try:
        from trame.app import get_server
        from trame_pyvista.ui import get_viewer, plotter_ui
    except ImportError:
        raise InputError(_MISSING) from None
    from trame.ui.vuetify3 import VAppLayout
    from trame.widgets import html

    server = get_server("relight", client_type="vue3")
    window.tick()
    with VAppLayout(server) as layout:
        keys = html.Div(
            style="position:fixed;inset:0;outline:none;background:#141519",
            tabindex=0,
            keydown=(lambda key: window.press_key(_SYMBOLS.get(key, key)), "[$event.key]"),
        )
        with keys:
            plotter_ui(window.plotter, server=server, mode="server", add_menu=False, default_server_rendering=True)
        del layout
    viewer = get_viewer(window.plotter)

    async def run():
        task = server.start(
            port=port, host="127.0.0.1", exec_mode="task", open_browser=False, show_connection_info=False
        )
        await server.ready
        announce(f"http://127.0.0.1:{server.port}/")
        try:
            await ticking(window, viewer.update)
        finally:
            await server.stop()
            task.cancel()

    asyncio.run(run())


async def ticking(window, push):
    """The window's loop for as long as it is open; `push` is called after every picture."""
    try:
        while window.is_open:
            if window.tick():
                push()
            await asyncio.sleep(IDLE_SECONDS)
    finally:
        window.close()


_SYMBOLS = {
    "ArrowLeft": "Left",
    "ArrowRight": "Right",
    "ArrowUp": "Up",
    "ArrowDown": "Down",
    " ": "space",
    "-": "minus",
    "=": "equal",
}
"""VTK's key symbols by the names that browsers give the keys."""
