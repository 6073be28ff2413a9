"""The tasks of workers for a relit city: first one light for all tiles, from the coarse city; then tile by tile."""

import io
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_ply_bytes
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import usable
from splat2mesh.splats.formats.inria import inria_ply_bytes
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import Splats
from splat2mesh.tiles.memory import give_back
from splat2mesh.tiles.plan import folder_of
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.survey import splats_from
from splat2mesh.tiles.tileset import glb_bytes

from ..albedo import estimate
from ..albedo.estimate import under_light
from ..albedo.samples import vertex_areas
from ..engine.appearance import CAPTURE, Appearance
from ..engine.light_mix import LightMix
from ..engine.relighter import Relighter
from ..lamps.spec import asked_lamps
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..options import LightingOptions
from ..output.relit_splats import BoundSplats, SplatLight, relit
from ..splats.binding import Binding
from ..splats.light_ratio import Usual, log_gain
from .background import background_of, far_splats, relit_background
from .local import NEAR, Local, TileNeighborhood, far_scene, room_for
from .mixture import CityMixture
from .shared import Shared, coarse_city, read_sky, write_shared
from .streamed import FOLDER, environment_files, tile_levels

CITY_METRE = 1.0
"""Splat units to a metre in a city: captures of that size are mostly placed by GPS, whose unit is a metre."""

DIAGONAL = 10.0
"""Size of the scene of a tile's splats, in distances between stations, for any size of tile and part. It decides how
far from the mesh a splat takes its light."""


def common_light(
    store: Store,
    folder: str,
    options: LightingOptions,
    albedo: str,
    ev: float | None,
    far: list[int],  # pieces whose far background is to be lit
) -> dict[str, Any]:
    """Estimate the captured light and the exposure from the coarse city, write FOLDER/light.npz, and return facts."""
    shared = coarse_city(store, read_sky(store, folder))
    scene, sky = far_scene(shared), shared.sky
    relighter = Relighter(scene, options)
    captured = scene.colors_linear
    facts: dict[str, Any] = {"vertices": len(captured)}
    colors: Any = None if albedo == "white" else captured
    before: Any = captured if albedo == "white" else np.ones_like(captured)
    capture: dict[str, Any] | None = None
    if albedo == "estimated":
        found = estimate(relighter.occluder, captured, options.seed, transport=relighter.transport(CAPTURE))
        if found.separable:
            own = Environment(found.environment.radiance, "the capture")
            shared, before = shared._replace(capture=own, prior=found.prior), found.irradiance
        facts |= {
            "separable": bool(found.separable),
            "reason": found.reason,
            "evidence": round(float(found.evidence), 3),
        }
        colors = found.albedo
        capture = None if found.brightness is None else {"brightness": found.brightness}
    look = Appearance(colors, captured, before, capture=capture)
    mix = LightMix(options, asked_lamps(options.placed), sky, relighter, look, exposure_ev=ev, metre=CITY_METRE)
    shading = mix.alone_under(sky)
    exposure = mix.exposure([sky], shading.radiance)
    received: Any = look.received(shading.radiance)
    if mix.kind.adds:
        mixture = CityMixture.of(mix, mix.level(shading.radiance))
        received = mixture.beside(relighter, look).shading(look, shading).received
        shared = shared._replace(mixture=mixture)
        facts["lamps"] = len(mixture.lamps)
    shared = shared._replace(exposure=exposure)
    after = received * np.float32(exposure)
    shares = vertex_areas(relighter.occluder)
    usual = Usual.of(before.astype(np.float64), after.astype(np.float64), shares)
    gain = log_gain(captured, before, after, shares, usual)[1]
    shared = shared._replace(usual=usual._replace(gain=gain))
    if far:
        shared = shared._replace(background=background_of(store, far, scene, before, after))
    return {**facts, "exposure": exposure, "sha256": write_shared(store, folder, shared)}


class TileRequest(NamedTuple):
    """The request for every tile. albedo: of `city.ALBEDOS`. memory: GiB of a process, or None. spacing: distance
    between stations, scene units."""

    options: LightingOptions
    albedo: str
    formats: tuple[str, ...]
    memory: float | None
    spacing: float


