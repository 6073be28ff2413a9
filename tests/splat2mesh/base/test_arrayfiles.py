"""Files of arrays: read whole or by name; faults are ValueErrors; headers are read in one thread at a time."""

import threading

import numpy as np
import pytest
from numba.core.compiler_lock import global_compiler_lock

from splat2mesh.base.arrayfiles import load_array, load_arrays
from splat2mesh.base.errors import InputError

ROWS = np.arange(12.0).reshape(3, 4)


@pytest.fixture()
def files(tmp_path):
    np.save(tmp_path / "one.npy", ROWS)
    np.savez_compressed(tmp_path / "two.npz", rows=ROWS, names=np.array(["a", "b"]))
    return tmp_path


def test_arrays_are_read_whole_or_by_name(files):
    np.testing.assert_array_equal(load_array(files / "one.npy"), ROWS)
    assert sorted(load_arrays(files / "two.npz", 1 << 20)) == ["names", "rows"]
    assert list(load_arrays(files / "two.npz", 1 << 20, ("rows",))) == ["rows"]


@pytest.mark.parametrize("most,names", [(ROWS.nbytes - 1, ("rows",)), (1 << 20, ("rows", "none"))])
def test_what_is_too_large_or_not_there_is_refused(files, most, names):
    with pytest.raises(ValueError):
        load_arrays(files / "two.npz", most, names)


def test_nothing_is_unpickled_and_a_folder_is_no_file(files):
    np.save(files / "object.npy", np.array([{}], object))
    with pytest.raises(ValueError):
        load_array(files / "object.npy")
    with pytest.raises(ValueError, match="several arrays"):
        load_array(files / "two.npz")
    with pytest.raises(InputError):
        load_array(files)


@pytest.mark.parametrize("name,load", [("one.npy", load_array), ("two.npz", lambda path: load_arrays(path, 1 << 20))])
def test_every_cut_ends_in_a_value_error(files, name, load):
    data = (files / name).read_bytes()
    for length in range(0, len(data) - 1, 7):
        (files / name).write_bytes(data[:length])
        with pytest.raises(ValueError):
            load(files / name)


@pytest.mark.parametrize(
    "load", [lambda files: load_array(files / "one.npy"), lambda files: load_arrays(files / "two.npz", 1 << 20)]
)
def test_headers_wait_for_a_kernel_that_is_compiled(files, load):
    """Python before 3.11.8 can fail where two threads parse source."""
    read = threading.Thread(target=load, args=(files,))
    with global_compiler_lock:
        read.start()
        read.join(0.2)
        assert read.is_alive()
    read.join(30.0)
    assert not read.is_alive()
