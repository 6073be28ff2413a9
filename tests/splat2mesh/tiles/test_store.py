"""Files of a city in a folder and in a store of fsspec: whole or not there."""

import pickle

import numpy as np
import pytest
from buckets import bucket_server, made_bucket

from splat2mesh.base.errors import InputError
from splat2mesh.tiles.store import Store


@pytest.fixture(scope="module")
def bucket():
    with pytest.MonkeyPatch.context() as patch, bucket_server(patch):
        yield made_bucket("stores")


@pytest.fixture(params=["folder", "memory", "s3"])
def store(request, tmp_path):
    if request.param == "memory":
        pytest.importorskip("fsspec")
        return Store(f"memory://{tmp_path.name}/city")
    if request.param == "s3":
        return Store(f"{request.getfixturevalue('bucket')}/{tmp_path.name}")
    return Store(tmp_path / "city")


def test_what_is_written_is_read_and_goes_when_it_is_removed(store):
    store.write_arrays("a/b.npz", x=np.arange(5), y=np.float32(2.5))
    kept = pickle.loads(pickle.dumps(store)).read_arrays("a/b.npz")
    assert kept["x"].tolist() == [0, 1, 2, 3, 4] and kept["y"] == np.float32(2.5)
    assert store.exists("a/b.npz") and not store.exists("a") and not store.exists("a/c")
    store.remove("a/b.npz")
    store.remove("a/b.npz")
    assert not store.exists("a/b.npz")
    store.write("a/c", b"")
    store.remove("a")
    store.remove("a")
    assert not store.exists("a/c")


def test_a_record_counts_only_while_its_files_are_whole(store):
    assert store.committed("t.json") is None
    record = store.commit("t.json", {"t/x": b"12345", "t/y": b""}, tile=3)
    assert store.committed("t.json") == record and record["tile"] == 3
    assert {name: about["bytes"] for name, about in record["files"].items()} == {"t/x": 5, "t/y": 0}
    store.write("t/x", b"12346")
    assert store.committed("t.json") is None
    store.write("t/x", b"12345")
    assert store.committed("t.json") == record
    store.remove("t/y")
    assert store.committed("t.json") is None


def test_what_all_tasks_share_is_read_only_as_it_was(store):
    checksum = store.write("plan.json", b"{}")
    assert checksum == "44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a"  # of two braces
    assert store.read("plan.json", checksum) == b"{}" and store.read_json("plan.json", checksum) == {}
    store.write("plan.json", b"{ }")
    with pytest.raises(InputError, match=r"plan\.json has changed while it was worked on"):
        store.read_json("plan.json", checksum)


def test_what_cannot_be_read_or_written_is_one_line(store, tmp_path):
    with pytest.raises(InputError, match=r"cannot read .*missing"):
        store.read("missing")
    store.write("broken.json", b"{")
    with pytest.raises(InputError, match="not valid JSON"):
        store.read_json("broken.json")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot write"):
        Store(tmp_path / "file" / "below").write("x", b"")
    with pytest.raises(InputError):
        Store("nosuchkind://bucket/city").exists("x")
