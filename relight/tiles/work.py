"""The tasks of workers for a relit city: first one light for all tiles, from the coarse city; then tile by tile."""

import io
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
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
from ..engine.light_mix import LightKind, LightMix
from ..engine.relighter import Relighter
from ..lamps.asked import LampScale
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..options import LightingOptions
from ..output.relit_splats import BoundSplats, SplatLight, relit
from ..splats.binding import Binding
from ..splats.light_ratio import Usual, log_gain
from .background import background_of, far_splats, relit_background
from .local import NEAR, Local, TileNeighborhood, room_for
from .mixture import beside, lamps_near
from .shared import CityLight, Shared, coarse_city, shared_at, write_light
from .streamed import FOLDER, environment_files, tile_levels

CITY_METRE = 1.0
"""Splat units to a metre in a city: captures of that size are mostly placed by GPS, whose unit is a metre."""

DIAGONAL = 10.0
"""Size of the scene of a tile's splats, in distances between stations, for any size of tile and part. It decides how
far from the mesh a splat takes its light."""


class TileRequest(NamedTuple):
    """The request for every tile. albedo: of `city.ALBEDOS`. memory: GiB of a process, or None. spacing: distance
    between stations, scene units."""

    options: LightingOptions
    albedo: str
    formats: tuple[str, ...]
    memory: float | None
    spacing: float


def common_light(
    store: Store,
    folder: str,
    request: TileRequest,
    sky: Environment,
    ev: float | None,  # exposure in stops, if requested
    far: list[int],  # pieces whose far background is to be lit
) -> dict[str, Any]:
    """Estimate the captured light and the exposure from the coarse city, write FOLDER/light.npz, and return facts."""
    city, options, albedo = coarse_city(store), request.options, request.albedo
    scene = city.scene_of([mesh for mesh in city.coarse if mesh is not None])
    relighter = Relighter(scene, options)
    captured = scene.colors_linear
    facts: dict[str, Any] = {"vertices": len(captured)}
    colors: Any = None if albedo == "white" else captured
    before: Any = captured if albedo == "white" else np.ones_like(captured)
    known: dict[str, Any] = {}  # fields of the Light
    capture: dict[str, Any] | None = None
    if albedo == "estimated":
        found = estimate(relighter.occluder, captured, options.seed, transport=relighter.transport(CAPTURE))
        if found.separable:
            known, before = {"capture": found.environment.radiance, "prior": found.prior}, found.irradiance
        facts |= {
            "separable": bool(found.separable),
            "reason": found.reason,
            "evidence": round(float(found.evidence), 3),
        }
        colors = found.albedo
        capture = None if found.brightness is None else {"brightness": found.brightness}
    look = Appearance(colors, captured, before, capture=capture)
    mix = LightMix(options, options.placed, sky, relighter, look, exposure_ev=ev, metre=CITY_METRE)
    shading = mix.alone_under(sky)
    exposure = mix.exposure([sky], shading.radiance)
    received: Any = look.received(shading.radiance)
    if mix.kind.adds:
        level = mix.level(shading.radiance)
        known["beside"] = np.array([level, mix.scale.metre, mix.scale.irradiance, mix.scale.candela])
        received = beside(mix, level).shading(look, shading).received
        facts["lamps"] = len(mix.asked_lamps)
    after = received * np.float32(exposure)
    shares = vertex_areas(relighter.occluder)
    usual = Usual.of(before.astype(np.float64), after.astype(np.float64), shares)
    usual = usual._replace(gain=log_gain(captured, before, after, shares, usual)[1])
    if far:
        known["background"] = background_of(store, far, scene, before, after)
    shown = mix.captured_factor if mix.kind is LightKind.CAPTURED else mix.env_scale
    image = sky.radiance, sky.rotation_deg, sky.name, sky.formula or ""
    light = CityLight(*image, exposure, exposure * shown, usual, **known)
    return {**facts, "exposure": exposure, "sha256": write_light(store, folder, light)}


