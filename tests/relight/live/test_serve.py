"""A page is served to this machine alone, and nothing but the files of its folder."""

import http.client
import os
from threading import Thread

import pytest

from relight.live.serve import server_of


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The port of a server of a folder web/, beside which a secret lies."""
    tmp_path = tmp_path_factory.mktemp("served")
    web = tmp_path / "web"
    (web / "lights").mkdir(parents=True)
    for name in ("index.html", "live.json", "lights/0.rgbe"):
        (web / name).write_text(name)
    (tmp_path / "secret.txt").write_text("secret")
    os.symlink(tmp_path / "secret.txt", web / "link.txt")
    os.symlink(tmp_path, web / "up")
    with server_of(web, 0) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_address[1]
        server.shutdown()


def answer(port, path, host=None):
    """(status, body) of a request as no browser tidies it."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.putrequest("GET", path, skip_host=True)
    connection.putheader("Host", f"127.0.0.1:{port}" if host is None else host)
    connection.endheaders()
    found = connection.getresponse()
    return found.status, found.read()


def test_its_own_files_are_served(served):
    for path, expected in (
        ("/", b"index.html"),
        ("/live.json?x#y", b"live.json"),
        ("/lights/0.rgbe", b"lights/0.rgbe"),
    ):
        assert answer(served, path) == (200, expected)
    assert answer(served, "/live.json", f"LocalHost:{served}") == (200, b"live.json")


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:{port}", "127.0.0.1.evil.example:{port}", "127.0.0.1", ""]
)
def test_a_page_that_names_itself_otherwise_gets_nothing(served, host):
    status, body = answer(served, "/live.json", host.format(port=served))
    assert status == 403 and b"live.json" not in body


@pytest.mark.parametrize(
    "path",
    (
        "/../secret.txt /%2e%2e/secret.txt /..%2fsecret.txt /link.txt /up/secret.txt //secret.txt /lights /lights/ "
        "/lights/../../secret.txt /up/ /missing /%00 /\\..\\secret.txt"
    ).split(),
)
def test_nothing_else_is_served_and_no_folder_listed(served, path):
    status, body = answer(served, path)
    assert status in (400, 404) and b"secret" not in body.replace(b"secret.txt", b"")
