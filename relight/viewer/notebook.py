"""The session in a notebook or a browser, drawn here and streamed there by trame."""

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from splat2mesh.base.errors import InputError

from .controls import KEY_NAMES
from .waiting import Served
from .window import IDLE_SECONDS

if TYPE_CHECKING:
    from .window import Window

_MISSING = 'the session in a notebook or a browser needs trame: pip install "splat2mesh[web]"'


def show_widget(window: "Window") -> Any:
    """A widget that shows a Window in the notebook's cell; its loop runs beside the notebook's own."""
    try:
        from trame_pyvista.ui import get_viewer
    except ImportError:
        raise InputError(_MISSING) from None
    window.tick()
    window.plotter.notebook = True  # or PyVista shows nothing: the window was made without one
    widget = window.plotter.show(jupyter_backend="server", return_viewer=True, auto_close=False)
    window.loop = asyncio.get_running_loop().create_task(run_loop(window, get_viewer(window.plotter).update))
    return widget


def serve(window: "Window", place: Served, announce: Callable[[str], None] = lambda url: None) -> None:
    """Serve a Window to browsers until it is closed. announce: receives the address once it can be opened.

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
    server.cli.set_defaults(authKey=place.token, nosignalhandlers=True)  # we handle Ctrl-C
    server.state.trame__title = f"{window.session.name} \N{MIDDLE DOT} relight"
    symbols = {" ": "space"} | {label: symbol for symbol, label in KEY_NAMES.items()}  # the browser's label -> VTK's
    window.tick()

    def press(key: str) -> None:
        window.press_key(symbols.get(key, key.removeprefix("Arrow")))

    with VAppLayout(server) as layout:
        keys = html.Div(
            style="position:fixed;inset:0;outline:none;background:#141519",
            tabindex=0,
            keydown=(press, "[$event.key]"),
        )
        with keys:
            plotter_ui(window.plotter, server=server, mode="server", add_menu=False, default_server_rendering=True)
        del layout
    viewer = get_viewer(window.plotter)

    async def run() -> None:
        with _no_arguments():
            task = server.start(
                port=place.port, host="127.0.0.1", exec_mode="task", open_browser=False, show_connection_info=False
            )
        await server.ready
        announce(place.address)
        try:
            await run_loop(window, viewer.update)
        finally:
            with suppress(asyncio.InvalidStateError):  # it was stopped already
                await server.stop()
            task.cancel()

    asyncio.run(run())


@contextmanager
def _no_arguments() -> Iterator[None]:
    """Hide the arguments of the process, which trame would read as its own."""
    kept, sys.argv = sys.argv, sys.argv[:1]
    try:
        yield
    finally:
        sys.argv = kept


async def run_loop(window: "Window", push: Callable[[], Any]) -> None:
    """The window's loop for as long as it is open; `push` is called after every picture."""
    try:
        while window.is_open:
            if window.tick():
                push()
            await asyncio.sleep(IDLE_SECONDS)
    finally:
        window.close()
