"""Splat files: `read_splats` for every kind, `write_inria_ply` for the one that every viewer opens."""

from .inria import write_inria_ply
from .read import read_splats

__all__ = ["read_splats", "write_inria_ply"]
