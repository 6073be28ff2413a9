"""Buckets of an S3 server on loopback, for tests; they skip where moto and s3fs are not installed."""

import logging
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def bucket_server(patch):
    """A server that grants everything, its address in the environment; yields its URL. patch: a MonkeyPatch."""
    pytest.importorskip("s3fs", reason="buckets need s3fs")
    server = pytest.importorskip("moto.server", reason="buckets need moto[s3] and flask-cors")
    requests = pytest.importorskip("requests")
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    running = server.ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    running.start()
    host, port = running.get_host_and_port()
    url = f"http://{host}:{port}"
    for name, value in (("ENDPOINT_URL", url), ("ACCESS_KEY_ID", "test"), ("SECRET_ACCESS_KEY", "test")):
        patch.setenv(f"AWS_{name}", value)
    patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    patch.setenv("NO_PROXY", "127.0.0.1")
    _forget()
    try:
        yield url
    finally:
        requests.post(f"{url}/moto-api/reset", timeout=120)
        running.stop()
        _forget()


def _forget():
    """Let fsspec connect anew: it keeps connections by everything but the environment."""
    import fsspec

    fsspec.get_filesystem_class("s3").clear_instance_cache()


def made_bucket(name):
    """The URL of a new bucket."""
    import fsspec

    fsspec.filesystem("s3").mkdir(name)
    return f"s3://{name}"


@contextmanager
def no_rights(url, patch):
    """A user of the server who may do nothing."""
    import boto3
    import requests

    user = boto3.client("iam", endpoint_url=url)
    user.create_user(UserName="guest")
    key = user.create_access_key(UserName="guest")["AccessKey"]
    with patch.context() as inner:
        inner.setenv("AWS_ACCESS_KEY_ID", key["AccessKeyId"])
        inner.setenv("AWS_SECRET_ACCESS_KEY", key["SecretAccessKey"])
        _forget()
        requests.post(f"{url}/moto-api/reset-auth", data=b"0", timeout=120)
        try:
            yield
        finally:
            requests.post(f"{url}/moto-api/reset-auth", data=b"inf", timeout=120)
            _forget()


def copied(url, folder):
    """A folder with the files of a URL."""
    import fsspec

    store = fsspec.filesystem("s3")
    root = url.removeprefix("s3://")
    for name in store.find(root):
        path = Path(folder) / name.removeprefix(root).lstrip("/")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(store.cat_file(name))
    return Path(folder)


def sent(path, url):
    """Put a file or a folder where a URL says."""
    import fsspec

    fsspec.filesystem("s3").put(str(path), url, recursive=True)
