"""Splat files out, in each format that has a writer."""

import os
from collections.abc import Callable

from ...base.errors import InputError
from ..splats import Splats
from . import compressed_ply, spz
from .inria import write_inria_ply

WRITERS: dict[str, Callable[[str | os.PathLike[str], Splats], None]] = {
    "ply": write_inria_ply,
    "spz": spz.write,
    "compressed.ply": compressed_ply.write,
}
"""By kind, which is also the suffix of the file; they take a path and Splats."""


def write_splats(path: str | os.PathLike[str], splats: Splats, kind: str = "ply") -> None:
    """Write splats in the frame of an INRIA PLY, row i being splat i; the file appears only once it is complete.

    kind: a key of WRITERS: "ply" is exact, "spz" and "compressed.ply" are small and quantised. The same splats give
    the same bytes. Rows that hold no finite values go out as they are in a PLY, else as transparent splats.
    Raises InputError for another kind; warns with a DataWarning about what a format cannot hold.
    """
    if kind not in WRITERS:
        raise InputError(f"cannot write splats as {kind!r}: expected one of {' '.join(WRITERS)}")
    WRITERS[kind](path, splats)
