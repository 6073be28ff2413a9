"""A first look at a splat, in a window or in a browser, until its session takes the place.

A process of its own shows it, since meshing keeps this one busy: `python -m relight.viewer.waiting PNG`, which ends
with its input.
"""

import http.server
import os
import secrets
import socket
import subprocess
import sys
import tempfile
import threading
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..output.images import write_png
from ..output.kinds import PICTURE_SIZE

LINE = "A first look. The surface is being meshed and lit; the session opens when it is ready."

FIRST_LOOK = "X-First-Look"
"""Header of the answer that the page of the session does not have."""

_PAGE = """<!doctype html><meta charset="utf-8"><title>relight: a first look</title>
<style>body {{ margin: 0; background: #212123; color: #ddd; font: 16px sans-serif; text-align: center }}
img {{ max-width: 100vw; max-height: 90vh }}</style>
<p>{line}</p><img alt="the first look" src="data:image/png;base64,{picture}">
<script>setInterval(() => fetch(location).then(
  answer => answer.ok && !answer.headers.get("{header}") && location.reload(), () => {{}}), 1000)</script>
"""


class Served(NamedTuple):
    """Where a session is served: only this machine can reach it, and only with the token."""

    port: int
    token: str

    @classmethod
    def at(cls, port: int) -> "Served":
        """On this port, or on any free one for 0. Raises InputError for one that another program has."""
        with socket.socket() as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                tried.bind(("127.0.0.1", port))
            except OSError as error:
                raise InputError(f"port {port} cannot be used ({error.strerror}): choose another, or none") from None
            return cls(tried.getsockname()[1], secrets.token_urlsafe())

    @property
    def address(self) -> str:
        """The URL to open."""
        return f"http://127.0.0.1:{self.port}/?secret={self.token}"


@contextmanager
def first_look(
    picture: NDArray[np.uint8], place: Served | None = None, announce: Callable[[str], None] = lambda url: None
) -> Iterator[None]:
    """Show a picture (H, W, 3) in a window, where there is a display, or serve it where the session will be served.

    announce: receives the address.
    """
    with tempfile.TemporaryDirectory() as work:
        path = Path(work) / "first.png"
        write_png(path, picture)
        words = () if place is None else (str(place.port), place.token)
        command = [sys.executable, "-m", __name__, str(path), *words]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            try:
                if place is not None:
                    announce(place.address)
                yield
            finally:
                process.terminate()


class _FirstLookHandler(http.server.BaseHTTPRequestHandler):
    """The page of a first look, for who has the token."""

    def __init__(self, page: bytes, token: str, *arguments: object) -> None:
        self._page, self._token = page, token
        super().__init__(*arguments)  # type: ignore[arg-type]

    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        if self.path != f"/?secret={self._token}":
            self.send_error(403)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header(FIRST_LOOK, "1")
        self.end_headers()
        self.wfile.write(self._page)


def _serve(path: Path, port: str, token: str) -> None:
    page = _PAGE.format(line=LINE, picture=b64encode(path.read_bytes()).decode(), header=FIRST_LOOK).encode()
    http.server.ThreadingHTTPServer(("127.0.0.1", int(port)), partial(_FirstLookHandler, page, token)).serve_forever()


def _open_window(path: Path) -> None:
    import pyvista

    plotter = pyvista.Plotter(window_size=list(PICTURE_SIZE), title="relight: a first look")
    plotter.add_background_image(str(path))
    plotter.add_text(LINE, position="lower_left", font_size=9, color="white", shadow=True)
    plotter.show()


def _end_with_input() -> None:
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    threading.Thread(target=_end_with_input, daemon=True).start()
    (_serve if sys.argv[2:] else _open_window)(Path(sys.argv[1]), *sys.argv[2:])
