"""The options of splat2mesh as frozen values: one for a mesh, one for a city in tiles. Imports nothing heavy."""

import math
import os
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields, replace
from typing import Any

from .base.choices import (
    BACKGROUND_CHOICES,
    DEFAULT_MAX_VERTICES,
    DETAIL_CHOICES,
    FOLIAGE_CHOICES,
    PROXY_CHOICES,
    STAND_CHOICES,
    SURFACE_CHOICES,
    UP_CHOICES,
    check_choice,
    check_lod,
    check_seed,
    check_texture,
)
from .base.errors import InputError

CHOICES = {
    "up": UP_CHOICES,
    "detail": DETAIL_CHOICES,
    "surface": SURFACE_CHOICES,
    "background": BACKGROUND_CHOICES,
    "stand": STAND_CHOICES,
    "foliage": FOLIAGE_CHOICES,
    "proxy": PROXY_CHOICES,
}
"""What the fields that are words may be."""

LEAST_VERTICES = 4
"""Least vertices of a closed mesh: a tetrahedron."""

LEAST_CHUNK = 3
"""Vertices of a chunk: a triangle."""


@dataclass(frozen=True)
class ConvertOptions:
    """How a splat becomes a mesh.

    Parameters
    ----------
    cameras : path, optional
        Cameras of the capture: a COLMAP folder, a `cameras.json` of INRIA, a `transforms.json` of nerfstudio, or
        "none". Default: those beside the splat, else virtual views.
    lod : int or "auto"
        Level of a streamed SOG, 0 the finest; "auto" takes the finest of at most 6 million splats.
    vertices : int, optional
        Size of the mesh. Default: 50,000 for an object, for a place as many as its detail needs.
    max_chunk_vertices : int
        Limit of each sub-mesh.
    up : {"auto", "+y", "-y", "+z", "-z"}
        Axis of the splat's frame that points up.
    detail : {"draft", "normal", "fine"}
        Number and size of the views, and size of the voxels.
    surface : {"field", "sugar"}
        A level of the opacity field, or the method of the SuGaR paper.
    background : {"cut", "keep"}
        Far background of an open scene.
    stand : {"auto", "inside", "outside"}
        Where the capture stood.
    eyes : sequence of (x, y, z)
        Known positions of the capture, in the splat's own frame.
    proxy : {"closed", "convex"}, optional
        Collision proxy to add to the scene.
    foliage : {"mesh", "cards", "none"}
        Leaves and grass in the mesh: faces like all else, small quads in their place, or left out.
    texture : int, "auto" or "none"
        Side of the texture of mesh.glb in texels; "auto" is as fine as the splats, up to 4,096; "none" leaves mesh.glb
        out.
    seed : int
        Seed of the virtual views, 0 to 2^64 - 1.

    Raises
    ------
    InputError
        For anything else; the message names the field.
    """

    cameras: str | os.PathLike[str] | None = None
    lod: int | str = "auto"
    vertices: int | None = None
    max_chunk_vertices: int = DEFAULT_MAX_VERTICES
    up: str = "auto"
    detail: str = "normal"
    surface: str = "field"
    background: str = "cut"
    stand: str = "auto"
    eyes: tuple[tuple[float, float, float], ...] = ()
    proxy: str | None = None
    foliage: str = "mesh"
    texture: int | str = "none"
    seed: int = 0

    def __post_init__(self) -> None:
        if self.vertices is not None and self.vertices < LEAST_VERTICES:
            raise InputError(f"`vertices` {self.vertices}: a mesh needs at least {LEAST_VERTICES}")
        if self.max_chunk_vertices < LEAST_CHUNK:
            raise InputError(f"`max_chunk_vertices` {self.max_chunk_vertices}: a chunk needs at least {LEAST_CHUNK}")
        for name, choices in CHOICES.items():
            if name != "proxy" or self.proxy is not None:
                object.__setattr__(self, name, check_choice(name, getattr(self, name), choices))
        object.__setattr__(self, "lod", check_lod(self.lod))
        object.__setattr__(self, "texture", check_texture(self.texture))
        object.__setattr__(self, "seed", check_seed(self.seed))
        object.__setattr__(self, "eyes", tuple(_point_of(eye) for eye in self.eyes))

    @classmethod
    def of(cls, options: "ConvertOptions | None" = None, **changes: Any) -> "ConvertOptions":
        """Return the options given, or the defaults, with some fields changed."""
        if options is None:
            return cls(**changes)
        return replace(options, **changes) if changes else options


@dataclass(frozen=True)
class TilingOptions:
    """How a city, a capture larger than memory, is worked on tile by tile. Both commands take it.

    Parameters
    ----------
    memory : float, optional
        GiB that one process may take; it sets the size of the tiles.
    workers : int, optional
        Processes on this machine that share the tiles.
    scheduler : str, optional
        Address of a scheduler of dask.distributed, such as "tcp://host:8786", whose workers do the work.
    resume : bool
        Go on where a run with the same settings stopped.
    tile_splats : int, optional
        Splats of a tile with its halo; by memory without.

    Raises
    ------
    InputError
        For anything else; the message names the field.
    """

    memory: float | None = None
    workers: int | None = None
    scheduler: str | None = None
    resume: bool = False
    tile_splats: int | None = None

    def __post_init__(self) -> None:
        if self.scheduler is not None and self.workers is not None:
            raise InputError("`workers` and `scheduler`: give one of them; workers belong to their scheduler")
        if self.workers is not None and self.workers < 1:
            raise InputError(f"`workers` {self.workers}: expected at least 1")
        if self.memory is not None and not self.memory > 0:
            raise InputError(f"`memory` {self.memory:g}: expected GiB above 0")
        if self.tile_splats is not None and self.tile_splats < 1:
            raise InputError(f"`tile_splats` {self.tile_splats}: expected at least 1")


def changed_fields(options: Any, ignored: Iterable[str] = ()) -> list[str]:
    """Return the names of the fields of a dataclass whose values are not the defaults, in their order."""
    found = []
    for field in fields(options):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        value = getattr(options, field.name)
        if field.name not in ignored and value is not default and not bool(value == default):
            found.append(field.name)
    return found


def refuse_in_cities(options: Any, known: Iterable[str]) -> None:
    """Raise InputError for a field that was set and that cities in tiles do not know."""
    for name in changed_fields(options, known):
        raise InputError(f"`{name}`: not supported for a city in tiles; leave it out")


def _point_of(eye: Iterable[float]) -> tuple[float, float, float]:
    point = tuple(float(each) for each in eye)
    if len(point) != 3 or not all(map(math.isfinite, point)):
        raise InputError(f"`eyes` {point}: expected three finite numbers each")
    return point
