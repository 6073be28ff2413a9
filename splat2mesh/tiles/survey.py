"""First passes over a city: a sample of every piece makes the plan; then every piece is divided among the tiles."""

from dataclasses import replace
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..splats.cleaning import REASONS, say_dropped, usable
from ..splats.extent import check_extent
from ..splats.facts import FileFacts, common
from ..splats.joining import joined
from ..splats.placing import placed
from ..splats.splats import MIN_SPLATS, NUMBERS, Splats
from ..surface.extract import FINEST_CELL, training_pixel
from ..views.upright import upright
from ..views.viewpoints import bounds_of
from .pieces import CityPiece, read_piece
from .plan import LEAST_PIXEL, REFERENCE_PIXELS, CityPlan, apart, cut, splats_for, within_box
from .store import Store
from .tasks import Task

SAMPLE = 1_000_000
"""Splats in a sample of a city, over all pieces: for its plan, and of far ones to tell sky from objects."""

PIXELS = {"draft": 128, "normal": REFERENCE_PIXELS, "fine": 256}
"""Side of the views by detail."""

OUTSIDE = 1.0
"""Reach of the city beyond the box of the solid splats, in distances between stations: the rest is far."""


def survey(store: Store, number: int, piece: CityPiece, most: int) -> dict[str, Any]:
    """Count a piece and keep a sample of at most `most` of its splats."""
    splats = read_piece(piece)
    keep, counts = usable(splats)
    rows = np.flatnonzero(keep)
    if splats.environment is not None:
        rows = rows[~splats.environment[rows]]
    chosen = rows[:: max(1, -(-len(rows) // most))]
    arrays = {name: getattr(splats, name)[chosen] for name in NUMBERS if name != "sh"}
    store.write_arrays(f"work/survey/{number:05d}.npz", **arrays, weight=len(rows) / max(len(chosen), 1))
    says = {} if splats.facts.up is None else {"up": splats.facts.up, "up_from": splats.facts.up_from}
    return {"splats": len(splats), "usable": len(rows), **counts, **says}


def survey_tasks(store: Store, pieces: list[CityPiece]) -> list[Task]:
    """The tasks that survey the pieces of a city."""
    most = max(1, SAMPLE // len(pieces))
    return [Task(f"survey {n}", survey, (store, n, piece, most)) for n, piece in enumerate(pieces)]


def plan_of(store: Store, pieces: list[CityPiece], counts: list[dict[str, Any]], settings: dict[str, Any]) -> CityPlan:
    """The CityPlan by the samples. Raises InputError for a city without splats."""
    sample, weights = _sample(store, len(pieces))
    if len(sample) < MIN_SPLATS:
        raise InputError(f"{len(sample)} usable splats: at least {MIN_SPLATS} are needed")
    check_extent(sample)
    said = [(tuple(count["up"]), count["up_from"]) if "up" in count else (None, "") for count in counts]
    facts = common([FileFacts(up=up, up_from=source) for up, source in said])
    rotation, up_from = upright(settings["up"], (), replace(sample, facts=facts), lambda: True)
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
        splats=sum(count["splats"] for count in counts),
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


def _sample(store: Store, count: int) -> tuple[Splats, np.ndarray]:
    parts, weights = [], []
    for number in range(count):
        kept = store.read_arrays(f"work/survey/{number:05d}.npz")
        weight = float(kept.pop("weight"))
        weights.append(np.full(len(kept["means"]), weight))
        parts.append(Splats(**kept, sh=np.zeros((len(kept["means"]), 1, 3), np.float32)))
    return joined(parts), np.concatenate(weights)


def deal(store: Store, key: str, number: int) -> dict[str, Any]:
    """Deal a piece out: splats/NUMBER_TILE.npz holds the splats of a tile, far_NUMBER.npz those of none, each with
    their rows in the piece; splats/NUMBER.json, which comes last, how many."""
    known = CityPlan.read(store, key)
    splats = read_piece(CityPiece(*known.pieces[number]))
    keep = usable(splats)[0]
    turned = placed(splats, known.rotation)
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
    store.write_json(f"splats/{number:05d}.json", record)
    return record


def splats_from(kept: dict[str, Any], rows: slice = slice(None)) -> Splats:
    """Splats of the arrays that `deal` writes, in the frame of their source."""
    x, y, z = kept["offset"].tolist()
    return Splats(**{field: kept[field][rows] for field in NUMBERS}, facts=FileFacts(offset=(x, y, z)))


def splats_of(
    store: Store,
    plan: CityPlan,
    sources: dict[int, list[int]],  # tile -> the pieces that hold splats of it
    box: np.ndarray | None = None,  # (2, 2) lowest and highest x and z to keep, all without
) -> Splats:
    """The usable splats of tiles in the scene frame: tile after tile, piece after piece."""
    parts = []
    for tile, pieces in sources.items():
        for number in pieces:
            kept = store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz")
            part = placed(Splats(**{field: kept[field] for field in NUMBERS}), plan.rotation)
            part = part.take(usable(part)[0])
            if box is not None:
                part = part.take(within_box(part.means[:, [0, 2]], box))
            parts.append(part)
    if not parts:
        means, scales, quats, opacities, sh = (np.zeros((0, *s), np.float32) for s in ((3,), (3,), (4,), (), (1, 3)))
        return Splats(means, scales, quats, opacities, sh)
    return joined(parts)


def say_all_dropped(counts: list[dict[str, Any]]) -> None:
    """Warn of unusable splats, all pieces together."""
    say_dropped({name: sum(count[name] for count in counts) for name in REASONS}, sum(c["splats"] for c in counts))
