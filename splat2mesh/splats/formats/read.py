"""Which reader a splat file needs, decided by what the file holds rather than by its name."""

from pathlib import Path

import numpy as np

from ...base.errors import InputError
from . import compressed_ply, dotsplat, inria, sog, spz
from .ply import Ply

KINDS = "an INRIA or compressed .ply, a .splat, a .spz, or a .sog (also as a folder with meta.json)"
_ZIP = b"PK\x03\x04"


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
            return _read(path, _kind(path))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error


def kind_of(path):
    """What a splat file is, by what it holds: "ply" (INRIA, 2DGS), "compressed.ply", "splat", "spz" or "sog".

    Raises InputError for what is none of them.
    """
    path = Path(path)
    try:
        return _kind(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error


def _read(path, kind):
    if kind == "sog":
        if path.is_dir():
            return sog.read_folder(path)
        with open(path, "rb") as file:
            bundled = file.read(len(_ZIP)) == _ZIP
        return sog.read_bundle(path) if bundled else sog.read_folder(path.parent, path.name)
    if kind in ("ply", "compressed.ply"):
        return (inria if kind == "ply" else compressed_ply).read(Ply.open(path))
    return {"spz": spz, "splat": dotsplat}[kind].read(path)


def _kind(path):
    if not path.exists():
        raise InputError(f"{path} does not exist: expected {KINDS}")
    if path.is_dir():
        return "sog"
    with open(path, "rb") as file:
        head = file.read(64)
    if not head:
        raise InputError(f"{path} is empty: expected {KINDS}")
    if head.split(b"\n")[0].strip() == b"ply":
        return "compressed.ply" if "chunk" in Ply.open(path).elements else "ply"
    if head.startswith((b"\x1f\x8b", spz.MAGIC)):
        return "spz"
    if head.startswith(_ZIP) or head.lstrip().startswith(b"{"):
        return "sog"
    if path.suffix.lower() == ".splat":
        return "splat"
    raise InputError(f"{path} is no splat file (it starts with {head[:12]!r}): expected {KINDS}")
