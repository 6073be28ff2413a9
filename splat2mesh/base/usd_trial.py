"""A trial read of a USD file in a separate process: usd-core trusts the counts in it and allocates accordingly."""

import os
import subprocess
import sys

from .errors import InputError
from .inputs import GIB, MIB

FREE_BYTES, BYTES_PER_BYTE = GIB, 32
"""Memory that a file may take to open: so much, and as much for each of its bytes. Arrays unpack to some 4 times."""

FREE_S, BYTES_PER_S = 60.0, 10 * MIB
"""Time that it may take."""

_TEXT = b"#usda"

_TRIAL = """
import sys
from pxr import Tf, Usd
try:
    import resource
    with open("/proc/self/statm") as file:
        now = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + int(sys.argv[2]),) * 2)
except (ImportError, OSError, ValueError):
    pass  # no such limits on this system; time is limited all the same
try:
    stage = Usd.Stage.Open(sys.argv[1])
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if prim.GetTypeName() == "ParticleField3DGaussianSplat":
            for attribute in prim.GetAttributes():
                attribute.Get()
except Tf.ErrorException as error:
    print(" ".join(str(error).split())[:160])
    sys.exit(3)
"""


def check_opens(path: str | os.PathLike[str], size: int) -> None:
    """Raise InputError where usd-core fails on a file, crashes, or takes far more memory or time than its size
    suggests.

    size: bytes of the file. Text that names no other file passes: its parser takes no counts on trust. Memory is
    limited on Linux alone.
    """
    with open(path, "rb") as file:
        if file.read(len(_TEXT)) == _TEXT and b"@" not in file.read():
            return
    code = [sys.executable, "-c", _TRIAL, os.path.abspath(path), str(FREE_BYTES + BYTES_PER_BYTE * size)]
    found = {"PYTHONPATH": os.pathsep.join(each for each in sys.path if each)}
    try:
        done = subprocess.run(
            code, env=os.environ | found, capture_output=True, timeout=FREE_S + size / BYTES_PER_S, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{path}: takes usd-core over {FREE_S:.0f} s to open: it is damaged, or too large") from None
    if done.returncode == 3:
        reason = done.stdout.decode("utf-8", "replace").strip()
        raise InputError(f"{path}: is damaged, or not a USD file ({reason})")
    if done.returncode:
        raise InputError(f"{path}: usd-core fails to open it: it is damaged, or needs far more memory than its size")
