"""Pages in headless Chromium, driven over its debugging pipe: what the console said, and a screenshot.

Graphics are drawn by SwiftShader, on the CPU. Needs no package of Python or of node.
"""

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import threading
import time
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

import pytest

START = [
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-unsafe-webgpu",
    "--use-webgpu-adapter=swiftshader",
    "--enable-features=Vulkan",
    "--hide-scrollbars",
    "--mute-audio",
    "--disable-background-networking",
    "--remote-debugging-pipe",
]


def browser_path():
    """The path of Chromium. Skips without one."""
    found = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )
    if found is None:
        pytest.skip("Chromium is not installed")
    return found


class Browser:
    """One Chromium with one page."""

    def __init__(self, size):
        self._profile = tempfile.mkdtemp(prefix="chromium-")
        read_theirs, self._write = os.pipe()
        self._read, write_theirs = os.pipe()

        def place():
            # Chromium reads from 3 and writes to 4; the copies first go where neither is overwritten.
            first, second = os.dup(read_theirs), os.dup(write_theirs)
            os.dup2(first, 3)
            os.dup2(second, 4)

        command = [browser_path(), *START, f"--user-data-dir={self._profile}", "--window-size={},{}".format(*size)]
        self._process = subprocess.Popen(
            [*command, "about:blank"],
            close_fds=False,
            preexec_fn=place,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read_theirs)
        os.close(write_theirs)
        self._count, self._buffer, self._events, self._session = 0, b"", [], None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **metrics)
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method, timeout=60.0, **parameters):
        """The answer to a command of the DevTools protocol; events that come meanwhile are kept."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        end = time.monotonic() + timeout
        while True:
            answer = self._next(end - time.monotonic())
            if answer.get("id") == message["id"]:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]
            self._events.append(answer)

    def open(self, url):
        """Go to a page."""
        self._events.clear()
        self.call("Page.navigate", url=url)

    def value(self, expression, timeout=60.0):
        """The value of a JavaScript expression; promises are waited for."""
        found = self.call(
            "Runtime.evaluate", timeout=timeout, expression=expression, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in found:
            raise RuntimeError(json.dumps(found["exceptionDetails"])[:500])
        return found["result"].get("value")

    def wait_for(self, expression, timeout=120.0):
        """Wait until a JavaScript expression is true. Raises TimeoutError with what the console said."""
        end = time.monotonic() + timeout
        while not self.value(expression):
            if time.monotonic() > end:
                raise TimeoutError(f"{expression} within {timeout} s; console: {self.console()}")
            time.sleep(0.1)

    def console(self, levels=("error", "warning")):
        """What was said on the console at these levels, and every exception that nobody caught."""
        said = []
        for event in self._events:
            details = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                thrown = details["exceptionDetails"]
                said.append(thrown.get("exception", {}).get("description") or thrown["text"])
            elif event.get("method") == "Runtime.consoleAPICalled" and details["type"] in levels:
                said.append(" ".join(str(each.get("value", each.get("description"))) for each in details["args"]))
            elif event.get("method") == "Log.entryAdded" and details["entry"]["level"] in levels:
                said.append(f"{details['entry']['text']} {details['entry'].get('url', '')}")
        return said

    def screenshot(self, path):
        """Write a PNG of the page."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        with open(path, "wb") as file:
            file.write(base64.b64decode(data))

    def close(self):
        """End the browser."""
        self._process.terminate()
        self._process.wait(20)
        os.close(self._write)
        os.close(self._read)
        shutil.rmtree(self._profile, ignore_errors=True)

    def _next(self, timeout):
        end = time.monotonic() + timeout
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(end - time.monotonic(), 0.0))
            if not ready:
                raise TimeoutError("Chromium does not answer")
            chunk = os.read(self._read, 1 << 20)
            if not chunk:
                raise RuntimeError("Chromium has ended")
            self._buffer += chunk
        message, self._buffer = self._buffer.split(b"\0", 1)
        return json.loads(message)


@contextmanager
def browser(size=(640, 480)):
    """A Browser that is ended afterwards."""
    opened = Browser(size)
    try:
        yield opened
    finally:
        opened.close()


class _Quiet(SimpleHTTPRequestHandler):
    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".mjs": "text/javascript", ".wasm": "application/wasm"}

    def log_message(self, *arguments):
        pass

    def send_error(self, code, *arguments, **more):
        """A browser asks for an icon that no page here has: without one, no error."""
        if self.path == "/favicon.ico":
            self.send_response(204)
            self.end_headers()
            return
        super().send_error(code, *arguments, **more)


@contextmanager
def served(folder):
    """The address of a folder, served on this machine; links are followed."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
