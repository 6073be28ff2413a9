"""A kernel that one process compiles is locked for others, until it is done or gone."""

import subprocess
import sys

import pytest

from splat2mesh.base.kernel_locks import KernelLocks

pytest.importorskip("fcntl")

HOLDER = """
import sys
from pathlib import Path
from splat2mesh.base.kernel_locks import KernelLocks
locks = KernelLocks(Path(sys.argv[1]))
locks.take("a.kernel")
print("held", flush=True)
sys.stdin.read()
"""


def test_others_find_a_kernel_locked_until_the_process_is_gone(tmp_path):
    path = tmp_path / "locks"
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout.readline() == b"held\n"
        locks = KernelLocks(path)
        assert not locks.take("a.kernel", wait=False)
        assert locks.take("another.kernel", wait=False)
        holder.kill()
        assert locks.take("a.kernel")
    assert path.stat().st_size == 0


def test_a_kernel_is_locked_until_it_is_released_as_often_as_taken(tmp_path):
    code = "import sys; from pathlib import Path; from splat2mesh.base.kernel_locks import KernelLocks; "
    code += "print(KernelLocks(Path(sys.argv[1])).take('a.kernel', wait=False))"

    def free():
        line = [sys.executable, "-c", code, str(tmp_path / "locks")]
        return subprocess.run(line, capture_output=True, text=True, check=True).stdout == "True\n"

    locks = KernelLocks(tmp_path / "locks")
    assert locks.take("a.kernel") and locks.take("a.kernel")
    locks.release("a.kernel")
    assert not free()
    locks.release("a.kernel")
    assert free()
