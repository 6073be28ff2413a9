"""The register of splat formats: which can be read, which written, and if not, why and what to do instead."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import InputError
from ...base.gltf import SPLATS, SPZ_DRAFT
from ...base.inputs import FREE, check_special
from ..splats import Splats
from . import compressed_ply, dotsplat, gltf, inria, ksplat, lcc, sog, sog_writing, spz, spz_writing, usd
from .ply import Ply

SplatWriter = Callable[[str | os.PathLike[str], Splats], Any]

CONVERTER = "npx @playcanvas/splat-transform"
"""Converts between the formats of splats. Source: github.com/playcanvas/splat-transform."""


@dataclass(frozen=True)
class Format:
    """One format of splats.

    kind: its name here; of one that is written also the suffix. title: for messages and documents. suffixes: by which
    it is recognised where its content has no mark. read: takes a path. write: takes a path and Splats. instead: where
    it is not read or not written: why not, and what to do. frame: its axes.
    """

    kind: str
    title: str
    suffixes: tuple[str, ...]
    read: Callable[[Path], Splats] | None = None
    write: SplatWriter | None = None
    instead: str = ""
    frame: str = "as the trainer had it, usually y down"


def _read_ply(path: Path) -> Splats:
    return inria.read(Ply.open(path))


def _read_compressed(path: Path) -> Splats:
    return compressed_ply.read(Ply.open(path))


def _read_sog(path: Path) -> Splats:
    if path.is_dir():
        return sog.read_folder(path)
    with open(path, "rb") as file:
        bundled = file.read(len(sog.ZIP)) == sog.ZIP
    return sog.read_bundle(path) if bundled else sog.read_folder(path.parent, path.name)


_NOT_WRITTEN = "not written: .ply and .spz are read by the same programs"

FORMATS = (
    Format("ply", "PLY of INRIA's trainer and others", (".ply",), _read_ply, inria.write_inria_ply),
    Format("spz", "SPZ of Niantic", (".spz",), spz.read, spz_writing.write, frame="y up, or by a record"),
    Format(
        "compressed.ply", "compressed PLY of PlayCanvas", (".compressed.ply",), _read_compressed, compressed_ply.write
    ),
    Format("sog", "SOG of PlayCanvas", (".sog",), _read_sog, sog_writing.write),
    Format("splat", ".splat of antimatter15", (".splat",), dotsplat.read, instead=_NOT_WRITTEN),
    Format("ksplat", ".ksplat of mkkellogg", (".ksplat",), ksplat.read, instead=_NOT_WRITTEN),
    Format(
        "glb",
        "glTF with KHR_gaussian_splatting",
        gltf.SUFFIXES,
        gltf.read,
        instead="written by relight: --format splat-glb",
        frame="y up",
    ),
    Format(
        "usd",
        "USD with ParticleField3DGaussianSplat",
        usd.SUFFIXES,
        usd.read,
        instead="written by relight: --format usd",
        frame="y or z up, by upAxis",
    ),
    Format("lcc", "LCC of XGRIDS", (lcc.SUFFIX,), lcc.read, instead=_NOT_WRITTEN, frame="z up"),
    Format(
        "lcc2",
        "LCC 2 scene of XGRIDS",
        (".lcc2",),
        instead=f"not read: convert it to a .ply, by {CONVERTER} scene.lcc2 scene.ply",
    ),
    Format(
        "rad",
        ".rad file of Spark",
        (".rad",),
        instead="not read, its layout is Spark's own: give the .ply or .spz that it was built from",
    ),
)
"""Every format that is known, those that are written first."""

BY_KIND = {each.kind: each for each in FORMATS}

_MARKS: tuple[tuple[str, Callable[[bytes, str], bool]], ...] = (
    ("spz", lambda head, suffix: head.startswith((b"\x1f\x8b", spz.MAGIC))),
    ("glb", lambda head, suffix: head.startswith(gltf.MAGIC) or suffix == ".gltf"),
    ("usd", lambda head, suffix: head.startswith(usd.MARKS) or (head.startswith(sog.ZIP) and suffix == ".usdz")),
    ("lcc", lambda head, suffix: head.lstrip().startswith(b"{") and suffix == lcc.SUFFIX),
    ("sog", lambda head, suffix: head.startswith(sog.ZIP) or head.lstrip().startswith(b"{")),
    ("splat", lambda head, suffix: suffix == ".splat"),
    ("ksplat", lambda head, suffix: suffix == ".ksplat" or (not suffix and ksplat.looks_like(head))),
)
"""By the first bytes of a file and its suffix, in the order in which they are asked."""

KINDS = (
    "an INRIA or compressed .ply, a .splat, a .ksplat, a .spz, a .sog (also as a folder with meta.json), "
    "a .glb or .gltf with KHR_gaussian_splatting, a .usd, an .lcc, the lod-meta.json of a streamed SOG, "
    "or a folder of tiles"
)
"""What is read, for messages."""


def kind_of_file(path: Path) -> str:
    """Recognise one splat file, or the folder of an unbundled SOG, by its content. Returns the kind of a Format that is
    read. Raises InputError for what is none, with the reason, or what to do, where its format is known."""
    if not path.exists():
        raise InputError(f"{path} does not exist: expected {KINDS}")
    if path.is_dir():
        return "sog"
    check_special(path)
    with open(path, "rb") as file:
        head = file.read(64)
    suffix = path.suffix.lower()
    if not head:
        raise InputError(f"{path} is empty: expected {KINDS}")
    known = next((each for each in FORMATS if suffix in each.suffixes), None)
    if known is not None and known.read is None:
        raise InputError(f"{path} is a {known.title}, which is {known.instead}")
    if head.split(b"\n")[0].strip() == b"ply":
        return "compressed.ply" if "chunk" in Ply.open(path).elements else "ply"
    for kind, shows in _MARKS:
        if shows(head, suffix):
            return kind
    raise InputError(f"{path} is not a splat file (it starts with {head[:12]!r}): expected {KINDS}")


def looks_like_splat(path: Path) -> bool:
    """Return whether a file is meant as a splat, rather than as a mesh, by its content; does not validate it."""
    suffix = path.suffix.lower()
    with open(path, "rb") as file:
        head = file.read(FREE)
    if head.startswith(b"ply"):
        header = head[: head.find(b"\nend_header")]
        return b"packed_position" in header or (b"scale_0" in header and b"rot_0" in header)
    if head.startswith(gltf.MAGIC) or suffix in gltf.SUFFIXES:
        return any(name.encode() in head for name in (SPLATS, SPZ_DRAFT))
    return any(suffix in each.suffixes for each in FORMATS if each.kind not in ("ply", "glb"))


def reader_of(kind: str) -> Callable[[Path], Splats]:
    """Return what reads a kind. kind: as `kind_of_file` returns it. It takes a path."""
    found = BY_KIND[kind].read
    assert found is not None  # `kind_of_file` refuses others
    return found
