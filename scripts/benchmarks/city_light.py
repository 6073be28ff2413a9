"""Error of the light of tiles against the light of the untiled place around them: `scripts/bench city --parts
light`."""

import io
import time

import numpy as np

from relight import Environment, LightingOptions
from relight.options import PLACE_TOLERANCE
from relight.splats.light_ratio import Usual
from relight.tiles.local import tile_mesh
from relight.tiles.shared import CityLight, coarse_city, write_light
from relight.tiles.work import TileRequest, relit_tile
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from splat2mesh.scene.scene import Scene
from splat2mesh.tiles.plan import FILE, CityPlan, folder_of
from splat2mesh.tiles.store import Store

FOLDER = "relit/benchmark"

REACH = 6.0
"""Distances between stations around a tile within which the truth is unsimplified; beyond, both are coarse. Three
times what a tile sees unsimplified."""

DIRECTIONS = 8192
"""Of the light, for the truth: one ray for each and each vertex."""


def light_error(scene, light, tiles, vertices, memory=None, seed=0):
    """Light random tiles of a meshed city, white, within the tolerance of places, and compare random vertices.

    light: what `Environment.load` takes. Returns a dict: error, relative root mean square of radiance over all
    vertices; worst, that of the worst tile; cpu, seconds for a tile.
    """
    store = Store(scene)
    plan, sky = CityPlan(**store.read_json(FILE)["plan"]), Environment.load(light)
    usual = Usual(np.ones(3), np.ones(3))  # no splats are lit
    coarse_meshes = coarse_city(store).coarse
    key = write_light(store, FOLDER, CityLight(sky.radiance, 0.0, sky.name, sky.formula or "", 1.0, 1.0, usual))
    rng = np.random.default_rng(seed)
    full = [tile for tile, mesh in enumerate(coarse_meshes) if mesh is not None]
    chosen = np.sort(rng.choice(full, min(tiles, len(full)), replace=False)).tolist()
    found, truth, spent = [], [], 0.0
    try:
        for tile in chosen:
            start, options = time.process_time(), LightingOptions(tolerance=PLACE_TOLERANCE)
            relit_tile(store, FOLDER, key, TileRequest(options, "white", ("npy",), memory, plan.spacing), tile, [])
            spent += time.process_time() - start
            radiance = np.load(io.BytesIO(store.read(f"{FOLDER}/{folder_of(tile)}/radiance.npy")))
            near = [other for other in plan.near(tile, REACH * plan.spacing) if other != tile and other in full]
            coarse = [coarse_meshes[other] for other in full if other not in {tile, *near}]
            place = Scene([tile_mesh(store, tile), *(tile_mesh(store, other) for other in near), *coarse])
            rows = np.sort(rng.choice(len(radiance), min(-(-vertices // len(chosen)), len(radiance)), replace=False))
            truth.append(reference(Occluder(place.vertices, place.normals, place.faces), rows, sky, DIRECTIONS))
            found.append(radiance[rows])
    finally:
        store.remove(FOLDER)
    errors = [_relative(*pair) for pair in zip(found, truth, strict=True)]
    whole = _relative(np.concatenate(found), np.concatenate(truth))
    return {
        "tiles": len(chosen),
        "vertices": sum(map(len, found)),
        "error": whole,
        "worst": max(errors),
        "cpu": spent / len(chosen),
    }


def _relative(found, truth):
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))
