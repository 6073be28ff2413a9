"""First passes over a city: a sample of every piece makes the plan; then every piece is divided among the tiles."""

from typing import Any, NamedTuple

import numpy as np

from ..base.errors import InputError
from ..splats.cleaning import REASONS, say_dropped, usable
from ..splats.extent import check_extent
from ..splats.facts import FileFacts
from ..splats.joining import joined
from ..splats.placing import placed
from ..splats.splats import MIN_SPLATS, NUMBERS, Splats
from ..surface.extract import FINEST_CELL, training_pixel
from ..views.upright import upright
from ..views.viewpoints import bounds_of
from .pieces import CityPiece, read_piece
from .plan import LEAST_PIXEL, REFERENCE_PIXELS, CityPlan, apart, cut, plan_at, splats_for, within_box
from .store import Store

SAMPLE = 1_000_000
"""Splats in a sample of a city, over all pieces: for its plan, and of far ones to tell sky from objects."""

PIXELS = {"draft": 128, "normal": REFERENCE_PIXELS, "fine": 256}
"""Side of the views by detail."""

OUTSIDE = 1.0
"""Reach of the city beyond the box of the solid splats, in distances between stations: the rest is far."""


class Found(NamedTuple):
    """A piece, counted. sample: some of its Splats, without harmonics. weight: splats that each stands for. counts: of
    all, and of what is unusable by reason."""

    sample: Splats
    weight: float
    counts: dict[str, int]


def survey(piece: CityPiece, most: int) -> Found:
    """Count a piece and take a sample of at most `most` of its usable splats."""
    splats = read_piece(piece)
    keep, counts = usable(splats)
    rows = np.flatnonzero(keep)
    if splats.environment is not None:
        rows = rows[~splats.environment[rows]]
    chosen = rows[:: max(1, -(-len(rows) // most))]
    arrays = {name: getattr(splats, name)[chosen] for name in NUMBERS if name != "sh"}
    facts = FileFacts(up=splats.facts.up, up_from=splats.facts.up_from if splats.facts.up else "")
    sample = Splats(**arrays, sh=np.zeros((len(chosen), 1, 3), np.float32), facts=facts)
    return Found(sample, len(rows) / max(len(chosen), 1), {"splats": len(splats), **counts})


def plan_of(pieces: list[CityPiece], found: list[Found], settings: dict[str, Any]) -> CityPlan:
    """The CityPlan by the samples. Raises InputError for a city without splats. Warns of unusable ones, all pieces
    together."""
    total = sum(each.counts["splats"] for each in found)
    say_dropped({name: sum(each.counts[name] for each in found) for name in REASONS}, total)
    weights = np.concatenate([np.full(len(each.sample), each.weight) for each in found])
    sample = joined([each.sample for each in found])
    if len(sample) < MIN_SPLATS:
        raise InputError(f"{len(sample)} usable splats: at least {MIN_SPLATS} are needed")
    check_extent(sample)
    rotation, up_from = upright(settings["up"], (), sample, lambda: True)
    turned = placed(sample, rotation)
    trained = training_pixel(turned)
    pixel = max(trained, LEAST_PIXEL * apart(turned.means.astype(np.float64), weights))
    plan = CityPlan(
        scene_from_splat=rotation.tolist(),
        up_from=up_from,
        pixel=pixel,
        finest=FINEST_CELL * pixel,
        low=[],
        high=[],
        tiles=[],
        counts=[],
        pieces=[list(piece) for piece in pieces],
        splats=total,
        pixels=PIXELS[settings["detail"]],
        trained=trained,
        settings=settings,
    )
    bounds = bounds_of(turned) + np.array([[-1.0], [1.0]]) * OUTSIDE * plan.spacing
    plan.low, plan.high = bounds.tolist()
    ground = turned.means[:, [0, 2]].astype(np.float64)
    inside = ((turned.means >= bounds[0]) & (turned.means <= bounds[1])).all(axis=1)
    solid = ground[inside]
    extent = np.stack([solid.min(axis=0), solid.max(axis=0)])
    most = splats_for(settings["memory"], settings["tile_splats"])
    plan.tiles, plan.counts = cut(solid, weights[inside], extent, plan.block, plan.reach, most)
    return plan


def deal(store: Store, key: str, number: int) -> dict[str, Any]:
    """Deal a piece out: splats/NUMBER_TILE.npz holds the splats of a tile, far_NUMBER.npz those of none, each with
    their rows in the piece; `dealt_of` it, which comes last, how many."""
    known = plan_at(store.root, key)
    splats = read_piece(CityPiece(*known.pieces[number]))
    keep = usable(splats)[0]
    turned = placed(splats, known.scene_from_splat)
    with np.errstate(invalid="ignore"):
        inside = keep & ((turned.means >= known.low) & (turned.means <= known.high)).all(axis=1)
    if splats.environment is not None:
        inside &= ~splats.environment
    owner = np.full(len(splats), -1, np.int64)
    owner[inside] = known.owner_of(turned.means[inside][:, [0, 2]])
    dealt = {}
    for tile in np.unique(owner):
        rows = np.flatnonzero(owner == tile)
        name = f"splats/{number:05d}_{tile:05d}.npz" if tile >= 0 else f"splats/far_{number:05d}.npz"
        fields = {field: getattr(splats, field)[rows] for field in NUMBERS}
        store.write_arrays(name, rows=rows, offset=np.array(splats.facts.offset), **fields)
        dealt[str(tile)] = len(rows)
    record = {"dealt": dealt, "dropped": int((~keep).sum())}
    store.write_json(dealt_of(number), record)
    return record


def dealt_of(number: int) -> str:
    """The record of a piece that was dealt out."""
    return f"splats/{number:05d}.json"


def sources_of(store: Store, plan: CityPlan) -> dict[int, list[int]]:
    """For each tile, and -1 for none, the pieces that hold splats of it, once all are dealt out."""
    sources: dict[int, list[int]] = {}
    for number in range(len(plan.pieces)):
        for tile in store.read_json(dealt_of(number))["dealt"]:
            sources.setdefault(int(tile), []).append(number)
    return sources


def splats_from(kept: dict[str, Any], rows: slice = slice(None)) -> Splats:
    """Splats of the arrays that `deal` writes, in the frame of their source."""
    x, y, z = kept["offset"].tolist()
    return Splats(**{field: kept[field][rows] for field in NUMBERS}, facts=FileFacts(offset=(x, y, z)))


def splats_of(
    store: Store,
    plan: CityPlan,
    sources: dict[int, list[int]],  # tile -> the pieces that hold splats of it
    box: np.ndarray,  # (2, 2) lowest and highest x and z to keep
) -> Splats:
    """The usable splats of tiles in the scene frame: tile after tile, piece after piece."""
    parts = []
    for tile, pieces in sources.items():
        for number in pieces:
            kept = store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz")
            part = placed(Splats(**{field: kept[field] for field in NUMBERS}), plan.scene_from_splat)
            part = part.take(usable(part)[0])
            parts.append(part.take(within_box(part.means[:, [0, 2]], box)))
    if not parts:
        means, scales, quats, opacities, sh = (np.zeros((0, *s), np.float32) for s in ((3,), (3,), (4,), (), (1, 3)))
        return Splats(means, scales, quats, opacities, sh)
    return joined(parts)
