"""A city of any size, block by block: streets, houses with gables, trees, on gently rolling ground.

Every block is a function of the seed and its position only, so a city of any size is written tile by tile and never
held in memory. Its light is that of the sky, shadowed by the block and the eight around it.
"""

import json
from dataclasses import replace

import numpy as np

from splat2mesh.base.outputs import staged_folder
from splat2mesh.splats.formats import write_inria_ply

from . import albedo, shapes
from .cameras import SCENE_FROM_SPLAT
from .kinds import SceneTruth
from .light import bake, exposure
from .places.solids import joined, moved, panel
from .sky import capture_sky
from .splat import splats_from

BLOCK_M = 30.0
"""Side of a block: a house in its garden, and half of the street on each side of it."""

SPLATS_OF_BLOCK = 24_000
"""Splats per block of a city with many blocks; smaller cities have four smaller blocks."""

ROAD_M, WALK_M = 3.0, 4.5
"""Half the width of the road, and of the road with its pavement, from the border of a block."""

EDGE_M = 0.9
"""Edge length of the tessellation, which limits the detail of the light."""

TREES = 4
SUNK_M = 0.3


def blocks_across(splats):
    """Blocks along one side of a city of `splats` splats."""
    return max(2, round(np.sqrt(splats / SPLATS_OF_BLOCK)))


