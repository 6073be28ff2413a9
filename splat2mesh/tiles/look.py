"""The views from the stations of a tile: depth maps, each made once, by the tile that contains the station.

All tiles that need a depth map read the same one, so the data of two tiles on their common border are equal to the bit.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..base.arrays import DepthMap, Floats
from ..render.opacityfield import FieldDepth
from ..render.view import View
from ..splats.splats import REACH, Splats
from ..surface.extract import PROBE_PIXELS, PROBES, dilated
from ..surface.place import DILATION, LEVEL
from ..surface.sight import FusionSight, Sighting
from ..views.eyes import Eye, around
from .plan import INFLUENCE, RING, CityPlan, grown, plan_at
from .stations import stations_of
from .store import Store
from .survey import splats_of

DEEPEST = 8
"""Blocks along z by which a point may miss what a pixel shows and take its colour: 14 along the ray in the corner of a
view, so the pixel lies in the range of all tiles on whose border the point stands."""

UP = np.array([0.0, 1.0, 0.0])


def probe(store: Store, key: str, tile: int, sources: dict[int, list[int]]) -> list[float]:
    """Thickness of the surfaces that a few stations of a tile see, over their distance: a sample of it."""
    known = plan_at(store.root, key)
    splats, stations = _prepare(store, known, tile, sources)
    chosen = stations[:: max(1, len(stations) // PROBES)]
    ratios = []
    for view, near in zip(*around(chosen, PROBE_PIXELS, UP), strict=True):
        shot = Sighting.taken(splats, view, near)
        ratio = (shot.thickness / shot.seen.depth).ravel()[::7]
        ratios += ratio[np.isfinite(ratio)].tolist()
    return ratios


def sights_of(tile: int) -> str:
    """The file of a tile's depth maps."""
    return f"work/sights/{tile:05d}.npz"


def look(store: Store, key: str, tile: int, sources: dict[int, list[int]]) -> None:
    """Make the depth maps of a tile's stations: `sights_of` it, with lowest and highest x and z of what they show."""
    known = plan_at(store.root, key)
    splats, stations = _prepare(store, known, tile, sources)
    views, near = around(stations, known.pixels, UP)
    kept: list[dict[str, Any]] = []
    sizes = splats.scales.max(axis=1, initial=0.0)
    for number, (view, plane) in enumerate(zip(views, near, strict=True)):
        if number % 6 == 0:  # views of one station
            away = np.linalg.norm(splats.means - view.center.astype(np.float32), axis=1)
            reached = splats.take(np.flatnonzero(away <= known.reach + REACH * sizes))
        _, seen, thickness = Sighting.taken(reached, view, plane, LEVEL)
        rays = np.linalg.norm(view.ray_directions(), axis=-1)
        with np.errstate(invalid="ignore"):
            depth = np.where(seen.depth * rays <= known.reach, seen.depth, np.nan).astype(np.float32)
        if not np.isfinite(depth).any():
            continue
        points = _ground_of(view, depth).reshape(-1, 2)
        kept.append(
            {
                "poses": view.camera_from_world,
                "focal": view.fx,
                "bounds": np.stack([np.nanmin(points, axis=0), np.nanmax(points, axis=0)]),
                "depth": depth,
                "normal": seen.normal.astype(np.float16),
                "spread": seen.spread.astype(np.float32),
                "thickness": thickness.astype(np.float32),
                "color": np.clip(np.round(255 * np.nan_to_num(seen.color)), 0, 255).astype(np.uint8),
            }
        )
    arrays = {name: np.array([each[name] for each in kept]) for name in (kept[0] if kept else ())}
    store.write_arrays(sights_of(tile), views=len(kept), **arrays)


def _prepare(store: Store, plan: CityPlan, tile: int, sources: dict[int, list[int]]) -> tuple[Splats, list[Eye]]:
    """The splats of a tile and all that its stations see, as training saw them, and its stations."""
    core = plan.core(tile)
    splats = splats_of(store, plan, sources, grown(core, plan.reach))
    stations = stations_of(splats.means, splats.opacities, core, plan.spacing)
    if len(splats):
        splats = splats.take(splats.spatial_order())
    return dilated(splats, DILATION * plan.trained), stations


def shots_around(store: Store, plan: CityPlan, tile: int) -> Iterator[Sighting]:
    """The views that show a tile and its ring, in an order that all tiles share. A view counts if one of its surface
    points lies near enough to matter: all others leave no trace there."""
    low, high = _range(plan, tile)
    for other in plan.seers(tile):
        kept = store.read_arrays(sights_of(other))
        if not kept["views"]:
            continue
        touching = (kept["bounds"][:, 0] < high).all(axis=1) & (kept["bounds"][:, 1] >= low).all(axis=1)
        for row in np.flatnonzero(touching):
            size = kept["depth"].shape[1]
            focal = float(kept["focal"][row])
            view = View(size, size, focal, focal, size / 2, size / 2, kept["poses"][row])
            depth = kept["depth"][row]
            points = _ground_of(view, depth)
            with np.errstate(invalid="ignore"):
                if not ((points >= low) & (points < high)).all(axis=-1).any():
                    continue
            normal = kept["normal"][row].astype(np.float32)
            normal /= np.maximum(np.sqrt((normal * normal).sum(axis=-1, keepdims=True)), 1e-6)
            color = kept["color"][row].astype(np.float32) / np.float32(255)
            spread = np.minimum(kept["spread"][row], np.float32(DEEPEST * plan.block))
            seen = FieldDepth(depth, normal, spread, color, np.isfinite(depth).astype(np.float32))
            yield Sighting(view, seen, kept["thickness"][row])


def _ground_of(view: View, depth: DepthMap) -> Floats:
    """(H, W, 2) x and z of a view's surface points."""
    return (view.center + view.ray_directions() * depth[..., None])[..., [0, 2]]


def sight_of(shot: Sighting, plan: CityPlan, tile: int) -> FusionSight:
    """A view ready for fusion in a tile's ring: its cells are no larger than a block, it reaches no farther than
    INFLUENCE, and pixels that cannot reach the ring are left out."""
    sight = FusionSight.of(shot, plan.spacing, plan.finest, plan.fog)
    low, high = _range(plan, tile)
    points = _ground_of(shot.view, shot.seen.depth)
    with np.errstate(invalid="ignore"):
        step = np.minimum(sight.step, np.float32(plan.block))
        spread = np.minimum(sight.spread, np.float32(plan.block))
        near = ((points >= low) & (points < high)).all(axis=-1)
    return FusionSight(sight.view, sight.plane, np.where(near, sight.weight, np.float32(0)), spread, step)


def _range(plan: CityPlan, tile: int) -> Floats:
    """Lowest and highest x and z of the surface points that affect a tile's ring: (2, 2)."""
    return grown(plan.core(tile), (RING + INFLUENCE) * plan.block)