def relit_tile(
    store: Store,
    folder: str,
    key: str,  # of the shared data
    request: TileRequest,
    tile: int,
    sources: list[int],  # pieces with splats of the tile
) -> dict[str, Any]:
    """Light one tile: files of `formats` in FOLDER/tiles/TILE and FOLDER/sog, and their record, which is returned."""
    shared = Shared.read(store, folder, key)
    name = f"{folder}/{folder_of(tile)}"
    files: dict[str, bytes] = {}
    facts: dict[str, Any] = {"tile": tile, "vertices": 0}
    splats = _source_splats(store, tile, sources) if {"splat", "sog"} & set(request.formats) else None
    if shared.coarse[tile] is not None:
        around = TileNeighborhood(store, shared, tile, request.spacing)
        files, facts, splats = _lit(shared, around, request, splats)
        facts = {"tile": tile, **facts}
    files = {f"{name}/{file}": data for file, data in files.items()}
    if splats is not None and "splat" in request.formats:
        files[f"{name}/splats.ply"] = inria_ply_bytes(splats)
    if splats is not None and "sog" in request.formats:
        levels, facts["leaves"] = tile_levels(splats, tile)
        files |= {f"{folder}/{file}": data for file, data in levels.items()}
    return store.commit(f"{name}/relit.json", files, **facts)


def _lit(
    shared: Shared, around: TileNeighborhood, request: TileRequest, splats: Splats | None
) -> tuple[dict[str, bytes], dict[str, Any], Splats | None]:
    """A tile in its parts: its files, facts for its record, and its splats."""
    mesh, exposure = around.mesh, shared.exposure
    parts = around.parts(room_for(request.memory, 0 if splats is None else len(splats), around.coarse))
    radiance = np.zeros((len(mesh.vertices), 3), np.float32)
    places = None if splats is None else _places(splats, shared)
    sh = None if splats is None else splats.sh.copy()
    facts: dict[str, Any] = {"vertices": len(radiance), "parts": len(parts), "lit_with": 0, "nearest": NEAR}
    for part in parts:
        chosen = np.zeros(0, np.int64) if places is None else np.flatnonzero(part.holds(places))
        bound = splats.take(chosen) if splats is not None and len(chosen) else None
        local = around.gather(part)
        radiance[local.rows[local.own]], relit, lit_facts = _lit_part(shared, local, request, bound)
        if sh is not None and relit is not None:
            sh[chosen] = relit
        facts["lit_with"] = max(facts["lit_with"], len(local.shown))
        facts["nearest"] = min(facts["nearest"], part.distance / around.spacing)
        facts |= {name: max(value, facts.get(name, 0)) for name, value in lit_facts.items()}
        del local
        give_back()
    shown = np.clip(radiance * np.float32(exposure), 0.0, 1.0)
    files = {}
    if "glb" in request.formats:
        files["mesh.glb"] = glb_bytes(mesh.vertices, mesh.normals, mesh.faces, shown)
    if "ply" in request.formats:
        colored = Mesh(mesh.vertices, mesh.normals, mesh.faces, bytes_from_unit(srgb_from_linear(shown)))
        files["mesh.ply"] = mesh_ply_bytes(colored)
    if "npy" in request.formats:
        buffer = io.BytesIO()
        np.save(buffer, radiance)
        files["radiance.npy"] = buffer.getvalue()
    if splats is not None and sh is not None:
        splats = replace(splats, sh=sh)
    bounds = [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()]
    return files, facts | {"bounds": bounds}, splats