def write_city(options):
    """Write the city of parsed options into a folder, tile by tile; summary lines and facts, as `console.run` wants.

    tiles/0000_0000.ply ... in the frame of a trained splat (y down), one for each block; truth.json says the rest.
    """
    environment, across = capture_sky(options.env), blocks_across(options.splats)
    each, more = divmod(options.splats, across * across)
    blocks, factor, vertices = {}, None, 0
    with staged_folder(options.out) as folder:
        (folder / "tiles").mkdir()
        for x in range(across):
            for z in range(across):
                truth, seen, own = _with_neighbors(options.seed, x, z, across, blocks)
                radiance = bake(truth, environment, len(own.vertices))
                factor = exposure(radiance) if factor is None else factor
                count = each + (x * across + z < more)
                seed = [options.seed, x, z]
                splats = splats_from(own, factor * radiance, count, seed, seen)
                write_inria_ply(folder / "tiles" / f"{x:04d}_{z:04d}.ply", splats)
                vertices += len(own.vertices)
        facts = {
            "kind": "city",
            "seed": options.seed,
            "environment": options.env,
            "exposure": float(factor),
            "splats": options.splats,
            "blocks": across * across,
            "block_m": BLOCK_M,
            "vertices": vertices,
            "scene_from_splat": SCENE_FROM_SPLAT.tolist(),
        }
        (folder / "truth.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    return [f"{options.out}: {options.splats} splats in {across * across} tiles"], facts


def _with_neighbors(seed, x, z, across, blocks):
    """A block with those around it as one SceneTruth, its own vertices first; which of its own faces are seen; and the
    block alone. blocks: the cache of built blocks, limited to those still needed."""
    around = [(x, z)] + [
        (x + i, z + j)
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if (i or j) and 0 <= x + i < across and 0 <= z + j < across
    ]
    for place in around:
        if place not in blocks:
            blocks[place] = block(seed, *place)
    for place in [place for place in blocks if place[0] < x - 1]:
        del blocks[place]
    own = blocks[x, z]
    points, faces = joined([(blocks[place].vertices, blocks[place].faces) for place in around])
    whole = replace(own, vertices=points, faces=faces.astype(np.int32))
    middle = own.vertices[own.faces].mean(axis=1)
    seen = middle[:, 1] > ground_height(middle[:, [0, 2]]) - 0.02
    return whole, seen, own


def ground_height(places):
    """Height of the ground in metres: (N, 2) x and z -> (N,)."""
    x, z = np.asarray(places, np.float64).T
    return 0.6 * np.sin(x / 37.0) + 0.5 * np.sin(z / 29.0 + 1.0)


def block(seed, x, z):
    """The block at whole coordinates x, z, which covers BLOCK_M from (x, z) * BLOCK_M: a SceneTruth in metres."""
    rng = np.random.default_rng([seed, x, z])
    corner = np.array([x, z]) * BLOCK_M
    parts = [_ground(corner, rng), *_house(corner, rng)]
    for place in _tree_places(rng):
        parts += _tree(corner + place, rng)
    return SceneTruth.of_solids("city", seed, parts)


def _ground(corner, rng):
    start = np.array([corner[0], 0.0, corner[1]])
    points, faces = panel(start, (0, 0, BLOCK_M), (BLOCK_M, 0, 0), EDGE_M)
    points[:, 1] = ground_height(points[:, [0, 2]])
    inside = np.minimum(points - start, start + BLOCK_M - points)[:, [0, 2]].min(axis=1)
    # Roads and pavements are the same in all blocks: what meets at a border has one colour.
    road, walk = np.array([0.09, 0.09, 0.1]), np.array([0.35, 0.34, 0.32])
    grass = albedo.mottled(points, np.array([0.09, 0.17, 0.05]), rng, 4.0)
    color = np.where((inside < WALK_M)[:, None], walk, grass)
    return points, faces, np.where((inside < ROAD_M)[:, None], road, color)


def _house(corner, rng):
    size = rng.uniform([7.0, 4.0, 7.0], [11.0, 12.0, 11.0])
    middle = corner + BLOCK_M / 2 + rng.uniform(-1.5, 1.5, 2)
    base = ground_height(middle[None])[0] - SUNK_M
    wall, roof = albedo.random_colors(rng, 2)
    box = moved(shapes.rounded_box(size, 0.08, EDGE_M), (middle[0], base + size[1] / 2, middle[1]))
    rise = rng.uniform(1.5, 3.0)
    slope = np.hypot(size[2] / 2 + 0.3, rise)
    tilt = np.degrees(np.arctan2(rise, size[2] / 2 + 0.3))
    top = base + size[1] + rise / 2
    sheets = [
        moved(
            shapes.rounded_box((size[0] + 0.6, 0.2, slope), 0.06, EDGE_M),
            (middle[0], top, middle[1] + side * (size[2] / 4 + 0.15)),
            tilt_deg=side * tilt,
        )
        for side in (-1, 1)
    ]
    solids = [(*box, albedo.stripes(box[0], [wall, 0.6 * wall], (0, 1, 0), 3.0))]
    return solids + [(*sheet, albedo.mottled(sheet[0], roof, rng, 2.0)) for sheet in sheets]


def _tree_places(rng):
    """Places of trees in the garden, beside the house, (M, 2) metres from the corner of the block."""
    near, far = WALK_M + 1.5, BLOCK_M - WALK_M - 1.5
    spots = np.array([(near, near), (near, far), (far, near), (far, far)])
    return spots[rng.permutation(len(spots))[: rng.integers(2, TREES + 1)]] + rng.uniform(-0.8, 0.8, 2)


def _tree(place, rng):
    base = ground_height(place[None])[0] - SUNK_M
    height, radius = rng.uniform(2.5, 4.0), rng.uniform(1.6, 2.6)
    stem = moved(
        shapes.rounded_box((0.5, height + radius, 0.5), 0.15, EDGE_M / 2),
        (place[0], base + (height + radius) / 2, place[1]),
    )
    crown = moved(shapes.blob(radius, 0.5, rng, EDGE_M / 2), (place[0], base + height + radius, place[1]))
    green = np.array([0.07, 0.14, 0.04]) * rng.uniform(0.8, 1.6)
    return [
        (*stem, albedo.mottled(stem[0], np.array([0.16, 0.11, 0.07]), rng, 0.5)),
        (*crown, albedo.mottled(crown[0], green, rng, 0.6)),
    ]
