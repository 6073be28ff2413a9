"""What workers do for a relit city: one light for all tiles, found on the coarse city; then tile by tile."""

import io
from typing import Any

import numpy as np

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import mesh_ply_bytes
from splat2mesh.splats.formats.inria import inria_ply_bytes
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import NUMBERS, Splats, usable
from splat2mesh.tiles.glb import glb_bytes
from splat2mesh.tiles.plan import folder_of
from splat2mesh.tiles.store import Store

from ..engine.appearance import CAPTURE, LEAST_ALBEDO
from ..light.environment import Environment
from ..options import LightingOptions
from .background import background_of, far_splats, relit_background
from .local import far_scene, local_scene
from .shared import Shared, coarse_city, read_sky, write_shared
from .streamed import FOLDER, environment_files, tile_levels


def common_light(
    store: Store,
    folder: str,
    options: LightingOptions,
    albedo: str,
    ev: float | None,
    far: list[int],  # pieces whose far background is to be lit
) -> dict[str, Any]:
    """Tell the light of the capture and the exposure from the coarse city: FOLDER/light.npz; what it is like."""
    from ..albedo import estimate
    from ..engine.relighter import Relighter
    from ..light.tonemap import auto_exposure

    shared = coarse_city(store, read_sky(store, folder))
    scene, sky = far_scene(shared), shared.sky
    relighter = Relighter(scene, options)
    captured = scene.colors_linear
    told: dict[str, Any] = {"vertices": len(captured)}
    colors: Any = None if albedo == "white" else captured
    before: Any = captured if albedo == "white" else np.ones_like(captured)
    brightness: Any = None
    if albedo == "estimated":
        found = estimate(relighter.occluder, captured, options.seed, **relighter.computed(CAPTURE))
        if found.separable:
            capture = Environment(found.environment.radiance, "the capture")
            shared, before = shared._replace(capture=capture, prior=found.prior), found.irradiance
        told |= {
            "separable": bool(found.separable),
            "reason": found.reason,
            "evidence": round(float(found.evidence), 3),
        }
        colors, brightness = found.albedo, found.brightness
    radiance: Any = relighter.shade(sky, colors) if ev is None or far else None
    exposure = 2.0**ev if ev is not None else auto_exposure(radiance)
    if ev is None and brightness is not None and sky.mean_luminance > 0:
        exposure = float(min(max(brightness / sky.mean_luminance, exposure / 2.0), exposure * 2.0))
    shared = shared._replace(exposure=float(exposure))
    if far:
        after = _received(radiance, colors) * np.float32(exposure)
        shared = shared._replace(background=background_of(store, far, scene, before, after))
    return {**told, "exposure": float(exposure), "sha256": write_shared(store, folder, shared)}


def relit_tile(
    store: Store,
    folder: str,
    key: str,  # of what all tiles share
    options: LightingOptions,
    albedo: str,
    formats: tuple[str, ...],
    tile: int,
    sources: list[int],
    distance: float,
) -> dict[str, Any]:
    """Light one tile: files of `formats` in FOLDER/tiles/TILE and FOLDER/sog, and their record, which is returned."""
    shared = Shared.kept(store, folder, key)
    name = f"{folder}/{folder_of(tile)}"
    files: dict[str, bytes] = {}
    facts: dict[str, Any] = {"tile": tile, "vertices": 0}
    splats = _source(store, tile, sources) if {"splat", "sog"} & set(formats) else None
    if shared.coarse[tile] is not None:
        files, facts, splats = _lit(store, shared, options, albedo, formats, tile, splats, distance)
    files = {f"{name}/{file}": data for file, data in files.items()}
    if splats is not None and "splat" in formats:
        files[f"{name}/splats.ply"] = inria_ply_bytes(splats)
    if splats is not None and "sog" in formats:
        levels, facts["leaves"] = tile_levels(splats, tile)
        files |= {f"{folder}/{file}": data for file, data in levels.items()}
    return store.commit(f"{name}/relit.json", files, **facts)


def _lit(store, shared, options, albedo, formats, tile, splats, distance):
    from ..engine.relighter import Relighter

    local, exposure = local_scene(store, shared, tile, distance), shared.exposure
    relighter = Relighter(local.scene, options)
    captured = local.scene.colors_linear
    colors, before = _albedo(relighter, captured, shared, albedo, options.seed)
    shading = relighter.shading(shared.sky, colors)
    own = slice(0, local.own)
    radiance = shading.radiance[own]
    mesh = local.scene.chunks[0]
    shown = np.clip(radiance * np.float32(exposure), 0.0, 1.0)
    files = {}
    if "glb" in formats:
        files["mesh.glb"] = glb_bytes(mesh.vertices, mesh.normals, mesh.faces, shown)
    if "ply" in formats:
        relit = Mesh(mesh.vertices, mesh.normals, mesh.faces, bytes_from_unit(srgb_from_linear(shown)))
        files["mesh.ply"] = mesh_ply_bytes(relit)
    if "npy" in formats:
        buffer = io.BytesIO()
        np.save(buffer, radiance)
        files["radiance.npy"] = buffer.getvalue()
    if splats is not None:
        splats = _relit_splats(splats, local, before, _received(shading.radiance, colors), exposure)
    bounds = [mesh.vertices.min(axis=0).tolist(), mesh.vertices.max(axis=0).tolist()]
    facts = {"tile": tile, "vertices": len(radiance), "lit_with": len(captured), "bounds": bounds}
    facts |= {"bands": shading.settings.bands, "rays": shading.settings.rays, "suns": shading.sun_count}
    return files, facts, splats


def _received(radiance, colors):
    """Irradiance (V, 3) that surfaces of an albedo (V, 3), white for None, send on as radiance."""
    return radiance if colors is None else radiance / np.maximum(colors, np.float32(LEAST_ALBEDO))


def _albedo(relighter, captured, shared, choice, seed):
    """Albedo (V, 3) or None for white, and what was received on the capture day, (V, 3)."""
    from ..albedo.estimate import under_light

    if choice == "white":
        return None, captured
    if shared.capture is None:
        return captured, np.ones_like(captured)
    light, prior = shared.capture, shared.prior
    return under_light(relighter.occluder, captured, light, prior, seed, **relighter.computed(CAPTURE))


def _source(store, tile, sources):
    """The splats of a tile as the source has them, in its frame, or None."""
    parts = [store.read_arrays(f"splats/{number:05d}_{tile:05d}.npz") for number in sources]
    return joined([Splats(**{name: part[name] for name in NUMBERS}) for part in parts]) if parts else None


def _relit_splats(splats, local, before, after, exposure):
    """Splats that take the change of light of the mesh near them; without a fit in views, which borders would show."""
    from splat2mesh.scene.scene import Scene

    from ..splats.binding import Binding

    near = Scene(local.scene.chunks[: local.near], scene_from_splat=local.scene.scene_from_splat)
    count = near.vertex_count
    return Binding(splats, near, views=()).relit(before[:count], after[:count], exposure)


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


def _far(store, folder, key, piece, sky):
    shared, splats = Shared.kept(store, folder, key), far_splats(store, piece)
    if shared.background is None:
        return splats
    return relit_background(splats, shared.background, shared.sky, shared.scene_from_splat, shared.exposure, sky)
