"""Which reader a splat file needs, decided by what the file holds rather than by its name."""

from pathlib import Path

import numpy as np

from ..errors import InputError
from . import compressed_ply, dotsplat, inria, sog, spz
from .ply import Ply

KINDS = "an INRIA or compressed .ply, a .splat, a .spz, or a .sog (also as a folder with meta.json)"


def read_splats(path):
    """Read any supported splat file: INRIA PLY (also 2DGS), PlayCanvas compressed PLY, .splat, .spz, .sog.

    path: a file; for SOG also the folder that holds meta.json, or that meta.json.
    Returns Splats in the frame of an INRIA PLY, not yet cleaned: rows may hold NaN, or be invisible.
    Raises InputError when the file is missing, empty, cut short, or of another kind.
    """
    path = Path(path)
    try:
        # Values beyond float32 become infinite or NaN here, and `clean` drops and counts them.
        with np.errstate(over="ignore", invalid="ignore"):
            return _read(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error


def _read(path):
    if not path.exists():
        raise InputError(f"{path} does not exist: expected {KINDS}")
    if path.is_dir():
        return sog.read_folder(path)
    with open(path, "rb") as file:
        head = file.read(64)
    if not head:
        raise InputError(f"{path} is empty: expected {KINDS}")
    if head.split(b"\n")[0].strip() == b"ply":
        ply = Ply.open(path)
        return compressed_ply.read(ply) if "chunk" in ply.elements else inria.read(ply)
    if head.startswith((b"\x1f\x8b", spz.MAGIC)):
        return spz.read(path)
    if head.startswith(b"PK\x03\x04"):
        return sog.read_bundle(path)
    if head.lstrip().startswith(b"{"):
        return sog.read_folder(path.parent, path.name)
    if path.suffix.lower() == ".splat":
        return dotsplat.read(path)
    raise InputError(f"{path} is no splat file (it starts with {head[:12]!r}): expected {KINDS}")
