"""Places: gardens, streets and rooms with paints, leaves, lamps and windows, and the paths of a visitor."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from splat2mesh.base.errors import InputError

from .. import shapes
from ..kinds import SceneTruth
from . import blocks, courtyard, garden, hard, lounge, nook, street
from .solids import joined

CARD_SHARE = 0.6
"""Share of a place's vertices for leaves and blades, if it has any; the rest is for solids."""

THICKNESS = 4e-3
"""Between the two sides of a leaf, as a share of its size: only rays must distinguish them."""

PLACES = {
    "blocks": blocks.blocks,
    "garden": garden.garden,
    "lounge": lounge.lounge,
    "nook": nook.nook,
    "courtyard": courtyard.courtyard,
    "street": street.street,
    "closed-box": hard.closed_box,
    "forest": hard.forest,
    "cabinet": hard.cabinet,
    "one-window": hard.one_window,
    "white-sky": hard.white_sky,
}
"""The functions that furnish each kind of place: called with a Furnishing and a random generator."""


@dataclass(frozen=True)
class Place(SceneTruth):
    """A place known exactly, scene frame in metres. Its vertices are those of the solids, then those of the leaves.

    Solids may be open sheets where their back is invisible. Each leaf is two quads of four vertices, front then back.
    emitted: (V, 3) float32 linear radiance that lamps give off, in units of the environment's.
    volume: (V,) bool, foliage and grass: not a surface.
    leaf_start: the first vertex of the leaves. transmittance: what share of the light on one side of a leaf shows
    on the other.
    openings: (W, 3, 3) corner and two edges of each rectangle through which light enters a place closed otherwise;
    their cross product points inward. None for an open place.
    paints: one a part, callables of `scenes.textures`, or None where the albedo lies in the vertices alone.
    walk: called with a number in [0, 1) for each eye (C,) and returns eyes, targets (C, 3) and the field of view.
    """

    emitted: np.ndarray
    volume: np.ndarray
    leaf_start: int
    transmittance: float
    openings: np.ndarray | None
    paints: tuple
    walk: Callable

    @property
    def leaves(self):
        """Corners of the leaves' fronts: (C, 4, 3) float32, a view."""
        return self.vertices[self.leaf_start :].reshape(-1, 8, 3)[:, :4]

    def albedo(self, points, normals, parts, interpolated):
        """Linear albedo (N, 3) at points of the surface, as fine as the paints are.

        parts: (N,) of each point. interpolated: (N, 3) albedo of the mesh there, where a part has no paint.
        """
        color = np.array(interpolated, np.float32)
        for part in np.unique(parts):
            if self.paints[part] is not None:
                rows = parts == part
                color[rows] = self.paints[part](points[rows].astype(np.float64), normals[rows])
        return color


class Furnishing:
    """The parts of a kind of place, at one tessellation.

    edge: wanted edge of the solids in metres. leaves_wanted: how many leaves the place should have in all.
    """

    def __init__(self, edge, leaves_wanted):
        self.edge, self.leaves_wanted = edge, leaves_wanted
        self.solids, self.leaves = [], []
        self.transmittance, self.openings, self.walk = 0.0, None, None

    def add(self, solids, paint, emitted=(0, 0, 0), volume=False):
        """Solids of one part: a solid or a list. paint: of scenes.textures, or a colour (3,) for all, or a list."""
        solids = solids if isinstance(solids, list) else [solids]
        points, faces = joined(solids)
        if isinstance(paint, list):
            paint = np.repeat(np.asarray(paint, float), [len(solid) for solid, _ in solids], axis=0)
        self.solids.append((points, faces, paint, emitted, volume))

    def add_leaves(self, cards, color, rng, spread=0.22):
        """Leaves, (C, 4, 3), of one part. color: (3,) or (C, 3) linear; each leaf is lighter or darker by `spread`."""
        tone = np.exp(spread * rng.normal(size=(len(cards), 1)) + 0.5 * spread * rng.normal(size=(len(cards), 3)))
        self.leaves.append((cards, np.clip(np.asarray(color) * tone, 0.015, 0.85)))


def build_place(kind, seed=0, vertices=60_000):
    """The place of one kind and seed with about `vertices` vertices: a Place.

    The seed changes proportions, colours and every leaf; in blocks, courtyards and streets also what stands there.
    Raises InputError for an unknown kind or fewer than 1,000 vertices.
    """
    if kind not in PLACES:
        raise InputError(f"--kind {kind}: expected one of {' '.join(PLACES)}")
    if vertices < 1000:
        raise InputError(f"--vertices {vertices}: expected at least 1000, fewer cannot show the shapes")
    edge = 4.0 / np.sqrt(vertices)
    for step in range(4):
        made = Furnishing(edge, round(CARD_SHARE * vertices / 8))
        PLACES[kind](made, np.random.default_rng(seed))
        solid, leafy = sum(len(part[0]) for part in made.solids), 8 * sum(len(part[0]) for part in made.leaves)
        if step < 3:
            edge *= np.clip(np.sqrt(solid / max(vertices - leafy, 0.2 * vertices)), 0.4, 2.5)
    return _assembled(kind, seed, made)


def _assembled(kind, seed, made):
    counts = [len(part[0]) for part in made.solids]
    points, faces = joined([part[:2] for part in made.solids])
    normals, albedo, first = shapes.vertex_normals(points, faces), np.empty(points.shape), 0
    for (own, _, paint, _, _), count in zip(made.solids, counts, strict=True):
        rows = slice(first, first + count)
        albedo[rows] = paint(own, normals[rows]) if callable(paint) else paint
        first += count
    emitted = np.repeat([part[3] for part in made.solids], counts, axis=0)
    part = np.repeat(np.arange(len(counts)), counts)
    volume = np.repeat([part[4] for part in made.solids], counts)
    start = len(points)
    if made.leaves:
        cards = np.concatenate([cards for cards, _ in made.leaves])
        color = np.concatenate([color for _, color in made.leaves])
        normal = np.cross(cards[:, 1] - cards[:, 0], cards[:, 3] - cards[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        gap = 0.5 * THICKNESS * np.linalg.norm(cards[:, 2] - cards[:, 0], axis=1)[:, None, None] * normal[:, None]
        both = np.concatenate([cards + gap, cards - gap], axis=1)
        first = start + 8 * np.arange(len(cards))[:, None]
        quads = first + np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]).reshape(-1)
        points, faces = np.concatenate([points, both.reshape(-1, 3)]), np.concatenate([faces, quads.reshape(-1, 3)])
        sides = np.repeat(np.stack([normal, -normal], axis=1), 4, axis=1).reshape(-1, 3)
        normals, albedo = np.concatenate([normals, sides]), np.concatenate([albedo, np.repeat(color, 8, axis=0)])
        emitted = np.concatenate([emitted, np.zeros_like(sides)])
        numbers = len(counts) + np.arange(len(made.leaves))
        part = np.concatenate([part, np.repeat(numbers, [8 * len(cards) for cards, _ in made.leaves])])
        volume = np.concatenate([volume, np.ones(len(sides), bool)])
    return Place(
        kind,
        seed,
        points.astype(np.float32),
        normals.astype(np.float32),
        faces.astype(np.int32),
        albedo.astype(np.float32),
        part.astype(np.uint8),
        emitted.astype(np.float32),
        volume,
        start,
        made.transmittance,
        made.openings,
        (*(part[2] if callable(part[2]) else None for part in made.solids), *(None for _ in made.leaves)),
        made.walk,
    )
