"""Serve a folder with a page on this machine only: browsers do not let a page read local files beside it."""

import io
import os
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import BinaryIO

from splat2mesh.base.errors import InputError

from .bundle import META
from .page import FOLDER, INDEX, PAGE
from .played import FRAMES


class _Handler(SimpleHTTPRequestHandler):
    """Serves regular files of one folder to requests that name this machine. A foreign page can point its own host name
    here (DNS rebinding) and would otherwise read the files."""

    def log_message(self, *_: object) -> None:
        pass

    server: "_Server"

    def send_head(self) -> io.BytesIO | BinaryIO | None:
        """As the base class, but refuses other hosts, paths outside the folder and anything but regular files."""
        port = self.server.server_address[1]
        if self.headers.get("Host", "").lower() not in {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}:
            self.send_error(403, "This server answers to 127.0.0.1 alone")
            return None
        root, asked = os.path.realpath(self.directory), self.translate_path(self.path)
        path = os.path.realpath(asked.replace("\0", "/"))
        if path == root and self.path.split("?")[0].split("#")[0] in ("", "/"):
            path = os.path.join(root, self.server.first)
            self.path = f"/{self.server.first}"
        other = self.server.first == PAGE and path != os.path.join(root, PAGE)  # results beside a page in one file
        if other or os.path.commonpath([root, path]) != root or not os.path.isfile(path):
            self.send_error(404)
            return None
        return super().send_head()


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    first = INDEX

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}/"


def server_of(folder: str | os.PathLike[str], port: int = 0) -> _Server:
    """A server of the page that `relight --format web` wrote, a file or a folder; close it. Port 0 takes any free port.

    folder: that folder, or the folder of results that holds it. Raises InputError without a page, and for a port that
    is not available.
    """
    folder = Path(folder)
    marks = META, FRAMES  # of one splat or of frames
    pages = [each for each in (folder, folder / FOLDER) if (each / INDEX).is_file()]
    found = next((each for each in pages if any((each / name).is_file() for name in marks)), None)
    if found is None and not (folder / PAGE).is_file():
        expected = f"expected {PAGE} or a folder {FOLDER}/ that --format web wrote"
        raise InputError(f"{folder} holds no page to serve: {expected}")
    try:
        server = _Server(("127.0.0.1", port), partial(_Handler, directory=str(found or folder)))
        server.first = INDEX if found else PAGE
        return server
    except (OSError, OverflowError) as error:
        raise InputError(f"`serve` {port}: cannot use the port ({error}); name another") from None
