"""The chunked mesh that splat2mesh makes and relight lights. `folder` stores it on disk."""

import os
import warnings
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.choices import DEFAULT_MAX_VERTICES
from ..base.errors import DataWarning, InputError
from ..base.inputs import reading
from .chunks import split
from .color import linear_from_srgb
from .folder import bounds_of, read_folder, write_folder
from .measured import Measured
from .mesh import Mesh, known_normals
from .meshfile import read_placed
from .surfaces import frame_from_own


@dataclass
class Scene:
    """A chunked triangle mesh in the scene frame: right-handed, y up, unit of the splat.

    Attributes
    ----------
    chunks : list of Mesh
    scene_from_splat : ndarray of float64, (4, 4)
        From the frame of the splat's or the mesh's file to this one.
    preview_camera : dict or None
        eye, target, up ((3,) in the scene frame) and fov_deg.
    source : dict
        `file`, its name, `sha256` and `path`, of a streamed SOG also `lod`, the level read; for a layout also
        `objects`, each a dict of these and `name`, `scene_from_splat` (4 x 4, rows first) and `chunks`, the range
        [first, last) of those made from it. Paths are absolute here; scene.json has them relative to its folder, so
        that both can be moved together.
    settings, statistics : dict
        Kept in scene.json.
    path : Path or None
        The folder or file it was loaded from.
    background : list of Mesh
        Far background: drawn, never lit, casts no shadow.
    background_splats : ndarray of int64, (M,)
        Rows of the source's splats that are far background; of a layout none are kept.
    capture : dict
        What the splat shows about its capture, kept in scene.json: `from` (inside, outside or both), `eyes` ((3,)
        places in the scene frame where it was seen from within) and `focal_px`; empty where unknown.
    measured : Measured or None
        Measurements on the splats beyond the surface.
    picture : ndarray of uint8, (H, W, 3), or None
        The splat and the mesh side by side, which `save` writes as preview.png; never read.
    proxy : bytes or None
        The glTF file that `save` writes as proxy.glb; never read.
    textured : bytes or None
        The glTF file that `save` writes as mesh.glb; never read.
    hull : tuple of int
        Numbers of the chunks that are leaves or grass and are not drawn: light is found on them for the splats there,
        and they cast shadows.
    cards : list of Mesh
        Quads drawn in place of leaves, four vertices each. Lit by the hull around them; they cast no shadow.
    left : tuple of ndarray of int64
        Of a scene that was changed since its `textured` file was written: the faces of each drawn chunk of that which
        are left, in chunks that have any; further chunks are new. Empty where nothing was changed; never kept.

    Notes
    -----
    A Scene does not change after its arrays are first used: `vertices`, `normals`, `faces`, `colors_srgb` and
    `colors_linear` are concatenated on first use, kept, and read-only.
    """

    chunks: list[Mesh]
    scene_from_splat: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    preview_camera: dict[str, Any] | None = None
    source: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None
    background: list[Mesh] = field(default_factory=list)
    background_splats: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    capture: dict[str, Any] = field(default_factory=dict)
    measured: Measured | None = None
    picture: NDArray[np.uint8] | None = None
    proxy: bytes | None = None
    textured: bytes | None = None
    hull: tuple[int, ...] = ()
    cards: list[Mesh] = field(default_factory=list)
    left: tuple[NDArray[np.int64], ...] = ()

    @classmethod
    def from_mesh(cls, mesh: Mesh, max_chunk_vertices: int = DEFAULT_MAX_VERTICES, **fields: Any) -> "Scene":
        """Cut a Mesh in the scene frame into chunks. fields: other fields of the Scene."""
        return cls(split(mesh, max_chunk_vertices), **fields)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Scene":
        """Read a scene folder, or any mesh file as a scene of one chunk in its own vertex order. Raises InputError for
        anything else, for a broken folder and for a newer schema version."""
        path = Path(path)
        if not os.path.exists(path):
            raise InputError(f"{path}: no such scene folder or mesh file")
        if not path.is_dir():
            mesh, moved = read_placed(path)
            return cls([mesh], path=path, scene_from_splat=frame_from_own(moved))
        with reading(path):
            chunks, background, kept = read_folder(path)
            return cls(chunks, path=path, background=background, **kept)

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the scene folder; it appears complete or not at all. Raises InputError when `path` exists, unless it is
        a scene folder and may be replaced (`overwrite`)."""
        write_folder(self, path, overwrite)
        self.path = Path(path)

    @property
    def is_place(self) -> bool:
        """Whether the capture looked from within: a room, a garden, a street."""
        return self.capture.get("from") in ("inside", "both")

    @property
    def foliage(self) -> NDArray[np.float32]:
        """(V,) float32 in [0, 1]: the share of leaves or grass at each vertex. All 0 where that was not measured, and
        in a room, where furniture looks like leaves: in a trained parlour a third would count as leaves."""
        if self.measured is None or self.capture.get("from") == "inside":
            return np.zeros(self.vertex_count, np.float32)
        return self.measured.foliage

    @property
    def vertex_count(self) -> int:
        """V, over all chunks."""
        return sum(len(chunk.vertices) for chunk in self.chunks)

    @cached_property
    def vertices(self) -> NDArray[np.float32]:
        """(V, 3), chunk after chunk."""
        return _read_only(np.concatenate([chunk.vertices for chunk in self.chunks]))

    @cached_property
    def normals(self) -> NDArray[np.float32]:
        """(V, 3), chunk after chunk; missing ones from the faces around, with a DataWarning that counts them."""
        given = np.concatenate([chunk.normals for chunk in self.chunks])
        found = np.concatenate([known_normals(chunk) for chunk in self.chunks])
        repaired = int((~np.isclose(found, given, equal_nan=True)).any(axis=1).sum())
        if repaired:
            message = f"{repaired} vertices of {len(found)} had no normal: those of the faces around are used"
            warnings.warn(message, DataWarning, stacklevel=2)
        return _read_only(found)

    @cached_property
    def colors_srgb(self) -> NDArray[np.uint8]:
        """(V, 3) in 0..255, chunk after chunk."""
        return _read_only(np.concatenate([chunk.colors_srgb for chunk in self.chunks]))

    @cached_property
    def colors_linear(self) -> NDArray[np.float32]:
        """(V, 3) in [0, 1], linear: `colors_srgb` as light."""
        return _read_only(linear_from_srgb(self.colors_srgb.astype(np.float32) / np.float32(255.0)))

    @cached_property
    def faces(self) -> NDArray[np.int32]:
        """(F, 3) into `vertices`."""
        offsets = np.cumsum([0] + [len(chunk.vertices) for chunk in self.chunks[:-1]])
        shifted = [chunk.faces + offset for chunk, offset in zip(self.chunks, offsets, strict=True)]
        return _read_only(np.concatenate(shifted, dtype=np.int32))

    @property
    def bounds(self) -> NDArray[np.float64]:
        """(2, 3): lowest and highest corner."""
        return bounds_of(self.vertices)

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        return float(np.linalg.norm(np.diff(self.bounds, axis=0)))

    def __getstate__(self) -> dict[str, Any]:
        """The pickled state: only the fields, not the arrays derived from them."""
        return {each.name: getattr(self, each.name) for each in fields(self)}


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array
