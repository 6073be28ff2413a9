"""The geometry that the light of a tile depends on: its mesh, its surroundings, and the rest of the city, coarse. The
memory limit of a process decides how many vertices are lit at once, and so in how many parts the tile is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.memory import BASE_GB, check_memory
from splat2mesh.tiles.plan import FAR, folder_of, grown, within_box
from splat2mesh.tiles.store import Store

from .shared import CoarseCity

GB_PER_LIT, GB_PER_NEAR, GB_PER_SPLAT = 2.8e-6, 1.2e-6, 1.0e-6
"""Bytes of a process's peak memory per vertex whose own light is computed, per vertex around them, and per splat of the
tile."""

USUAL_GB = 4.0
"""Default GiB of a process."""

LEAST_VERTICES = 64
"""Least vertices of a part: a smaller one is mostly surroundings."""

LEAST_SHARE = 1 / 64
"""Least share of the distance within which a part sees its surroundings unsimplified, before it is cut further."""

NEAR = 2.0
"""Distance around its core within which a tile sees its neighbours unsimplified, in distances between stations. With 1,
a low sun lit a wall in the shadow of a house next door, which is coarse then: error .29 in a tile of a city of ten
million; .021 with 2, .023 with 3."""

MIDDLE = 8.0
"""Distance around its core within which a tile sees the coarse meshes made for it, not those of the whole city, which
get coarser with the number of tiles. Under a sun at 4 degrees, a house half a distance high casts its shadow this
far."""

EXACT = 0.1
"""Distance around its box within which a part computes light at every vertex, in distances between stations: splats
near its border take light from there. Farther vertices only bounce light, and take the light of neighbours
(`transfer.receivers`)."""

LOWEST = 0.005
"""Elevation, in radians, below which a distant tile is left out. So the coarse scene of a tile does not grow with the
city. Under an even sky, a wall gets 0.6% of its light from below this elevation."""


class TilePart(NamedTuple):
    """A rectangle of a tile that is lit separately.

    core: (2, 2) lowest and highest x and z of the tile. box: (2, 2) of the part. distance: around it, within which
    everything is unsimplified.
    """

    core: NDArray[np.float64]
    box: NDArray[np.float64]
    distance: float

    def holds(self, places: NDArray) -> NDArray[np.bool_]:
        """(N,) bool of positions of the tile, (N, 2) x and z. Those beyond its core belong to the part beside them, so
        each is in exactly one part."""
        low, high = self.core
        return within_box(np.clip(places, low, np.nextafter(high, low)), self.box)

    @property
    def grown(self) -> NDArray[np.float64]:
        """(2, 2) the box with its unsimplified surroundings."""
        return grown(self.box, self.distance)


def room_for(memory_gb: float | None, splats: int, coarse: int) -> float:
    """Vertices whose light a process can compute at once, beside the splats of a tile and the coarse city. Raises
    InputError for a memory that those alone fill."""
    memory_gb = USUAL_GB if memory_gb is None else memory_gb
    taken = BASE_GB + splats * GB_PER_SPLAT + coarse * GB_PER_NEAR
    check_memory(memory_gb, taken + LEAST_VERTICES * GB_PER_LIT)
    return (memory_gb - taken) / GB_PER_LIT


def parts_of(
    own: NDArray,  # (V, 2) x and z of a tile's vertices
    around: NDArray,  # (W, 2) of the vertices of neighbours near it
    core: NDArray,  # (2, 2) lowest and highest x and z
    distance: float,  # around it, within which everything is unsimplified
    most: float,  # vertices, of `room_for`
) -> list[TilePart]:
    """The parts of a tile. Cuts go across the longer side, at half of the vertices.

    If a part is no wider than its surroundings and still exceeds the limit, the distance is halved.
    """
    core = np.asarray(core, np.float64)
    whole = TilePart(core, core, distance)
    places, lit = np.concatenate([own, around]), np.arange(len(own) + len(around)) < len(own)
    lit_share = GB_PER_NEAR / GB_PER_LIT
    pending, done = [(whole, np.arange(len(places)))], []
    while pending:
        part, rows = pending.pop()
        near = rows[within_box(places[rows], part.grown) | (lit[rows] & part.holds(places[rows]))]
        inside = near[lit[near] & part.holds(places[near])]
        cost = len(inside) + lit_share * (len(near) - len(inside))
        sides = part.box[1] - part.box[0]
        can_shrink = part.distance > LEAST_SHARE * distance
        can_cut = len(inside) >= 2 * LEAST_VERTICES and sides.max() > LEAST_SHARE * distance
        if cost <= most or not (can_shrink or can_cut):
            done.append(part)
        elif can_shrink and (sides.max() < 2 * part.distance or not can_cut):
            pending.append((part._replace(distance=part.distance / 2), rows))
        else:
            axis = int(sides.argmax())
            middle = float(np.median(places[inside, axis]))
            if not part.box[0, axis] < middle < part.box[1, axis]:
                middle = float(part.box[:, axis].mean())
            low, high = part.box.copy(), part.box.copy()
            low[1, axis] = high[0, axis] = middle
            pending += [(part._replace(box=high), near), (part._replace(box=low), near)]
    return done


class Local(NamedTuple):
    """A part of a tile among its surroundings.

    scene: the first chunk is the tile's own mesh in and near the part, the next ones are other meshes near it, the last
    ones are the coarse rest. near: number of chunks that are not coarse. rows: (N,) of the tile's mesh, the vertices of
    the first chunk. own: (N,) bool, those that belong to the part. shown: (V,) bool, the vertices of the scene whose
    own light is computed.
    """

    scene: Scene
    near: int
    rows: NDArray[np.int64]
    own: NDArray[np.bool_]
    shown: NDArray[np.bool_]


def tile_mesh(store: Store, tile: int) -> Mesh:
    """The mesh of a tile with faces."""
    return mesh_from_ply_bytes(store.read(f"{folder_of(tile)}/mesh.ply"))


class TileNeighborhood:
    """A tile, its neighbours, and the coarse city without the tiles below its horizon.

    mesh: of the tile. coarse: vertices of the coarse city. spacing: distance between stations, scene units.
    """

    def __init__(self, store: Store, city: CoarseCity, tile: int, spacing: float) -> None:
        """Read them."""
        self._city, self.spacing = city, spacing
        self._core, cores = city.cores[tile], city.cores
        self.mesh = tile_mesh(store, tile)
        box = grown(self._core, NEAR * spacing)
        touching = (cores[:, 0] < box[1]).all(axis=1) & (cores[:, 1] > box[0]).all(axis=1)
        apart = np.maximum(cores[:, 0] - self._core[1], self._core[0] - cores[:, 1])
        apart = np.linalg.norm(np.maximum(apart, 0.0), axis=1)
        lowest = self.mesh.vertices[:, 1].min()
        self._near: list[Mesh] = []
        self._far: list[Mesh] = []
        for other, distant in enumerate(city.coarse):
            if distant is None or distant.vertices[:, 1].max() - lowest < LOWEST * apart[other]:
                continue
            if touching[other] and other != tile:
                self._near.append(_part(tile_mesh(store, other), box, inside=True))
            beside = apart[other] < MIDDLE * spacing
            self._far.append(mesh_from_ply_bytes(store.read(f"{folder_of(other)}/{FAR}")) if beside else distant)
        self.coarse = sum(len(mesh.vertices) for mesh in self._far)

    def parts(self, most: float) -> list[TilePart]:
        """The parts in which the tile is lit, for at most `most` vertices at once."""
        around = [np.zeros((0, 2), np.float32), *(mesh.vertices[:, [0, 2]] for mesh in self._near)]
        own = self.mesh.vertices[:, [0, 2]]
        return parts_of(own, np.concatenate(around), self._core, NEAR * self.spacing, most)

    def gather(self, part: TilePart) -> Local:
        """A part of the tile among them."""
        mesh, box = self.mesh, part.grown
        own = part.holds(mesh.vertices[:, [0, 2]])
        chosen = _within(mesh, box) | own[mesh.faces].any(axis=1)
        rows = np.unique(np.concatenate([mesh.faces[chosen].ravel(), np.flatnonzero(own)]))
        faces = np.searchsorted(rows, mesh.faces[chosen]).astype(np.int32).reshape(-1, 3)
        near = [Mesh(mesh.vertices[rows], mesh.normals[rows], faces, mesh.colors_srgb[rows])]
        near += [each for each in (_part(mesh, box, inside=True) for mesh in self._near) if len(each.faces)]
        far = [each for each in (_part(mesh, box, inside=False) for mesh in self._far) if len(each.faces)]
        exact = grown(part.box, EXACT * self.spacing)
        shown = [within_box(each.vertices[:, [0, 2]], exact) for each in near]
        shown[0] |= own[rows]
        shown += [np.zeros(len(each.vertices), bool) for each in far]
        return Local(self._city.scene_of([*near, *far]), len(near), rows, own[rows], np.concatenate(shown))


def _within(mesh: Mesh, box: Floats) -> Mask:
    """(F,) bool: the faces of a Mesh whose middles lie in a box of x and z."""
    return within_box(mesh.vertices[mesh.faces].mean(axis=1)[:, [0, 2]], box)


def _part(mesh: Mesh, box: Floats, inside: bool) -> Mesh:
    """The faces of a Mesh whose middles lie in a box of x and z, or the other faces."""
    chosen = _within(mesh, box) == inside
    return mesh if chosen.all() else mesh.of_faces(chosen)
