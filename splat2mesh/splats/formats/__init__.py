"""Splat files: `read_splats` for every kind, `write_splats` for those that can hold a relit one."""

from .inria import write_inria_ply
from .parts import check_lod, parts_of
from .read import kind_of, read_splats
from .write import WRITERS, can_hold, kind_of_name, write_splats

__all__ = [
    "WRITERS",
    "can_hold",
    "check_lod",
    "kind_of",
    "kind_of_name",
    "parts_of",
    "read_splats",
    "write_inria_ply",
    "write_splats",
]