def _lit_part(
    shared: Shared, local: Local, request: TileRequest, splats: Splats | None
) -> tuple[Radiance, Floats | None, dict[str, Any]]:
    """Of a part: radiance of its own vertices, the colours of its splats or None, and facts for the record."""
    relighter = Relighter(local.scene, request.options, shown=lambda: local.shown)
    captured = local.scene.colors_linear
    colors, before = _albedo(relighter, captured, shared, request.albedo, request.options.seed)
    mixture, beside, look = None, None, Appearance(colors, captured, before)
    if shared.mixture is not None:
        shown = local.scene.vertices[local.shown][:, [0, 2]].astype(np.float64)
        mixture = shared.mixture.near(shown.min(axis=0), shown.max(axis=0), request.options.accepted_error)
        beside = mixture.beside(relighter, look)
    plan = None if isinstance(shared.sky, CapturedLight) else relighter.plan_for(shared.sky, colors)
    if plan is not None:
        relighter.precomputed.forget(plan.settings)  # used for the captured light alone
    shading = LightMix(request.options, (), shared.sky, relighter, look).alone_under(shared.sky)
    del relighter, plan  # which hold all that was traced
    give_back()
    received: Any = look.received(shading.radiance)
    if beside is not None:
        shading = beside.shading(look, shading)
        received = shading.received
    own = np.flatnonzero(local.own)
    facts = {"bands": shading.settings.bands, "rays": shading.settings.rays, "suns": shading.sun_count}
    if mixture is not None:
        facts["lamps"] = len(mixture.lamps)
    relit = None
    if splats is not None:
        relit = _relit_sh(splats, local, before, received, shared, request.spacing)
    return shading.radiance[own], relit, facts


def _places(splats: Splats, shared: Shared) -> Floats:
    """x and z of splats in the scene frame, (N, 2); 0 for non-finite splats."""
    matrix = shared.scene_from_splat
    with np.errstate(invalid="ignore", over="ignore"):
        return np.nan_to_num(splats.means @ matrix[[0, 2], :3].T + matrix[[0, 2], 3])


def _albedo(
    relighter: "Relighter", captured: Radiance, shared: Shared, choice: str, seed: int
) -> tuple[Radiance | None, Radiance]:
    """Albedo (V, 3) or None for white, and the captured irradiance, (V, 3)."""
    if choice == "white":
        return None, captured
    if shared.capture is None:
        return captured, np.ones_like(captured)
    light, prior = shared.capture, shared.prior
    return under_light(relighter.occluder, captured, light, prior, seed, relighter.transport(CAPTURE))


def _source_splats(store: Store, tile: int, sources: list[int]) -> Splats | None:
    """The splats of a tile as the source has them, in its frame, or None."""
    parts = [store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz") for number in sources]
    return joined([splats_from(part) for part in parts]) if parts else None


def _relit_sh(
    splats: Splats, local: Local, before: Radiance, after: Radiance, shared: Shared, spacing: float
) -> Floats:
    """Colours of splats under the change of light of the mesh near them. The typical change is that of the whole city,
    and no fit in views takes place, since it would show at borders."""
    matrix = local.scene.scene_from_splat
    near = Scene(local.scene.chunks[: local.near], scene_from_splat=matrix)
    count, scale = near.vertex_count, float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    bound = Binding(splats, near, views=(), diagonal=DIAGONAL * spacing / scale)
    light = SplatLight(after[:count], shared.exposure, usual=shared.usual)
    return relit(BoundSplats(bound, before[:count]), light).sh


def relit_far(store: Store, folder: str, key: str, piece: int, sky: str) -> dict[str, Any]:
    """The far background of a piece in the new light: FOLDER/far/PIECE.ply."""
    name, splats = f"{folder}/far/{piece:05d}", _far(store, folder, key, piece, sky)
    return store.commit(f"{name}.json", {f"{name}.ply": inria_ply_bytes(splats)}, piece=piece, splats=len(splats))


def relit_environment(store: Store, folder: str, key: str, pieces: list[int], sky: str) -> dict[str, Any]:
    """The far background of all pieces in the new light, as that of a streamed SOG: FOLDER/sog/env."""
    parts = [_far(store, folder, key, piece, sky) for piece in pieces]
    whole = joined([part.take(usable(part)[0]) for part in parts])
    files = environment_files(whole) if len(whole) else {}
    files = {f"{folder}/{name}": data for name, data in files.items()}
    return store.commit(f"{folder}/{FOLDER}/environment.json", files, splats=len(whole))


def _far(store: Store, folder: str, key: str, piece: int, sky: str) -> Splats:
    shared, splats = Shared.read(store, folder, key), far_splats(store, piece)
    if shared.background is None:
        return splats
    return relit_background(splats, shared.background, shared.sky, shared.scene_from_splat, shared.sky_exposure, sky)