def relit_tile(
    store: Store,
    folder: str,
    key: str,  # of the shared light
    request: TileRequest,
    tile: int,
    sources: list[int],  # pieces with splats of the tile
) -> dict[str, Any]:
    """Light one tile: files of `formats` in FOLDER/tiles/TILE and FOLDER/sog, and their record, which is returned."""
    shared, name = shared_at(store.root, folder, key), f"{folder}/{folder_of(tile)}"
    files: dict[str, bytes] = {}
    facts: dict[str, Any] = {"tile": tile, "vertices": 0}
    splats = None
    if sources and {"splat", "sog"} & set(request.formats):  # as the source has them, in its frame
        parts = [store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz") for number in sources]
        splats = joined([splats_from(part) for part in parts])
    if shared.city.coarse[tile] is not None:
        around = TileNeighborhood(store, shared.city, tile, request.spacing)
        made, lit = _lit(shared, around, request, splats)
        files, facts = {f"{name}/{file}": data for file, data in made.items()}, facts | lit
    if splats is not None and "splat" in request.formats:
        files[f"{name}/splats.ply"] = inria_ply_bytes(splats)
    if splats is not None and "sog" in request.formats:
        levels, facts["leaves"] = tile_levels(splats, tile)
        files |= {f"{folder}/{file}": data for file, data in levels.items()}
    return store.commit(f"{name}/relit.json", files, **facts)


def _lit(
    shared: Shared, around: TileNeighborhood, request: TileRequest, splats: Splats | None
) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Light a tile in its parts: its files and facts for its record. splats: of the tile, which change in place."""
    mesh = around.mesh
    parts = around.parts(room_for(request.memory, 0 if splats is None else len(splats), around.coarse))
    radiance, places = np.zeros((len(mesh.vertices), 3), np.float32), np.zeros((0, 2))
    if splats is not None:
        matrix = shared.city.scene_from_splat[[0, 2]]
        with np.errstate(invalid="ignore", over="ignore"):  # splats that are not finite stand at 0
            places = np.nan_to_num(splats.means @ matrix[:, :3].T + matrix[:, 3])
    facts: dict[str, Any] = {"vertices": len(radiance), "parts": len(parts), "lit_with": 0, "nearest": NEAR}
    for part in parts:
        chosen = np.flatnonzero(part.holds(places))
        local = around.gather(part)
        lit, before, received, about = _lit_part(shared, local, request)
        radiance[local.rows[local.own]] = lit
        if splats is not None and len(chosen):
            splats.sh[chosen] = _relit_sh(splats.take(chosen), local, before, received, shared, request.spacing)
        facts["lit_with"] = max(facts["lit_with"], len(local.shown))
        facts["nearest"] = min(facts["nearest"], part.distance / around.spacing)
        facts |= {name: max(value, facts.get(name, 0)) for name, value in about.items()}
        del local, before, received
        give_back()
    shown = np.clip(radiance * np.float32(shared.light.exposure), 0.0, 1.0)
    files = {}
    if "glb" in request.formats:
        files["mesh.glb"] = glb_bytes(mesh, shown)
    if "ply" in request.formats:
        files["mesh.ply"] = mesh_ply_bytes(replace(mesh, colors_srgb=bytes_from_unit(srgb_from_linear(shown))))
    if "npy" in request.formats:
        buffer = io.BytesIO()
        np.save(buffer, radiance)
        files["radiance.npy"] = buffer.getvalue()
    facts["bounds"] = [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()]
    return files, facts


def _lit_part(
    shared: Shared, local: Local, request: TileRequest
) -> tuple[Radiance, Radiance, Radiance, dict[str, Any]]:
    """Of a part: radiance of its own vertices, the captured and the new irradiance of all, and facts for the record."""
    options, sky, light = request.options, shared.sky, shared.light
    relighter = Relighter(local.scene, options, shown=lambda: local.shown)
    captured = local.scene.colors_linear
    colors: Radiance | None = captured
    before = np.ones_like(captured)
    if request.albedo == "white":
        colors, before = None, captured
    elif light.capture is not None:
        known = Environment(light.capture, "the capture"), light.prior, options.seed
        colors, before = under_light(relighter.occluder, captured, *known, relighter.transport(CAPTURE))
    look, more = Appearance(colors, captured, before), None
    facts: dict[str, Any] = {}
    if light.beside is not None:
        level, *scale = light.beside.tolist()
        mix = LightMix(options, options.placed, sky, relighter, look, known_scale=LampScale(*scale))
        shown = local.scene.vertices[local.shown][:, [0, 2]].astype(np.float64)
        mix = replace(mix, asked_lamps=lamps_near(mix, shown.min(axis=0), shown.max(axis=0)))
        more, facts["lamps"] = beside(mix, level), len(mix.asked_lamps)
        del mix
    plan = None if isinstance(sky, CapturedLight) else relighter.plan_for(sky, colors)
    if plan is not None:
        relighter.precomputed.forget(plan.settings)  # used for the captured light alone
    shading = LightMix(options, (), sky, relighter, look).alone_under(sky)
    del relighter, plan  # which hold all that was traced
    give_back()
    facts = {"bands": shading.settings.bands, "rays": shading.settings.rays, "suns": shading.sun_count, **facts}
    received: Any = look.received(shading.radiance)
    if more is not None:
        shading = more.shading(look, shading)
        received = shading.received
    return shading.radiance[np.flatnonzero(local.own)], before, received, facts


def _relit_sh(
    splats: Splats, local: Local, before: Radiance, after: Radiance, shared: Shared, spacing: float
) -> Floats:
    """Colours of splats under the change of light of the mesh near them. The typical change is that of the whole city,
    and no fit in views takes place, since it would show at borders."""
    matrix = local.scene.scene_from_splat
    near = Scene(local.scene.chunks[: local.near], scene_from_splat=matrix)
    count, scale = near.vertex_count, float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    bound = Binding(splats, near, views=(), diagonal=DIAGONAL * spacing / scale)
    light = SplatLight(after[:count], shared.light.exposure, usual=shared.light.usual)
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
    shared, splats = shared_at(store.root, folder, key), far_splats(store, piece)
    light = shared.light
    if light.background is None:
        return splats
    matrix = shared.city.scene_from_splat
    return relit_background(splats, light.background, shared.sky, matrix, light.sky_exposure, sky)
