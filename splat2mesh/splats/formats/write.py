"""Splat files out, in each format that has a writer."""

import os

from ...base.errors import InputError
from ..splats import Splats
from .register import FORMATS, SplatWriter

WRITERS: dict[str, SplatWriter] = {each.kind: each.write for each in FORMATS if each.write is not None}
"""Writers by kind, which is also the suffix of the file; they take a path and Splats."""


def kind_of_name(path: str | os.PathLike[str]) -> str:
    """Return the kind of splat that the name of a file ends in. path: nothing needs to be there. Returns a key of
    `WRITERS`. Raises InputError for a name that ends in none of them."""
    name = os.path.basename(os.fspath(path)).lower()
    kinds = [kind for kind in WRITERS if name.endswith(f".{kind}")]
    if not kinds:
        endings = " ".join(f".{kind}" for kind in WRITERS)
        raise InputError(f"{path}: not a splat format that can be written; expected a name that ends in {endings}")
    return max(kinds, key=len)


def can_hold(kind: str, splats: Splats) -> bool:
    """Return whether a kind of file has a writer that keeps all colours of some splats. kind: of any splat file. False
    for "sog" and splats with harmonics beyond the first, which its writer leaves out."""
    return kind in WRITERS and (kind != "sog" or not splats.degree)


def write_splats(path: str | os.PathLike[str], splats: Splats, kind: str = "ply") -> None:
    """Write splats, row i being splat i; the file appears only once it is complete.

    path: of the file, which is replaced where there is one. splats: N Gaussians in the frame of an INRIA PLY. Rows that
    hold no finite values go out as they are in a PLY, else as transparent splats. kind: a key of `WRITERS`: "ply" is
    exact, "spz", "compressed.ply" and "sog" are small and quantised. Raises InputError for another kind. Warns with a
    DataWarning about what a format cannot hold.

    The same splats give the same bytes.
    """
    if kind not in WRITERS:
        raise InputError(f"cannot write splats as {kind!r}: expected one of {' '.join(WRITERS)}")
    WRITERS[kind](path, splats)
